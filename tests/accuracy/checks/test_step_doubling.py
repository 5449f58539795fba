# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A fixed step that does not follow the motion is told, also where it keeps the energy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim import AccuracyWarning, Simulation, load_scene
from rb_sim.accuracy.checks.check import effort_of
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.accuracy.checks.step_search import quiet_step

W = 1e3
"""Frequency of the oscillator [rad/s]."""


def oscillator(
    method: str, step: float, steps: int = 100, floor: bool = False, beside: bool = False
) -> Simulation:
    """1 kg on a spring, let go 1 cm from its anchor; floor: it slides on one, without friction;
    beside: another body rests, so that coordinates are maximal."""
    scene: dict[str, Any] = {
        "bodies": {"bob": {"mass": 1.0, "inertia": [0.1] * 3, "position": [0.01, 0.0, 0.0]}},
        "effects": {
            "spring": {
                "type": "spring",
                "body": "bob",
                "stiffness": W * W,
                "point_A": [0.0, 0.0, 0.0],
                "rest_length": 0.0,
            }
        },
        "simulation": {
            "method": method,
            "step": step,
            "duration": steps * step,
            "rate": 1.0 / step,
        },
    }
    if beside:
        scene["bodies"]["other"] = {"mass": 1.0, "inertia": [0.1] * 3}
    if floor:
        scene["bodies"]["bob"] |= {"shape": {"type": "sphere", "radius": 0.1}}
        scene["constraints"] = {
            "floor": {
                "type": "contact",
                "body": "bob",
                "surface": {"type": "plane", "point": [0.0, 0.0, -0.1], "normal": [0.0, 0.0, 1.0]},
                "friction": {"type": "smooth"},
            }
        }
        scene["effects"]["weight"] = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    return Simulation(load_scene(scene), announce=None)


def watched(simulation: Simulation) -> CheckList:
    """The watches of the whole run."""
    check_list = CheckList(simulation.scene, simulation.layout)
    options = simulation.scene.simulation
    for block in simulation.blocks(options.duration, options.rate):
        check_list.add(block, effort_of(simulation))
    return check_list


@pytest.mark.parametrize("turn", [4.0, 10.0, 300.0])
def test_gauss6_that_steps_over_an_oscillation_is_reported(turn: float) -> None:
    """It keeps the energy to round-off, so that no balance shows it."""
    check_list = watched(oscillator("gauss6", turn / W))
    (found,) = (finding for finding in check_list.findings if finding.check == "step")
    assert found.where == "bob"
    energy: Any = check_list.ledger.energy()
    assert energy["relative"] < 1e-9


@pytest.mark.parametrize(("method", "turn"), [("gauss6", 2.0), ("rk4", 0.65)])
def test_an_error_that_many_steps_add_up_to_is_reported(method: str, turn: float) -> None:
    """A step of gauss6 errs by (w h)^7/100800 in phase, rk4 by (w h)^5/120; 300 of them by half a
    radian and more, which no balance of gauss6 shows, and which one step keeps within its bound."""
    simulation = oscillator(method, turn / W, 300)
    check_list = watched(simulation)
    phase = {"gauss6": turn**7 / 100800.0, "rk4": turn**5 / 120.0}[method]
    assert 0.3 * 300 * phase < simulation.missed.share < 3.0 * 300 * phase
    (found,) = (finding for finding in check_list.findings if finding.check == "step")
    assert found.where == "bob"


@pytest.mark.parametrize(("method", "turn"), [("gauss6", 2.0), ("rk4", 0.65)])
def test_in_contact_a_second_run_tells_it(method: str, turn: float) -> None:
    """There no step is probed: it would have to choose the modes of contacts anew."""
    with pytest.warns(AccuracyWarning, match="global error"):
        run = oscillator(method, turn / W, 300, floor=True).run()
    assert run.global_error.relative > 0.1 and run.global_error.body == "bob"


def spun_rod(method: str, turn: float) -> Simulation:
    """300 steps of a thin rod that flies and turns slowly across, and by `turn` about its axis in a
    step: in its own axes what it turns across goes round as fast."""
    across, along, spin = 0.01, 1e-7, 2e4
    step = turn / (spin * (1.0 - along / across))
    push = {"type": "wrench", "body": "rod", "torque": [1e-6, 0.0, 0.0], "frame": "body"}
    scene: dict[str, Any] = {
        "bodies": {
            "rod": {
                "mass": 1.0,
                "inertia": [across, across, along],
                "position": [0.0, 0.0, 1.0],
                "angular_velocity": [5.0, 0.0, spin],
            }
        },
        "effects": {"push": push},
        "simulation": {
            "method": method,
            "step": step,
            "duration": 300 * step,
            "rate": 1.0 / step,
        },
    }
    return Simulation(load_scene(scene), announce=None)


@pytest.mark.parametrize(("method", "turn"), [("gauss6", 2.0), ("rk4", 0.65)])
def test_a_spin_that_hardly_moves_a_rod_hides_nothing(method: str, turn: float) -> None:
    """Its points move a hundred times as fast about its axis as across, which is missed."""
    simulation = spun_rod(method, turn)
    check_list = watched(simulation)
    phase = {"gauss6": turn**7 / 100800.0, "rk4": turn**5 / 120.0}[method]
    assert 0.5 * 300 * phase < simulation.missed.share < 1.5 * 300 * phase
    assert "step" in [finding.check for finding in check_list.findings]


