# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a run writes: nothing over other logs unasked, equal bytes, and what is asked for."""

from __future__ import annotations

import hashlib
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rb_sim import load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.run import RunOptions
from rb_sim.cli.verbs.run import run as run_verb
from rb_sim.io.bag.reader import BagReader
from rb_sim.io.run_plots import Plots
from rb_sim.simulation.record import accelerating
from tests.bags.scenes import PUSHED
from tests.cli.process import COMMAND, PATIENCE, environment, invoke, rb_sim


def run(folder, *more):
    options = ("--out", folder, "--duration", "0.1", "--no-plots", "--no-rerun", "--quiet")
    return invoke("run", "pendulum", *options, *more)


@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-", "| true"])
def test_files_are_written_also_if_nobody_reads_the_output(tmp_path, closed):
    command = f"{' '.join(COMMAND)} linearize pendulum --out out {closed}; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert (done.stdout.splitlines()[-1], done.stderr) == ("0", "")
    assert (tmp_path / "out" / "linear_model.npz").exists()
    assert (tmp_path / "out" / "poles.png").exists()


def test_a_full_disk_below_the_output_is_one_line(tmp_path):
    command = f"{' '.join(COMMAND)} scenes > /dev/full"
    buffered = environment() | {"PYTHONUNBUFFERED": ""}
    done = subprocess.run(["bash", "-c", command], env=buffered, capture_output=True,
                          text=True, timeout=PATIENCE, check=False)  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "error: standard output: cannot be written: No space left on device\n"


def test_a_second_run_into_a_folder_is_refused_in_one_line_unless_asked_for(tmp_path):
    """What is no log does not count, and stays."""
    (tmp_path / "o").mkdir()
    (tmp_path / "o/notes.txt").write_text("mine")
    assert run(tmp_path / "o").exit_code == 0
    bag = tmp_path / "o/bag/bag_0.mcap"
    before = bag.read_bytes()
    again = run(tmp_path / "o", "--rate", "7")
    assert again.exit_code == 2
    (line,) = again.output.splitlines()
    assert (
        line.startswith("error: --out: ")
        and "already contains bag" in line
        and "--overwrite" in line
    )
    assert bag.read_bytes() == before
    assert run(tmp_path / "o", "--rate", "7", "--overwrite").exit_code == 0
    assert bag.read_bytes() != before
    assert (tmp_path / "o/notes.txt").read_text() == "mine"


def test_a_name_that_no_folder_can_have_is_one_line(tmp_path):
    refused = run(tmp_path / ("x" * 300))
    (line,) = refused.output.splitlines()
    assert refused.exit_code == 2 and line.endswith("File name too long")


def test_a_run_that_is_simulated_again_replaces_no_other_run(tmp_path):
    assert run(tmp_path / "a").exit_code == run(tmp_path / "b").exit_code == 0
    again = ("resim", tmp_path / "a/bag", "--out", tmp_path / "b")
    refused = invoke(*again)
    (line,) = refused.output.splitlines()
    assert refused.exit_code == 2 and "already contains bag" in line and "--overwrite" in line
    assert invoke(*again, "--overwrite").exit_code == 0


# Equal runs give equal bags, to the byte, whenever and however fast they ran.


FILES = ("bag_0.mcap", "metadata.yaml")


def sums(bag: Path) -> list[str]:
    return [hashlib.sha256((bag / name).read_bytes()).hexdigest() for name in FILES]


def test_two_runs_give_the_same_files(tumble: Path, tmp_path: Path) -> None:
    """Of one process and of another."""
    for name, command in (("one", rb_sim), ("two", invoke)):
        command("run", tumble, "--out", tmp_path / name, "--no-plots", "--no-rerun", "-q")
    assert sums(tmp_path / "one" / "bag") == sums(tmp_path / "two" / "bag")
    assert BagReader(tmp_path / "one" / "bag").start == 0


def test_wall_stamps_are_there_for_the_asking(tumble: Path, tmp_path: Path) -> None:
    plain = ("run", tumble, "--out", tmp_path, "--no-plots", "--no-rerun", "-q")
    assert invoke(*plain, "--wall-stamps").exit_code == 0
    assert BagReader(tmp_path / "bag").start > 1_700_000_000_000_000_000


