# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The verbs as functions, what a run is written as, and what `linearize` and tables say."""

from __future__ import annotations

import csv
import json
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import rb_sim
from rb_sim import RbSimError, Simulation
from rb_sim.cli.verbs.compare import CompareOptions, compare
from rb_sim.cli.verbs.info import info
from rb_sim.cli.verbs.linearize import linearize
from rb_sim.cli.verbs.statics import statics
from rb_sim.io.bag.bag_sink import BagSink
from tests.bags.analysis.foreign import pose_stamped, record, swing
from tests.equilibrium.test_linearize import LEVER, THRESHOLD, disk, top

SPINNING = {
    "bodies": {
        "a": {
            "mass": 2.0,
            "inertia": [0.1, 0.2, 0.25],
            "linear_velocity": [1.0, 0.0, 0.5],
            "angular_velocity": [1.0, 2.0, -0.5],
        }
    },
    "effects": {"weight": {"type": "gravity"}},
    "simulation": {"duration": 1.0, "rate": 50.0},
}


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Of a run of SPINNING."""
    sink, simulation = BagSink(tmp_path / "bag"), rb_sim.Simulation(rb_sim.load_scene(SPINNING))
    sink.open(simulation.scene, simulation.layout)
    sink.write(simulation.run(checks=False).block)
    sink.close()
    return tmp_path / "bag"


def test_values_of_a_scene_can_be_set_where_it_is_not_run(tmp_path: Path, capsys: Any):
    """Twice the load, twice the tension; a quarter of gravity, half the frequency."""
    set_in = ("loads.push.force=[0, 0, -120]",)
    tensions = []
    for changes in ((), set_in):
        assert statics("hinged_rods", tmp_path, changes) == 0
        written = json.loads((tmp_path / "statics.json").read_text(encoding="utf-8"))
        tensions.append(written["reactions"]["string"]["force_N"])
    assert tensions[1] == pytest.approx(np.multiply(2.0, tensions[0]), rel=1e-9)
    capsys.readouterr()
    frequencies = []
    for weight in ("9.81", "2.4525"):
        hangs = ("bodies.rod.orientation=[0, 0, 0, 1]",)
        weights = f"effects.weight.acceleration=[0, 0, -{weight}]"
        linearize("pendulum", 0.0, "world", 0.0, None, True, (*hangs, weights))
        model = json.loads(capsys.readouterr().out)
        frequencies.append(np.abs(np.linalg.eigvals(model["A"])).max())
    assert frequencies[0] == pytest.approx(2.0 * frequencies[1], rel=1e-9)


def test_statics_takes_scenes_of_both_kinds():
    """Two hinged rods: 15 tan 30 deg; a rail that carries a weight: m g."""
    assert rb_sim.load_statics("hinged_rods").name == "hinged_rods"
    tension = rb_sim.statics("hinged_rods").reactions["string"].along
    assert tension == pytest.approx(15.0 * np.tan(np.pi / 6.0), rel=1e-9)
    rail = {"type": "translation", "body": "a", "guide": {"type": "line", "direction": [1, 0, 0]}}
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    block = {"mass": 2.0, "inertia": [1.0, 1.0, 1.0]}
    scene = {"bodies": {"a": block}, "constraints": {"rail": rail}, "effects": {"g": weight}}
    np.testing.assert_allclose(rb_sim.statics(scene).reactions["rail"].force, [0, 0, 19.62])


def test_compare_analyze_and_fit_of_a_bag(bag: Path):
    found = rb_sim.compare(bag, bag)
    assert max(float(np.abs(s).max()) for s in _series(found)) == 0.0
    assert rb_sim.analyze(bag).as_dict()["bodies"].keys() == {"a"}
    fitted = rb_sim.fit(bag, "bodies.a.angular_velocity", noise=(1e-6, 1e-6))
    np.testing.assert_allclose(fitted.values, [1.0, 2.0, -0.5], atol=1e-6)


def _series(found: Any) -> list[Any]:
    return [values for body in found.series.values() for values in body.values()]


def test_linearize_is_that_of_the_simulation():
    there = rb_sim.Simulation("pendulum").linearize()
    np.testing.assert_array_equal(rb_sim.linearize("pendulum").A, there.A)


def test_csv_and_euler_angles(tmp_path: Path):
    """Every number comes back to its last bit; angles are those of scipy, but for whole turns."""
    run = rb_sim.Simulation(rb_sim.load_scene(SPINNING)).run()
    run.to_csv(tmp_path / "new" / "run.csv")
    with open(tmp_path / "new" / "run.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    heights = [float(row["position.a.z"]) for row in rows]
    np.testing.assert_array_equal(heights, run.position["a"][:, 2])
    np.testing.assert_array_equal([float(row["t"]) for row in rows], run.t)
    angles = run.euler_angles["a"]
    apart = Rotation.from_euler("xyz", angles) * Rotation.from_quat(run.orientation["a"]).inv()
    np.testing.assert_allclose(apart.magnitude(), 0.0, atol=1e-9)
    assert np.abs(np.diff(angles[:, ::2], axis=0)).max() < np.pi


def test_pitch_goes_on_beyond_a_quarter_turn():
    """A turn about y at 3 rad/s: pitch is 3 t, roll and yaw stay zero, as in plots."""
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "angular_velocity": [0.0, 3.0, 0.0]}
    scene = {"bodies": {"a": body}, "simulation": {"duration": 4.0, "rate": 50}}
    run = rb_sim.Simulation(scene).run()
    expected = run.t[:, None] * [0.0, 3.0, 0.0]
    np.testing.assert_allclose(run.euler_angles["a"], expected, atol=1e-7)


def test_run_takes_values_and_scenes_shows_one(capsys: pytest.CaptureFixture[str]):
    from rb_sim.cli.verbs.run import RunOptions, scene_of

    changed = scene_of(RunOptions("pendulum", change=["bodies.rod.mass=2.5"], rate=7.0))
    assert (changed.bodies["rod"].mass, changed.simulation.rate) == (2.5, 7.0)
    assert "mass: 2.5" in changed.text
    with pytest.raises(rb_sim.RbSimError, match="must be one of"):
        scene_of(RunOptions("pendulum", change=["bodies.stick.mass=2.5"]))
    from typer.testing import CliRunner

    from rb_sim.cli.main import app

    shown = CliRunner().invoke(app, ["scenes", "pendulum", "--show"])
    assert rb_sim.load_scene(shown.stdout).bodies.keys() == {"rod"}


# What `rb_sim linearize` says: eigenvalues tell of growth only where the motion is steady.


UNSTEADY = "not steady in these axes"


@pytest.fixture
def said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    """Of a scene with options, what the command prints."""

    def of(scene: dict[str, Any], axes: str = "world", turning: float = 0.0) -> str:
        path = tmp_path / "scene.yaml"
        path.write_text(yaml.safe_dump(scene), encoding="utf-8")
        assert linearize(path, 0.0, axes, turning, None) == 0
        return " ".join(capsys.readouterr().out.split())

    return of


@pytest.mark.parametrize(("share", "grows"), [(0.5, True), (2.0, False)])
def test_a_sleeping_top_is_steady_and_grows_below_its_threshold(
    said: Any, share: float, grows: bool
) -> None:
    text = said(top(share * THRESHOLD))
    assert UNSTEADY not in text
    assert ("grows" in text) is grows


def test_a_disk_that_rolls_in_a_circle_is_steady_in_axes_that_turn_with_it(said: Any) -> None:
    scene, _ = disk(0.3, 1.2)
    assert UNSTEADY not in said(scene, turning=1.2)
    assert UNSTEADY in said(scene)
    assert UNSTEADY in said(scene, turning=1.1)


def test_of_a_motion_that_is_not_steady_no_mode_is_said_to_grow(said: Any) -> None:
    """A top that falls: at one instant its model has a positive eigenvalue."""
    scene = top(0.0)
    scene["bodies"]["top"] |= {
        "angular_velocity": [1.0, 0.0, 0.0],
        "linear_velocity": [0.0, -LEVER, 0.0],
    }
    text = said(scene)
    assert UNSTEADY in text
    assert "grows" not in text


def test_a_pendulum_let_go_from_the_horizontal_is_not_steady(said: Any) -> None:
    """Its weight turns it, though all eigenvalues are 0 there, which give no time."""
    rod = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1], "position": [1.0, 0.0, 0.0]}
    hinge = {"type": "fixed_axis", "body": "rod", "axis_B": [0, 1, 0], "point_B": [-1, 0, 0]}
    scene = {"bodies": {"rod": rod}, "constraints": {"hinge": hinge}}
    assert UNSTEADY in said(scene | {"effects": {"weight": {"type": "gravity"}}})


def test_contacts_are_refused_before_anything_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """To come to t = 1 s the loops of contacts would be compiled first, for a minute."""
    monkeypatch.setattr(Simulation, "advance", lambda *_: pytest.fail("moved"))
    with pytest.raises(RbSimError, match="linearize: the scene has contacts"):
        linearize("bouncing_ball", 1.0, "world", 0.0, None)


def test_json_has_the_model_and_the_table_the_matrices(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both have A of a sleeping top; modes of the JSON are the eigenvalues of its A."""
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(top(2.0 * THRESHOLD)), encoding="utf-8")
    assert linearize(path, 0.0, "world", 0.0, None, as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    values = np.linalg.eigvals(np.array(found["A"]))
    modes = [complex(mode["real"], mode["imaginary"]) for mode in found["modes"]]
    assert all(np.abs(values - mode).min() < 1e-6 for mode in modes)
    assert len(found["A"]) == len(found["states"]) == 6
    assert len(found["C"]) == len(found["outputs"])
    assert linearize(path, 0.0, "world", 0.0, None) == 0
    table = capsys.readouterr().out.splitlines()
    row = next(line for line in table if line.split()[:1] == [found["states"][-1]])
    np.testing.assert_allclose(list(map(float, row.split()[1:])), found["A"][-1], rtol=1e-4)


def test_off_equilibrium_the_advice_is_to_start_at_one(said: Any) -> None:
    scene = top(0.0)
    scene["bodies"]["top"]["orientation"] = {"axis": [1, 0, 0], "angle": 0.3}
    scene["bodies"]["top"]["position"] = [0.0, -LEVER * sin(0.3), LEVER * cos(0.3)]
    assert "Start the scene in an equilibrium at rest" in said(scene)


# Names and units stand in tables as they are, whatever a terminal might make of them.


NAMES = ("/[/]", "/[bold]arm[/bold]", "/:smile:", "/[s]")


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag whose topics look like rich's markup and emoji."""
    folder = tmp_path_factory.mktemp("odd") / "bag"
    motion = [*zip(*swing(40), strict=True)]
    entries = ((x[0], topic, *pose_stamped(*x)) for topic in NAMES for x in motion)
    return record(folder, entries)


def test_info(odd: Path, capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    assert info(odd, as_json=False) == 0
    out = capsys.readouterr().out
    for text in (*NAMES, "jitter [ms]", "longest [s]", "rate [Hz]"):
        assert text in out


def test_compare(odd: Path, capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    assert compare(CompareOptions(odd, str(odd))) == 0
    out = capsys.readouterr().out
    for text in (*NAMES, "position [m]", "angle [rad]", "at t [s]", "growth [1/s]"):
        assert text in out


def test_analyze(odd: Path, capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    from rb_sim.cli.verbs.analyze import AnalyzeOptions, analyze

    monkeypatch.setenv("COLUMNS", "160")
    assert analyze(AnalyzeOptions(odd)) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in NAMES)