@pytest.mark.parametrize("floor", [False, True], ids=["free", "in contact"])
@pytest.mark.parametrize(("method", "turn"), [("gauss6", 1.0), ("rk4", 0.1), ("euler", 0.02)])
def test_a_step_that_follows_is_not(method: str, turn: float, floor: bool) -> None:
    assert watched(oscillator(method, turn / W, floor=floor)).findings == ()


@pytest.mark.parametrize(("method", "order", "part"), [("rk4", 5, 120.0), ("euler", 2, 2.0)])
def test_what_steps_miss_follows_from_their_order(method: str, order: int, part: float) -> None:
    """Of x'' = -w^2 x Kutta's method misses (w h)^5/120 of v in a step, Euler's (w h)^2/2 of v or
    x."""
    z = 0.1
    simulation = oscillator(method, z / W)
    simulation.advance(10 * z / W)
    assert 0.2 < simulation.missed.share / (10 * z**order / part) < 2.0


@pytest.mark.parametrize("periods", [1, 2, 4])
@pytest.mark.parametrize("method", ["rk4", "gauss6", "euler"])
def test_a_load_that_beats_with_the_step_is_reported(method: str, periods: int) -> None:
    """A push that oscillates a whole number of times in a step, and in half of one, is the same in
    all of them: the ball goes on as if nothing pushed it for good."""
    load = {"type": "wrench", "force": [0.0, 0.0, 0.0], "sine_force": [200.0, 0.0, 0.0]}
    step = 0.1
    beats = load | {"angular_frequency": 4.0 * math.pi * periods / step}
    found = watched(thrown(beats, step, method, 20)).findings
    assert ["ball"] == [finding.where for finding in found if finding.check == "step"]


def test_a_probe_does_not_touch_the_run() -> None:
    probed, alone = (oscillator("rk4", 0.1 / W) for _ in range(2))
    for simulation in (probed, alone):
        for _ in range(20):
            simulation.advance(50 * 0.1 / W)
            if simulation is probed:
                assert math.isfinite(probed.missed.share)
    ends = (simulation.sample().block for simulation in (probed, alone))
    one, other = ((end.position, end.linear_velocity) for end in ends)
    np.testing.assert_array_equal(one, other)
    assert probed.steps == alone.steps


def test_an_adaptive_method_is_not_probed() -> None:
    simulation = Simulation(load_scene("heavy_top"), announce=None)
    assert simulation.missed.share == 0.0


def whip(step: float, duration: float) -> Simulation:
    """A heavy body on a rod from a point beside its centre: it falls, and after 0.4 s the rod pulls
    it round within some hundredths of a second."""
    body = {
        "mass": 81.0,
        "inertia": [0.3, 0.4, 0.32],
        "position": [0.114, -0.226, -0.244],
        "orientation": {"axis": [0.04, 0.22, 0.97], "angle": 1.35},
        "angular_velocity": [-0.14, 0.3, -0.16],
        "linear_velocity": [-0.33, -0.79, -0.27],
    }
    rod = {
        "type": "distance",
        "body": "body",
        "point_B": [0.142, 0.372, 0.408],
        "point_A": [1.02, -1.4, 0.98],
    }
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    options = {"method": "euler", "step": step, "duration": duration, "rate": 100.0}
    scene = {
        "bodies": {"body": body},
        "constraints": {"rod": rod},
        "effects": {"weight": weight},
        "simulation": options | {"project_initial": True},
    }
    return Simulation(load_scene(scene), announce=None)


@pytest.mark.parametrize(
    ("step", "steps"), [(0.05, 9), (0.05, 10), (0.05, 11), (0.05, 12), (0.02, 25), (0.01, 50)]
)
def test_what_happens_in_the_middle_of_a_short_run_is_reported(step: float, steps: int) -> None:
    """The start looks smooth, and so may the end; the second run passes through the middle."""
    with pytest.warns(AccuracyWarning, match="global error"):
        run = whip(step, step * steps).run()
    assert run.energy[-1] > run.energy[0] + 5.0


@pytest.mark.parametrize("turn", [0.01, 0.02, 0.0251, 0.03])
def test_a_step_that_follows_through_where_nothing_accelerates_is_not(turn: float) -> None:
    """At the anchor the velocity hardly changes in a step, less than Euler's misses of it."""
    check_list = watched(oscillator("euler", turn / W, round(2.0 * math.pi / turn)))
    assert "step" not in [finding.check for finding in check_list.findings]


def thrown(effect: dict[str, Any], step: float, method: str, steps: int) -> Simulation:
    """1 kg at 1 m/s under one load."""
    body = {"mass": 1.0, "inertia": [0.1] * 3, "linear_velocity": [1.0, 0.0, 0.0]}
    scene = {
        "bodies": {"ball": body},
        "effects": {"load": effect | {"body": "ball"}},
        "simulation": {
            "method": method,
            "step": step,
            "duration": steps * step,
            "rate": 1.0 / step,
        },
    }
    return Simulation(load_scene(scene), announce=None)


