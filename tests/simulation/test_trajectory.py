# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Resultants, effects, tables and pictures of a trajectory, on samples whose answers are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rb_sim import AccuracyWarning, RbSimError, Simulation, Trajectory, load_scene
from rb_sim.base.errors import Finding
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.mechanics.samples import ContactEvent, SampleLayout, empty_block

TIED = {
    "bodies": {
        "a": {"mass": 2.0, "inertia": [1, 1, 1], "center_of_mass": [0.5, 0, 0]},
        "b": {"mass": 3.0, "inertia": [1, 1, 1], "position": [0, 0, 2.0]},
    },
    "constraints": {"pin": {"type": "fixed_point", "body": "a"}},
    "effects": {
        "weight": {"type": "gravity"},
        "tie": {
            "type": "spring", "body": "b", "parent": "a", "point_B": [0, 1.0, 0],
            "point_A": [0, 1.0, 0], "stiffness": 10.0, "rest_length": 1.5,
        },
        "drive": {"type": "commanded_wrench", "body": "a"},
    },
    "simulation": {"duration": 1.0, "rate": 10, "method": "rk4", "step": 0.01},
}  # fmt: skip
LAYOUT = SampleLayout(("a", "b"), ("pin",), ("a",), ("a",))


@pytest.fixture
def run():
    """Body a turned by 90 degrees about z, body b two metres above its origin, three samples."""
    block = empty_block(3, LAYOUT)
    block.t[:] = 0.0, 0.5, 1.0
    half = np.sqrt(0.5)
    block.orientation[:, 0] = 0, 0, half, half
    block.orientation[:, 1, 3] = 1.0
    block.position[:, 0] = 0, 0.5, 0
    block.position[:, 1] = 0, 0, 2.0
    block.reaction_force[:, 0] = 1.0, 2.0, 3.0
    block.reaction_torque[:, 0] = 0.1, 0.2, 0.3
    block.command[:, 0] = 0, 0, 4.0, 0, 0, 5.0
    block.kinetic_energy[:] = 7.0
    block.potential_energy[:] = -2.0
    block.residual[:] = 1e-15
    return Trajectory(block, LAYOUT, load_scene(TIED), "rk4, step 0.01 s")


def test_a_resultant_about_another_point(run):
    """M' = M + (anchor - P) x F."""
    about = run.resultant("pin", about="a")
    np.testing.assert_allclose(about.point, run.position["a"])
    expected = np.array([0.1, 0.2, 0.3]) + np.cross([0, -0.5, 0], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(about.torque[0], expected)
    np.testing.assert_allclose(run.resultant("pin").torque[0], [0.1, 0.2, 0.3])
    moved = run.resultant("pin", about=[0.0, 0.0, 1.0])
    np.testing.assert_allclose(
        moved.torque[0], [0.1, 0.2, 0.3] + np.cross([0, 0, -1.0], [1.0, 2, 3])
    )
    with pytest.raises(RbSimError, match="got 'pen'; constraints and effects: pin, weight/a"):
        run.resultant("pen")
    with pytest.raises(RbSimError, match=r"about: got 'c'; must be a body \(a, b\) or a point"):
        run.resultant("pin", about="c")
    with pytest.raises(RbSimError, match="must be a body, 3 finite numbers, or 3 for each sample"):
        run.resultant("pin", about=[1.0, 2.0])


def test_wrenches_of_effects(run):
    """Weight m g; a spring between points (0, 1, 2) and (-1, 0, 0), pulling with k (l - l0)."""
    effect = run.effect
    assert list(effect) == ["weight/a", "weight/b", "tie/b", "tie/a", "drive"]
    np.testing.assert_allclose(effect["weight/b"].force, [[0, 0, -3.0 * 9.81]] * 3)
    np.testing.assert_allclose(effect["weight/a"].torque, np.zeros((3, 3)))
    d = np.array([0, 1.0, 2.0]) - np.array([-1.0, 0.0, 0.0])
    length = np.linalg.norm(d)
    pull = -10.0 * (length - 1.5) * d / length
    np.testing.assert_allclose(effect["tie/b"].force[0], pull, atol=1e-13)
    np.testing.assert_allclose(effect["tie/b"].torque[0], np.cross([0, 1.0, 0], pull), atol=1e-13)
    np.testing.assert_allclose(effect["tie/a"].force[0], -pull, atol=1e-13)
    lever = np.array([-1.0, 0.0, 0.0]) - run.position["a"][0]
    np.testing.assert_allclose(effect["tie/a"].torque[0], np.cross(lever, -pull), atol=1e-13)
    np.testing.assert_allclose(effect["drive"].force[0], [0, 0, 4.0])
    np.testing.assert_allclose(effect["drive"].torque[0], [-2.0, 0, 5.0])  # 5 z - (0, .5, 0) x 4 z
    about_origin = run.resultant("drive", about=[0.0, 0.0, 0.0])
    np.testing.assert_allclose(about_origin.torque[0], [0, 0, 5.0], atol=1e-15)
    with pytest.raises(RbSimError, match="the scene of these samples is not known"):
        _ = Trajectory(run.block, LAYOUT).effect


def test_energies_and_states(run):
    assert (run.energy == run.kinetic_energy + run.potential_energy).all()
    assert run.state(1).t == 0.5 and run.state(1).position["b"].tolist() == [0, 0, 2.0]
    text = "a, b; 3 samples, t = 0 to 1 s; rk4, step 0.01 s; constraint violation 1.0e-15"
    assert text in repr(run)


def test_pandas_and_xarray(run):
    frame, data = run.to_pandas(), run.to_xarray()
    assert frame.index.name == "t" and frame.index.tolist() == [0.0, 0.5, 1.0]
    assert frame["reaction.pin.force.y"].tolist() == [2.0] * 3
    assert frame["position.b.z"].tolist() == [2.0] * 3
    assert frame.attrs["units"]["reaction.pin.torque.x"] == "N m"
    assert set(frame) == set(frame.attrs["units"]) - {"t"}
    picked = data.position.sel(body="b", axis="z")
    assert picked.values.tolist() == [2.0] * 3 and picked.attrs["units"] == "m"
    assert data.reaction_force.sel(reaction="pin").values.shape == (3, 3)
    assert float(data.energy.isel(t=0)) == 5.0


def test_from_bag(run, tmp_path):
    sink = BagSink(tmp_path / "bag", start_ns=10**18)
    sink.open(run.scene, LAYOUT)
    sink.write(run.block)
    sink.close()
    again = Trajectory.from_bag(tmp_path / "bag")
    assert again.layout == LAYOUT and again.method == "rk4, step 0.01 s"
    np.testing.assert_allclose(again.position["a"], run.position["a"], atol=1e-15)
    np.testing.assert_allclose(again.effect["tie/b"].force, run.effect["tie/b"].force, atol=1e-12)
    np.testing.assert_array_equal(again.reaction["pin"].force, run.reaction["pin"].force)


def test_from_bag_has_the_scene_of_the_run(run, tmp_path):
    """Not that of its file: the options of the command line went into the run."""
    scene = load_scene(TIED, duration=0.5, rate=2, method="time_stepping", step=0.02)
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, LAYOUT)
    sink.write(run.block)
    sink.close()
    again = Trajectory.from_bag(tmp_path / "bag")
    assert again.scene.simulation == scene.simulation
    with pytest.raises(RbSimError, match="time_stepping"):  # whose reactions are means over a step
        again.linear_acceleration  # noqa: B018


