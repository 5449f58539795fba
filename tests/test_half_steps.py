"""A short run that is wrong as a whole is told, though no step of it looks bad."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.finding import Finding
from rb_sim.watches.bounds import STRAYED
from tests.watches.test_step_probe import watched


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
    assert "of its way" in found.what
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
    assert "of its way" in found.what


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
    assert "of its time" in found.what


def test_a_long_run_is_not_taken_again() -> None:
    """It would cost as much as three of it."""
    simulation = falling(10)
    simulation.advance(200.0)
    assert simulation.coarseness.strayed.share == 0.0


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