@pytest.mark.parametrize("steps", [2, 3, 4])
def test_a_run_that_ends_before_it_overflows_is_reported(steps: int) -> None:
    """v' = -c v |v| with c h |v| = 100: v is -99, then 1e6, and after some steps more no number; so
    four steps show nothing, and one does."""
    oil = {"type": "quadratic_drag", "coefficient": 1000.0}
    check_list = watched(thrown(oil, 0.1, "euler", steps))
    assert "step" in [finding.check for finding in check_list.findings]


@pytest.mark.parametrize("method", ["euler", "rk4", "gauss6"])
def test_a_load_that_is_missed_and_hardly_matters_is_not(method: str) -> None:
    """1e-7 N at a radian and a half a step: what is missed is 1e-8 of a way of 10 m."""
    load = {"type": "wrench", "force": [0.0, 0.0, 0.0], "sine_force": [1e-7, 0.0, 0.0]}
    simulation = thrown(load | {"angular_frequency": 15.0}, 0.1, method, 100)
    assert "step" not in [finding.check for finding in watched(simulation).findings]


def test_a_start_that_the_run_did_not_have_is_not_looked_at() -> None:
    """Put at rest where the spring is slack, it stays there, whatever the scene begins with."""
    simulation = oscillator("gauss6", 4.0 / W, beside=True)
    simulation.set_state({"bob": {"position": [0.0, 0.0, 0.0]}})
    assert watched(simulation).findings == ()


ROD = [0.36, 0.36, 5.3e-6]
"""Moments of a thin rod [kg m^2]."""


def damped_rod(method: str, step: float, *, apart: bool = True, **more: Any) -> Simulation:
    """A rod whose spin about its own axis is damped out in I/c = 5.3e-6 s, and across in 0.36 s;
    apart: another body flies far away, so that coordinates are maximal."""
    rod = {"mass": 6.4, "inertia": ROD, "angular_velocity": [7.8, 15.6, 25.3]}
    scene: dict[str, Any] = {
        "bodies": {"rod": rod} | ({"other": {"mass": 1.0, "inertia": [0.1] * 3}} if apart else {}),
        "effects": {"oil": {"type": "angular_damping", "body": "rod", "coefficient": 1.0}},
        "simulation": {"method": method, "step": step, "duration": 0.5, "rate": 100.0} | more,
    }
    return Simulation(load_scene(scene), announce=None)


@pytest.mark.parametrize("rate", [100.0, 1.0 / 0.005, 37.0])
@pytest.mark.parametrize("apart", [False, True], ids=["reduced", "maximal"])
@pytest.mark.parametrize("step", [0.02, 0.005, 1e-4])
def test_a_spin_about_a_thin_axis_that_gauss6_does_not_damp_is_reported(
    step: float, apart: bool, rate: float
) -> None:
    """Its factor of a decay goes to -1 with the step, where the decay's goes to 0: by momenta the
    rod hardly has that spin, and its attitude goes wrong by it all the same."""
    found = watched(damped_rod("gauss6", step, apart=apart, rate=rate)).findings
    assert ["rod"] == [finding.where for finding in found if finding.check == "step"]


def test_a_stiff_method_is_named_where_only_far_smaller_steps_do() -> None:
    """gauss6 follows the decay of 5.3e-6 s from 1e-5 s on; of a step of 5e-5 s that is a fifth."""
    for step, named in ((0.005, True), (5e-5, False)):
        simulation = damped_rod("gauss6", step, duration=0.005)
        advice = quiet_step(simulation, watched(simulation).findings)
        assert "which passes all checks" in advice
        assert ("radau5" in advice) == named


@pytest.mark.parametrize("apart", [False, True], ids=["reduced", "maximal"])
def test_a_method_that_damps_it_out_is_not_reported(apart: bool) -> None:
    """radau5's factor goes to 0 as well."""
    assert watched(damped_rod("radau5", 0.005, apart=apart)).findings == ()


def test_an_attitude_that_a_step_misses_is_reported() -> None:
    """A motor speeds up the spin of a ball that flies at 300 m/s: Euler's turn in a step is short
    by h^2 a / 2, which is nothing of its way."""
    h, a = 1e-3, 120.0
    simulation = thrown({"type": "wrench", "torque": [0.0, 0.0, 0.1 * a]}, h, "euler", 100)
    simulation.set_state({"ball": {"linear_velocity": [300.0, 0.0, 0.0]}})
    assert simulation.missed.share < 1e-3
    simulation.advance(100 * h)
    assert simulation.missed.share == pytest.approx(104 * 0.5 * h * h * a, rel=0.1)


@pytest.mark.parametrize(("turn", "told"), [(1.0, True), (0.02, False)])
def test_time_stepping_is_probed_in_contact(turn: float, told: bool) -> None:
    """On a spring along a floor: of the change of its velocity a step misses w h / 2."""
    found = watched(oscillator("time_stepping", turn / W, floor=True)).findings
    assert ("step" in {finding.check for finding in found}) == told
