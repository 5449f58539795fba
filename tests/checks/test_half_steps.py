"""A short run that is wrong as a whole is told, though no step of it looks bad."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.diagnostic import Finding
from rb_sim.checks.bounds import STRAYED
from rb_sim.checks.step_doubling import FEW_EVENTS, FEW_STEPS, MOST_TIME
from rb_sim.checks.step_search import quiet_step
from tests.checks.test_step_probe import watched


def falling(steps: int, method: str = "euler", **more: Any) -> Simulation:
    """A body that is let go, for one second."""
    scene = {
        "bodies": {"stone": {"mass": 1.0, "inertia": [0.1, 0.2, 0.25]} | more},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {
            "method": method,
            "step": 1.0 / steps,
            "duration": 1.0,
            "rate": float(steps),
        },
    }
    return Simulation(load_scene(scene), announce=None)


def found_in(simulation: Simulation) -> list[Finding]:
    """What the watches say of the scene's run."""
    return list(watched(simulation).findings)


@pytest.mark.parametrize("steps", [2, 3, 4, 5, 6, 7, 9])
def test_eulers_way_under_a_constant_load_is_told(steps: int) -> None:
    """n steps fall by g h^2 n (n - 1)/2, halves by g h^2 n (2 n - 1)/4 of g h^2 n^2/2: apart by
    1/(2 n), while the velocity is exact in every step."""
    (found,) = (finding for finding in found_in(falling(steps)) if finding.watch == "step")
    assert found.figure == pytest.approx(0.5 / steps, rel=1e-12)
    assert (found.t, found.where, found.bound) == (1.0, "stone", STRAYED)
    assert "relative to the distance moved" in found.what
    assert found.finer_step is not None
    assert "step" not in {one.watch for one in found_in(falling(round(1.0 / found.finer_step)))}


@pytest.mark.parametrize("steps", [11, 20, 100])
def test_a_way_that_is_right_to_a_tenth_is_not(steps: int) -> None:
    assert "step" not in {finding.watch for finding in found_in(falling(steps))}


@pytest.mark.parametrize("method", ["rk4", "gauss6"])
def test_a_method_that_has_the_parabola_exactly_is_not(method: str) -> None:
    assert found_in(falling(2, method)) == []


