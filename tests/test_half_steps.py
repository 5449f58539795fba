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
