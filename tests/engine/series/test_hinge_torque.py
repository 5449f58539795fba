"""The torque about a fixed axis, term by term, against the wrench that each effect gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.interpreted import interpreted
from tests.one_body_scenes import EFFECTS, JOINTS, ON_BODY, WEIGHT

HINGED = JOINTS["fixed_axis, B floats"]
TORSION_DAMPER = {"type": "torsion_spring", "axis_B": [1.0, 2.0, 0.5], "damping": 0.05} | ON_BODY
SERIES: dict[str, Any] = {
    name: {"effect": EFFECTS[name]}
    for name in ("gravity", "linear_drag", "angular_damping", "wrench", "wrench in body axes")
} | {
    "torsion damper": {"effect": TORSION_DAMPER},
    "command": {"effect": {"type": "commanded_wrench"} | ON_BODY},
    "none": {},
    "several": {"weight": WEIGHT, "drag": EFFECTS["linear_drag"], "load": EFFECTS["wrench"]},
}
"""Effects of a body on a fixed axis whose torque has the form of HingeTorque."""


def torques(effects: Any) -> tuple[list[float], list[float]]:
    """The torque at several phi and phi' by the terms, and by the wrench of the effects."""
    import math

    from rb_sim import load_scene
    from rb_sim.engine.one_body import torque_about
    from rb_sim.engine.series.hinge_torque import total_hinge_torque
    from rb_sim.engine.systems.fixed_axis import hinge_state
    from rb_sim.maths.vectors import dot
    from rb_sim.scene.compile import compile_scene
    from rb_sim.simulation import with_command

    system: Any = compile_scene(load_scene(HINGED | {"effects": effects})).system
    held = ((1.0, 2.0, -0.5), (0.1, -0.3, 0.2), (-0.7, 0.4, 0.9), (0.2, 0.1, -0.4))
    rows = [with_command(r, held) if hasattr(r, "torque_W") and hasattr(r, "torque_B") else r
            for r in system.effects]  # fmt: skip
    system = system._replace(effects=tuple(rows))
    terms = total_hinge_torque(system.effects, system)
    found, expected = [], []
    for phi, rate in np.random.default_rng(1).normal(size=(20, 2)) * 3.0:
        B = hinge_state(system, (phi, rate))
        moment = torque_about(system.effects, 0.0, system.body, B, system.rho)
        expected.append(dot(system.axis_B, moment))
        turning = terms.cosine * math.cos(phi) + terms.sine * math.sin(phi)
        found.append(terms.steady + turning + terms.rate * rate)
    return found, expected


@pytest.mark.parametrize("name", SERIES)
def test_terms_are_the_torque_about_the_axis(name: str) -> None:
    found, expected = interpreted(torques, SERIES[name])
    assert_allclose(found, expected, rtol=0.0, atol=1e-14 * (1.0 + np.abs(expected).max()))
    assert name == "none" or np.abs(expected).max() > 1e-2