# `rb_sim run --accelerations`: in the .npz and the plots, or one line that says why not.


def _run(folder, **options) -> int:
    path = folder / "scene.yaml"
    path.write_text(PUSHED)
    return run_verb(RunOptions(scene=str(path), duration=0.1, quiet=True, rerun=False, **options))


def test_the_npz_holds_them(tmp_path):
    npz = tmp_path / "out" / "run.npz"
    assert _npz(tmp_path, npz) == 0
    found = np.load(npz)
    np.testing.assert_allclose(found["linear_acceleration.box"], [[0, 0, -9.81]] * 6, atol=1e-12)
    # without a torque I dw/dt = -w x I w
    w = found["angular_velocity.box"]
    inertia = np.diag(2.0 / 12.0 * np.array([0.05, 0.1, 0.13]))
    expected = np.linalg.solve(inertia, -np.cross(w, w @ inertia).T).T
    np.testing.assert_allclose(found["angular_acceleration.box"], expected, atol=1e-12)


def _npz(folder, npz) -> int:
    return _run(folder, npz=npz, accelerations=True)


def test_the_plots_show_them():
    scene = load_scene(PUSHED, duration=0.1)
    block, layout = _samples(PUSHED)
    plots = Plots(scene, layout, accelerating(scene, layout))
    plots.add(block)
    (figure,) = plots.figures().values()
    notes = "; ".join(text.get_text() for text in figure.texts)
    assert "box: acceleration of the centre of mass (0, 0, -9.81) m/s²" in notes  # constant
    titles = {axes.get_title(loc="left"): axes for axes in figure.axes}
    assert "box: angular acceleration, body axes [rad/s²]" in titles
    plain = Plots(scene, layout)
    plain.add(block)
    assert len(plain.figures()[""].axes) < len(figure.axes)


def _samples(text):
    from rb_sim import Simulation

    simulation = Simulation(load_scene(text, duration=0.1))
    return simulation.run(checks=False).block, simulation.layout


def test_asked_for_but_nowhere_to_go(tmp_path):
    with pytest.raises(
        RbSimError, match="--accelerations: give --out DIR for bag and plots, or --npz"
    ):
        _run(tmp_path, accelerations=True)


def test_time_stepping_has_none(tmp_path):
    with pytest.raises(RbSimError, match="--accelerations: method time_stepping has none"):
        _run(tmp_path, accelerations=True, npz=tmp_path / "x.npz", method="time_stepping")


# `rb_sim run --certify`: the certificate is printed and kept.


SCENE = """
bodies: {b: {mass: 1.0, inertia: [1, 1, 1], position: [1, 0, 0]}}
effects: {spring: {type: spring, body: b, stiffness: 4.0}}
simulation: {duration: 3.0, rate: 20.0, tolerance: 1.0e-7}
"""


def test_the_certificate_is_in_the_table_and_in_the_summary(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SCENE)
    out = tmp_path / "out"
    options = ["--certify", "--no-bag", "--no-plots", "--no-rerun", "--out", out]
    done = invoke("run", tmp_path / "s.yaml", *options)
    assert done.exit_code == 0, done.output
    assert "global error at most" in done.stdout and "not measured" not in done.stdout
    kept = json.loads((out / "summary.json").read_text())["certificate"]
    assert 1e-10 < kept["errors"]["position"] < 1e-5
    assert kept["known_until"] == kept["follows_until"] == 3.0


def test_without_one_the_table_states_the_global_error_by_a_second_run(tmp_path: Path) -> None:
    """A tolerance bounds that of each step only."""
    (tmp_path / "s.yaml").write_text(SCENE)
    text = invoke("run", tmp_path / "s.yaml", "--no-rerun").stdout
    assert "by a second run (at tolerance 1e-08)" in text
    text = invoke("run", tmp_path / "s.yaml", "--no-rerun", "--no-check").stdout
    assert "not known: not checked" in text
