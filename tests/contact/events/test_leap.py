"""A step of impulses books the work of every contact force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.leap import leap
from rb_sim.engine.systems.many_bodies import WIDTH
from tests.contact.scenes import G, ball, scene, touch
from tests.interpreted import interpreted

SOFT = {"compliance": {"stiffness": 3e3, "damping": 20.0}}
VISCOUS = {"friction": {"type": "viscous", "coefficient": 5.0}}


def energies(law: dict) -> tuple[float, float]:
    """Energy minus work of the contacts before and after a leap of 1 ms [J]."""
    z = 0.095 if "compliance" in law else 0.1
    moving = ball([0, 0, z], linear_velocity=[0.4, 0, -0.2 if z < 0.1 else 0.0])
    motion: Any = Simulation(load_scene(scene(moving, touch(**law))))._motion
    instant = Instant(motion.system, motion.laws, motion._call, 0.0, np.array(motion.compiled.y))

    def balance() -> float:
        y = instant.y
        turning = 0.4 * 0.1**2 * float(y[10:13] @ y[10:13])
        return 0.5 * (float(y[7:10] @ y[7:10]) + turning) + G * float(y[2]) - float(y[WIDTH])

    before = balance()
    assert leap(instant, 1e-3) is not None
    return before, balance()


@pytest.mark.parametrize("law", [SOFT, VISCOUS, SOFT | VISCOUS], ids=["soft", "viscous", "both"])
def test_energy_minus_work_stays(law: dict) -> None:
    before, after = interpreted(energies, law)
    assert_allclose(after, before, rtol=0.0, atol=1e-14)


def jammed(law: dict) -> list[str]:
    """Kinds of event where no forces are found for a compliant contact that is closed."""
    moving = ball([0, 0, 0.095], linear_velocity=[0, 0, -0.2])
    motion: Any = Simulation(load_scene(scene(moving, touch(**law))))._motion
    y = np.array(motion.compiled.y)
    motion._jam(Instant(motion.system, motion.laws, motion._call, 0.0, y), None)
    return [event.kind for event in motion.events]


def test_what_touches_compliantly_alone_is_leapt_over() -> None:
    assert "leaps" in interpreted(jammed, SOFT)