def test_folders_are_made_and_errors_are_one_line(run, tmp_path):
    run.to_npz(tmp_path / "new" / "run.npz")
    assert np.load(tmp_path / "new" / "run.npz")["t"].tolist() == [0.0, 0.5, 1.0]
    run.plot(tmp_path / "plots" / "run.png")
    assert (tmp_path / "plots" / "run.png").is_file()
    for write, name in ((run.to_npz, "run.npz"), (run.plot, "run.png")):
        with pytest.raises(RbSimError, match=f"^/dev/null/{name}: cannot be written: "):
            write(f"/dev/null/{name}")
    for write, ending in ((run.plot, "png"), (run.view, "rrd")):
        with pytest.raises(RbSimError, match=f"run.pdf: the name must end in .{ending}"):
            write(tmp_path / "run.pdf")
        assert not (tmp_path / "run.pdf").exists()


def test_reactions_print_their_shapes():
    printed = str(Simulation("pendulum").run(1.0).reaction)
    shapes = "<Reaction: force (101, 3) N, torque (101, 3) N m, anchor (101, 3) m>"
    assert f"'hinge': {shapes}" in printed and "[" not in printed
    sample = Simulation("pendulum").sample().reaction["hinge"]
    assert str(sample.force[0]) in str(sample)


def test_repr_counts_events():
    layout = SampleLayout(("a",), (), (), (), ("floor",))
    event = ContactEvent(0.5, "floor", "impact", (0.0, 0.0, 1.0))
    block = replace(empty_block(2, layout), events=(event,))
    assert "; 1 contact event;" in repr(Trajectory(block, layout))
    assert "; 2 contact events;" in repr(Trajectory(replace(block, events=(event,) * 2), layout))


def test_plot(run, tmp_path):
    pages = run.plot(tmp_path / "run.png")
    assert list(pages) == [""] and (tmp_path / "run.png").stat().st_size > 10_000
    assert pages._repr_html_().startswith('<img src="data:image/png;base64,')
    with pytest.raises(RbSimError, match="plot: the trajectory has no scene"):
        Trajectory(run.block, LAYOUT).plot()


def test_view(run, tmp_path, monkeypatch):
    pytest.importorskip("rerun")
    from rb_sim.io.rerun import viewer
    from rb_sim.simulation import trajectory as views

    run.view(save=tmp_path / "run.rrd")
    assert (tmp_path / "run.rrd").stat().st_size > 1000
    shown = []
    monkeypatch.setattr(viewer, "show", lambda path: shown.append(path.stat().st_size))
    run.view()
    assert shown and shown[0] > 1000
    monkeypatch.setattr(views, "in_notebook", lambda: True)
    monkeypatch.setattr(views, "_widget", lambda path: shown.append(path.name))
    run.view()
    assert shown[-1] == "scene.rrd"


def test_from_bag_repeats_what_the_run_had_lost(run, tmp_path):
    """As the summary in the bag tells it, shared advice once; of another version what is known."""
    found = Finding("energy", 0.5, 0.1, 1e-3, "energy", "a", "take shorter steps", 1e-3)
    older = {k: v for k, v in found.as_dict().items() if k != "finer_step"} | {"new": 1}
    sink = BagSink(tmp_path / "bag")
    sink.open(run.scene, LAYOUT)
    sink.write(run.block)
    sink.close({"warnings": [found.as_dict(), older, {"watch": "step"}]})
    with pytest.warns(AccuracyWarning) as reported:
        again = Trajectory.from_bag(tmp_path / "bag")
    assert again.findings == (found, found._replace(finer_step=None))
    assert [str(line.message) for line in reported] == [found.seen, str(found)]
    assert {line.filename for line in reported} == {__file__}
    assert "accuracy lost (energy)" in repr(again)
