# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Constraints and balances recomputed from poses, against motions whose numbers are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from rb_sim import Simulation, load_scene
from rb_sim.bags.analysis.analysis_page import write_report
from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.bags.info import APART, GrowingTime
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.scene.load import scene_from_mapping
from tests.bags.analysis import foreign
from tests.bags.scenes import Commander, record_node, record_run

M, G = 2.0, 9.81
BODY = {"mass": M, "inertia": [0.1, 0.2, 0.3]}
CUBE = Body(M, np.diag([0.1, 0.2, 0.3]), np.zeros(3))
WEIGHT = {"weight": {"type": "gravity"}}


def thrown(n: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Free fall with a steady spin about z, a principal axis."""
    t, _, q = foreign.swing(n)
    position = np.c_[2.0 * t, np.zeros(n), 3.0 * t - 0.5 * G * t**2]
    return t, position, q


def scene(effects=None, constraints=None):
    parts = {"bodies": {"body": BODY}, "effects": effects or {}, "constraints": constraints or {}}
    return scene_from_mapping(parts, name="made")


def test_a_fall_balances_with_its_weight_only(tmp_path):
    t, p, q = thrown()
    bag = foreign.write(tmp_path / "bag", t=t, position=p, q=q)
    found = analyze(bag, scene=scene(WEIGHT))
    assert not found.notes
    (balance,) = found.balances.values()
    assert abs(balance["energy"]["error"]) < 1e-8
    assert balance["momentum"]["linear"]["error"] < 1e-9
    assert balance["momentum"]["angular"]["error"] < 1e-7
    span = 0.01 * (400 - 1 - 8)  # the filter takes half a window at either end
    (without,) = analyze(bag, masses={"body": CUBE}).balances.values()
    assert without["momentum"]["linear"]["error"] == pytest.approx(M * G * span, rel=1e-5)
    height = p[4, 2] - p[-5, 2]
    assert without["energy"]["error"] == pytest.approx(M * G * height, rel=1e-4)


def with_wrenches(folder: Path, frame: str, topic: str) -> Path:
    """The swing, and the force M a that it takes beside it, in these axes."""
    t, p, q = foreign.swing()
    force = np.zeros((len(t), 3))
    force[:, 0] = -M * 9.0 * p[:, 0]
    if frame == "body":
        c, s = np.cos(0.8 * t), np.sin(0.8 * t)
        force[:, 0], force[:, 1] = c * force[:, 0], -s * force[:, 0]
    entries = []
    for k in range(len(t)):  # the wrench comes first: its body is known only afterwards
        entries.append((t[k], topic, *foreign.wrench_stamped(t[k], frame, force[k])))
        entries.append((t[k], "/body/pose", *foreign.pose_stamped(t[k], p[k], q[k])))
    return foreign.record(folder, entries)


@pytest.mark.parametrize(("frame", "topic"), [("map", "/body/push"), ("body", "/push")])
def test_recorded_wrenches_are_in_the_balance(tmp_path, frame, topic):
    bag = with_wrenches(tmp_path / "bag", frame, topic)
    found = analyze(bag, masses={"body": CUBE, "other": CUBE})
    (balance,) = found.balances.values()
    assert balance["wrenches"] == [topic]
    swing = M * 1.5**2 / 2  # largest kinetic energy along x
    assert abs(balance["energy"]["error"]) < 1e-4 * swing
    assert balance["momentum"]["linear"]["error"] < 1e-4 * M * 1.5


@pytest.mark.parametrize("commanded", [True, False])
def test_a_command_holds_until_the_next_one(tmp_path, commanded):
    """Thrown, and from 1 s and from 2 s on pushed along x by one message each: what a scene
    commands its body holds, as it does where the scene is simulated with it; a wrench that was
    measured so rarely tells nothing of what lies between."""
    t, p, q = thrown()
    push = {100: 4.0, 200: -6.0}
    after = [np.maximum(t - t[k], 0.0) for k in push]
    p[:, 0] += 0.5 * (4.0 * after[0] ** 2 - 10.0 * after[1] ** 2) / M
    entries = []
    for k in range(len(t)):
        entries.append((t[k], "/body/pose", *foreign.pose_stamped(t[k], p[k], q[k])))
        if k in push:
            acting = foreign.wrench_stamped(t[k], "map", [push[k], 0.0, 0.0])
            entries.append((t[k], "/body/push", *acting))
    foreign.record(tmp_path / "bag", entries, StoragePlugin.SQLITE3)
    drive = {"drive": {"type": "commanded_wrench", "body": "body"}} if commanded else {}
    found = analyze(tmp_path / "bag", scene=scene(WEIGHT | drive))
    (balance,) = found.balances.values()
    assert balance["wrenches"] == ["/body/push"] and not found.notes
    sampled = 10.0 * 0.01  # the instant of each change is known to a sample
    assert (balance["momentum"]["linear"]["error"] < sampled) == commanded


def test_a_wrench_of_no_body_is_left_out_and_reported(tmp_path):
    bag = with_wrenches(tmp_path / "bag", "sensor", "/push")
    found = analyze(bag, masses={"body": CUBE})
    line = "/push: not in the balance: neither its frame nor its topic names a body"
    assert line in found.notes
    assert not next(iter(found.balances.values()))["wrenches"]


def test_a_gap_is_not_bridged(tmp_path):
    """In the gap the body is thrown anew: what happened there is not held against the rest."""
    t, p, q = thrown()
    p[200:] += [5.0, 0.0, 0.0]
    p[200:, 2] += 10.0 * (t[200:] - t[200])
    keep = np.r_[0:180, 220:400]
    bag = foreign.write(tmp_path / "bag", t=t[keep], position=p[keep], q=q[keep])
    (balance,) = analyze(bag, scene=scene(WEIGHT)).balances.values()
    assert balance["stretches"] == 2
    assert abs(balance["energy"]["error"]) < 1e-7


@pytest.mark.parametrize("back", [1.5, 0.07])
def test_a_clock_that_was_set_back_is_not_bridged(tmp_path, back):
    """At the jump the body is thrown anew; its later stamps reach and pass the earlier ones."""
    t, p, q = thrown()
    p[200:] += [5.0, 0.0, 0.0]
    p[200:, 2] += 10.0 * (t[200:] - t[200])
    late = t.copy()
    late[200:] -= back + 0.01
    bag = foreign.write(tmp_path / "bag", t=late, position=p, q=q)
    found = analyze(bag, scene=scene(WEIGHT))
    (balance,) = found.balances.values()
    assert balance["stretches"] == 2
    assert abs(balance["energy"]["error"]) < 1e-7
    assert balance["momentum"]["linear"]["error"] < 1e-8
    (reported,) = (note for note in found.notes if "starts again" in note)
    assert f"from 1.99 s to {1.99 - back:g} s" in reported


def test_wrenches_jump_with_the_poses_and_late_ones_do_not(tmp_path):
    """Found in the stamps: steps back by more than `late`; other sources take the same jump."""
    time = GrowingTime()
    first = time.found("push", np.array([0.0, 1.0, 0.9, 2.0, 0.5, 1.5]), late=0.3)
    assert np.allclose(first, [0.0, 1.0, 0.9, 2.0, 2.0 + APART, 3.0 + APART])
    time.jump("poses", 2.1, 0.45)
    assert time.of("poses", np.array([0.45]))[0] == pytest.approx(1.95 + APART)
    assert np.allclose(time.stamps(first), [0.0, 1.0, 0.9, 2.0, 0.5, 1.5])
    assert len(time.notes()) == 1


def test_errors_of_constraints_from_poses(tmp_path):
    """A plane at y = 0.1 holds the swing; one pose is half a millimetre off it."""
    t, p, q = foreign.swing()
    p[100, 1] += 5e-4
    bag = foreign.write(tmp_path / "bag", t=t, position=p, q=q)
    plane = {"type": "plane", "body": "body", "normal_A": [0, 1, 0], "point_A": [0, 0.1, 0]}
    made = scene_from_mapping(
        {"bodies": {"body": BODY | {"position": [0, 0.1, 0]}}, "constraints": {"wall": plane}},
        name="made",
    )
    reported = analyze(bag, scene=made).constraints
    assert reported is not None
    wall = reported["position"]["wall"]
    assert wall["largest"] == pytest.approx(5e-4, rel=1e-9)
    assert wall["at"] == pytest.approx(t[100], abs=1e-5)
    assert reported["velocity"]["wall"]["largest"] > 0.01  # the filter makes a speed of it
    write_report(analyze(bag, scene=made), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "<td>wall</td><td>position [m or rad]</td><td>0.0005</td><td>1</td>" in text
    assert "energy [J]" not in text  # no force on it is known


def test_residual_of_our_bags_is_recomputed(tmp_path):
    """Whole as recorded; a shift of the recorded poses by a millimetre shows as that."""
    simulation = Simulation(load_scene("heavy_top", duration=0.2, rate=200))
    block = simulation.run(checks=False).block
    offset = np.array([0.0, 1e-3, 0.0])
    for name, samples in (
        ("whole", block),
        ("off", replace(block, position=block.position + offset)),
    ):
        sink = BagSink(tmp_path / name, run={"by": "run", "options": {"duration": 0.2}})
        sink.open(simulation.scene, simulation.layout)
        sink.write(samples)
        sink.close({"outcome": "finished"})
    whole, off = (analyze(tmp_path / name).constraints for name in ("whole", "off"))
    assert whole is not None and off is not None
    assert whole["relative"] < 1e-11
    assert off["position"]["tip"]["largest"] == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize("sine", [0.0, 0.5])
def test_a_constant_wrench_is_in_the_recorded_total(tmp_path, sine):
    """It follows from the scene, a force that oscillates does not."""
    text = f"""
bodies:
  box: {{mass: 2.0, inertia: [0.1, 0.2, 0.25], angular_velocity: [0.1, 0.3, 0.0]}}
effects:
  weight: {{type: gravity}}
  push: {{type: wrench, body: box, frame: body, point_B: [0.2, 0.0, 0.1], force: [1.0, 0.5, 0.0],
         torque: [0.0, 0.1, 0.0], sine_force: [{sine}, 0.0, 0.0], angular_frequency: 6.0}}
simulation: {{duration: 1.0, rate: 200}}
"""
    found = analyze(record_run(text, tmp_path / "bag"))
    apart = found.as_dict()["bodies"]["box"]["apart"]
    told = [note for note in found.notes if "do not contain the wrench of push (wrench)" in note]
    assert len(told) == (sine > 0.0)
    assert (apart["force"] > 0.1) == (apart["torque"] > 0.01) == (sine > 0.0)
    if not sine:
        assert apart["force"] < 1e-7 and apart["torque"] < 1e-7


def test_a_contact_tells_how_deep_it_is(tmp_path):
    """A ball of 0.1 m whose centre sinks to 0.08 m over a floor."""
    t = np.arange(300) / 100
    p = np.c_[np.zeros(300), np.zeros(300), 0.1 - 0.02 * np.sin(t)]
    q = np.tile([0.0, 0.0, 0.0, 1.0], (300, 1))
    bag = foreign.write(tmp_path / "bag", t=t, position=p, q=q)
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0, 0, 0.1]}
    made = scene_from_mapping(
        {"bodies": {"body": ball}, "constraints": {"floor": {"type": "contact", "body": "body"}}},
        name="made",
    )
    reported = analyze(bag, scene=made).constraints
    assert reported is not None
    assert reported["overlap"]["floor"]["largest"] == pytest.approx(0.02, rel=1e-3)
    assert reported["overlap"]["floor"]["at"] == pytest.approx(np.pi / 2, abs=0.02)


# Balances of runs of ours with commands, a reset and a state that was set.


WORK = """\
bodies:
  box: {mass: 2.0, inertia: [0.02, 0.03, 0.04], center_of_mass: [0.1, 0.0, 0.05]}
effects:
  drive: {type: commanded_wrench, body: box}
simulation: {duration: 1.0, method: rk4, step: 5.0e-3, rate: 100}
"""
FORCE = 3.0
AT = (10, 30, 55)
"""Samples from which on the force is another one."""


def _node(folder: Path, reset_at: int, set_at: int) -> Path:
    """Forces along x that change, a reset, and a box that is put elsewhere at rest."""
    from rb_sim import Simulation, load_scene
    from rb_sim.io.bag.bag_sink import BagSink
    from rb_sim.ros.stepper import Stepper

    simulation = Simulation(load_scene(WORK))
    sink = BagSink(folder, run={"by": "node"})
    sink.open(simulation.scene, simulation.layout)
    plan = {k: [((FORCE * (i + 1), 0.0, 0.0), (0.0,) * 3, "world")] for i, k in enumerate(AT)}
    stepper = Stepper(simulation, Commander(plan), [sink], 100.0)  # type: ignore[arg-type]
    stepper.emit()
    for k in range(100):
        if k == reset_at:
            stepper.reset()
        elif k == set_at:
            put = {"position": (5.0, 0.0, 0.0), "linear_velocity": (0.0, 7.0, 0.0)}
            stepper.set_state({"box": put}, project=False)
        else:
            stepper.step(0.0)
    sink.close({})
    return folder


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    pytest.importorskip("rclpy")
    return _node(tmp_path_factory.mktemp("node") / "bag", 40, 80)


def test_nothing_is_balanced_across_a_reset_or_a_state_that_was_set(bag):
    """The momentum that a reset takes away is no error, nor is the energy that a new state has."""
    found = analyze(bag)
    (balance,) = found.balances.values()
    assert balance is not None and balance["stretches"] == 3
    assert abs(balance["energy"]["error"]) < 1e-5 * balance["energy"]["scale"]
    for part in ("linear", "angular"):
        assert balance["momentum"][part]["error"] < 1e-5 * balance["momentum"][part]["scale"]
    assert any(note.startswith("reset or put elsewhere 2 times (t = 0.41, 0.81 s)")
               for note in found.notes)  # fmt: skip


def test_nothing_is_differentiated_across_them(bag):
    """All forces are along x; across the new velocity it would be some 700 N along y."""
    found = analyze(bag).as_dict()["bodies"]["box"]
    assert found["wrench"]["Fy"]["largest"] < 0.05
    assert found["apart"]["force"] < FORCE


def test_the_work_of_commands_that_change(bag):
    """It is what each stretch has gained. A change acts from the sample before the one that shows
    it, and the power jumps there."""
    from rb_sim.io.bag.reader import BagReader

    (block,) = BagReader(bag).blocks()
    gained = block.kinetic_energy[[40, 80, 100]] - block.kinetic_energy[[0, 41, 81]]
    found = analyze(bag)
    (balance,) = found.balances.values()
    assert balance["energy"]["work"] == pytest.approx(gained.sum(), rel=1e-5)


def test_commands_in_body_axes_and_a_reset(tmp_path):
    """The box that turns at 2 rad/s, sampled 50 times a second."""
    pytest.importorskip("rclpy")
    found = analyze(record_node(tmp_path / "bag"))
    (balance,) = found.balances.values()
    assert balance["stretches"] == 2
    assert abs(balance["energy"]["error"]) < 1e-4 * balance["energy"]["scale"]
    assert balance["momentum"]["linear"]["error"] < 1e-4
