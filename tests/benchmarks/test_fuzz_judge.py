"""The judge of random scenes: silent on what holds, however fast, and not on what does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.fuzz import judge, newton_euler
from rb_sim import Trajectory

ROD = {
    "bodies": {
        "rod": {
            "mass": 0.1,
            "shape": {"type": "rod", "length": 0.8},
            "angular_velocity": [0.9, 0.5, -0.2],
        }
    },
    "effects": {
        "spring": {
            "type": "spring",
            "body": "rod",
            "stiffness": 3e4,
            "damping": 0.15,
            "point_A": [-0.7, 0.5, -0.1],
            "point_B": [-0.1, -0.2, -0.3],
        },
    },
    "simulation": {"duration": 0.05, "rate": 100.0},
}
"""A damped spring on a thin rod, which it turns to and fro about its own axis at 1e5 rad/s: no
spacing of some 1e-5 s tells its acceleration, nor samples at 25 kHz the work of the damper."""

DYING = {
    "bodies": {"ball": {"mass": 1.0, "inertia": [1e-3] * 3, "angular_velocity": [1.0, 0.5, -2.0]}},
    "effects": {"damping": {"type": "angular_damping", "body": "ball", "coefficient": 3.0}},
    "simulation": {"duration": 0.1, "rate": 100.0},
}
"""Of the spin nothing but the error is left where it is looked."""


@pytest.mark.parametrize("scene", [ROD, DYING])
def test_nothing_is_found_in_what_holds(scene: dict[str, Any]) -> None:
    verdict = judge.of_scene(scene, 60.0)
    assert (verdict.kind, verdict.find) == ("ran", "")


@pytest.mark.parametrize("part", ["linear_acceleration", "angular_acceleration"])
def test_a_law_that_is_broken_is_found(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousandth too much of what the wrenches give."""
    right: Any = getattr(Trajectory, part)

    def wrong(self: Trajectory) -> dict[str, np.ndarray]:
        return {body: 1.001 * values for body, values in right.fget(self).items()}

    assert newton_euler.broken_law(ROD) == ""
    monkeypatch.setattr(Trajectory, part, property(wrong))
    assert newton_euler.broken_law(ROD).startswith("rod: dv/dt")