def test_a_turn_counts_as_a_way() -> None:
    """The axis of a torque alone: (v_C, A w) is A w, and Euler's angle is short by 1/n as well."""
    scene = {
        "bodies": {"wheel": {"mass": 2.0, "inertia": [0.1, 0.1, 0.15]}},
        "effects": {"motor": {"type": "wrench", "body": "wheel", "torque": [0.0, 0.0, 0.01]}},
        "simulation": {"method": "euler", "step": 0.2, "duration": 1.0, "rate": 5.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    (found,) = found_in(simulation)
    assert found.figure == pytest.approx(0.1, rel=1e-3)
    assert "relative to the distance moved" in found.what


def test_a_velocity_that_the_run_gets_wrong_is_told() -> None:
    """Euler's velocity under a force of the time alone is a sum over the begins of its steps."""
    scene = {
        "bodies": {"ball": {"mass": 1.0, "inertia": [0.1] * 3, "linear_velocity": [0.5, 0, 0]}},
        "effects": {
            "shaker": {
                "type": "wrench",
                "body": "ball",
                "force": [0.0, 0.0, 0.0],
                "sine_force": [2.0, 0.0, 0.0],
                "angular_frequency": 4.7,
            }
        },
        "simulation": {"method": "euler", "step": 0.25, "duration": 1.0, "rate": 4.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    simulation.advance(1.0)
    found = simulation.coarseness.strayed

    def velocities(steps: int) -> np.ndarray:
        kicks = 2.0 / steps * np.sin(4.7 * np.arange(steps) / steps)
        return 0.5 + np.append(0.0, np.cumsum(kicks))[:: steps // 4]

    off = np.abs(velocities(4) - velocities(8))
    assert found.share == pytest.approx(off.max() / velocities(8).max(), rel=1e-12)
    assert (found.t, found.body, found.of) == (0.25 * off.argmax(), "ball", "largest velocity")


def test_a_run_whose_halves_end_early_is_told() -> None:
    """At 1 m/s on a wire of 0.36 m, against 1 N a kilogram, a bead comes to rest after 0.5 m: three
    steps, each with the velocity of its end, say 1/3 m; half steps leave the wire by 0.67 s."""
    bead = {"mass": 1.0, "inertia": [0.1] * 3, "linear_velocity": [1.0, 0.0, 0.0]}
    wire = {"type": "curve", "points": [[0.12 * k, 0.0, 0.0] for k in range(4)]}
    scene = {
        "bodies": {"bead": bead},
        "constraints": {"wire": {"type": "translation", "body": "bead", "guide": wire}},
        "effects": {"pull": {"type": "wrench", "body": "bead", "force": [-1.0, 0.0, 0.0]}},
        "simulation": {"method": "euler", "step": 1.0 / 3.0, "duration": 1.0, "rate": 3.0},
    }
    (found,) = (
        f for f in found_in(Simulation(load_scene(scene), announce=None)) if f.watch == "step"
    )
    assert found.figure == pytest.approx(2.0 / 3.0, rel=1e-9)
    assert "relative to the duration" in found.what


@pytest.mark.parametrize("steps", [1000, 4000])
def test_a_run_of_cheap_steps_is_taken_again_to_its_end(steps: int) -> None:
    """A step of Euler's of one free body takes so little that thousands are."""
    simulation = falling(10)
    simulation.advance(0.1 * steps)
    found = simulation.coarseness.strayed
    assert found.share == pytest.approx(0.5 / steps, rel=1e-9)
    assert (found.t, found.upto) == pytest.approx((0.1 * steps, 0.1 * steps))


def test_of_a_long_run_the_beginning_is_taken_again() -> None:
    """All of it would cost as much as three of it."""
    simulation = falling(10)
    simulation.advance(1e5)
    found, most = simulation.coarseness.strayed, int(MOST_TIME / 5e-8)
    assert most < 1e6
    assert found.upto == pytest.approx(0.1 * most)
    assert found.share == pytest.approx(0.5 / most, rel=1e-6)


def test_of_many_bodies_fewer_steps_are_taken_again() -> None:
    """A thousand steps by bodies, of a method whose steps are dear."""
    scene = {
        "bodies": {f"b{k}": {"mass": 1.0, "inertia": [0.1] * 3} for k in range(4)},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"method": "radau5", "step": 0.01, "duration": 10.0, "rate": 10.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    simulation.advance(10.0)
    assert simulation.coarseness.strayed.upto == pytest.approx(0.01 * FEW_STEPS / 4)


def test_the_run_is_taken_again_at_twice_the_steps_only() -> None:
    simulation, seen = falling(10), []
    for _ in range(40):
        simulation.advance(10.0)
        seen.append(simulation.coarseness.strayed.upto)
    upto = sorted(set(seen))
    assert upto[-1] > 0.5 * simulation.time
    assert all(b >= 2.0 * a * (1.0 - 1e-9) for a, b in pairwise(upto))


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
def test_a_spin_about_a_thin_axis_that_gauss6_does_not_damp_is_told(
    step: float, apart: bool, rate: float
) -> None:
    """Its factor of a decay goes to -1 with the step, where the decay's goes to 0: by momenta the
    rod hardly has that spin, and its attitude goes wrong by it all the same."""
    found = found_in(damped_rod("gauss6", step, apart=apart, rate=rate))
    assert ["rod"] == [finding.where for finding in found if finding.watch == "step"]


def test_what_gauss6_leaves_of_the_spin_is_what_the_halves_show() -> None:
    """R(z) = (1 + z/2 + z^2/10 + z^3/120) / (1 - z/2 + z^2/10 - z^3/120), z = -c h / I_3: the spin
    is R^n w_3, in half steps R(z/2)^2n w_3, of |w| where the other axes hardly turn in a step."""
    step, w = 0.005, np.array([7.8, 15.6, 25.3])
    simulation = damped_rod("gauss6", step)
    simulation.advance(step)

    def left(z: float) -> float:
        even, odd = 1.0 + z * z / 10.0, 0.5 * z + z**3 / 120.0
        return (even + odd) / (even - odd)

    z = -step / ROD[2]
    off = abs(left(z) - left(0.5 * z) ** 2) * w[2] / np.linalg.norm(w)
    found = simulation.coarseness.strayed
    assert found.share == pytest.approx(off, rel=1e-3)
    assert (found.body, found.of) == ("rod", "largest velocity")


def test_a_stiff_method_is_named_where_only_far_smaller_steps_do() -> None:
    """gauss6 follows the decay of 5.3e-6 s from 1e-5 s on; of a step of 5e-5 s that is a fifth."""
    for step, named in ((0.005, True), (5e-5, False)):
        simulation = damped_rod("gauss6", step, duration=0.005)
        advice = quiet_step(simulation, watched(simulation).findings)
        assert "which passes all checks" in advice
        assert ("radau5" in advice) == named


@pytest.mark.parametrize("apart", [False, True], ids=["reduced", "maximal"])
def test_a_method_that_damps_it_out_is_not_told(apart: bool) -> None:
    """radau5's factor goes to 0 as well."""
    assert found_in(damped_rod("radau5", 0.005, apart=apart)) == []


def above_a_floor(height: float, method: str, steps: int, restitution: float = 0.5) -> Simulation:
    """A stone that is let go above a floor, for one second."""
    floor = {"type": "contact", "body": "stone", "points": [[0.0, 0.0, 0.0]]}
    floor["restitution"] = restitution
    scene = {
        "bodies": {"stone": {"mass": 1.0, "inertia": [0.1] * 3, "position": [0.0, 0.0, height]}},
        "constraints": {"floor": floor},
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]},
            "hand": {"type": "commanded_wrench", "body": "stone"},
        },
        "simulation": {"method": method, "step": 1.0 / steps, "duration": 1.0, "rate": 1.0 * steps},
    }
    return Simulation(load_scene(scene), announce=None)


@pytest.mark.parametrize("steps", [3, 5, 7])
def test_eulers_way_above_a_floor_that_it_never_touches_is_told(steps: int) -> None:
    """As without the floor; none of it was looked at where bodies may strike."""
    (found,) = (f for f in found_in(above_a_floor(50.0, "euler", steps)) if f.watch == "step")
    assert found.figure == pytest.approx(0.5 / steps, rel=1e-9)
    assert found.where == "stone"


@pytest.mark.parametrize("steps", [4, 5, 6, 7, 9])
def test_eulers_way_to_a_floor_and_up_again_is_told(steps: int) -> None:
    """It falls too far by a share 1/n of 3 m, so that it strikes late and too fast."""
    assert "step" in {f.watch for f in found_in(above_a_floor(3.0, "euler", steps))}


@pytest.mark.parametrize("steps", [3, 4, 5, 7, 20])
@pytest.mark.parametrize("restitution", [0.0, 0.8])
def test_a_bounce_in_steps_that_have_the_parabola_exactly_is_not(
    steps: int, restitution: float
) -> None:
    simulation = above_a_floor(3.0, "rk4", steps, restitution)
    assert "step" not in {finding.watch for finding in found_in(simulation)}
    assert simulation.events


def test_an_impact_that_halves_see_a_little_later_is_not() -> None:
    """By k steps whole ones fall g h^2 k (k + 1)/2, halves g h^2 k (k + 1/2)/2 (a body in contact
    goes on with the velocity of the step's end): from a height in between, at that sample one goes
    up already and the other still down."""
    k, h = 78, 0.01
    height = 0.5 * 9.81 * h**2 * k * (k + 0.75)
    simulation = above_a_floor(height, "euler", 100, 0.9)
    assert "step" not in {finding.watch for finding in found_in(simulation)}
    (impact, *_) = simulation.events
    assert (k - 1) * h < impact.t < k * h


@pytest.mark.parametrize("interfere", ["command", "state"])
def test_a_run_that_somebody_interfered_with_is_not_taken_again(interfere: str) -> None:
    """The trials know of neither."""
    simulation = above_a_floor(50.0, "euler", 5)
    simulation.advance(0.4)
    if interfere == "command":
        simulation.apply_wrench("stone", [100.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    else:
        simulation.set_state({"stone": {"position": [0.0, 0.0, 50.0]}})
    simulation.advance(0.6)
    assert simulation.coarseness.strayed.share == 0.0


def test_a_run_of_many_bounces_is_taken_again_up_to_one_of_them() -> None:
    """Without loss it bounces for ever; the last step before one event more than FEW_EVENTS ends
    what is compared."""
    simulation = above_a_floor(1e-2, "rk4", 500, 1.0)
    simulation.advance(1.0)
    events = simulation.events
    assert len(events) > FEW_EVENTS
    upto = simulation.coarseness.strayed.upto
    assert events[FEW_EVENTS].t - 0.002 <= upto < events[FEW_EVENTS].t


def test_a_body_that_is_welded_in_the_origin_has_not_strayed() -> None:
    """It moves by rounding, of which the two runs have different amounts, and more than the way of
    either; a point comes to rest on it."""
    table = {"mass": 3.0, "inertia": [0.2] * 3, "shape": {"type": "box", "size": [0.8, 1, 0.2]}}
    point = {"mass": 0.7, "inertia": [0.01] * 3, "position": [0.2, 0, 0.1]}
    slide = {"type": "contact", "body": "point", "parent": "table", "points": [[0, 0, 0]]}
    slide |= {
        "surface": {"type": "shape"},
        "friction": {"type": "coulomb", "static": 0.3},
    }
    weight = {"type": "gravity", "acceleration": [0, 0, -9.81], "bodies": ["point"]}
    scene = {
        "bodies": {"point": point | {"linear_velocity": [0.5, 0.05, 0]}, "table": table},
        "constraints": {"weld": {"type": "weld", "body": "table"}, "slide": slide},
        "effects": {"weight": weight},
        "simulation": {"method": "rk4", "step": 1e-3, "duration": 0.65, "rate": 100.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    assert "step" not in {finding.watch for finding in found_in(simulation)}
