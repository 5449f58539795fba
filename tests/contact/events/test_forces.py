"""Forces of friction and resistance in a leap, beside Newton's and Euler's laws of one ball."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.contact.scenes import G, ball, scene, touch
from tests.interpreted import interpreted

OVER, RADIUS, SHARE = 1e-4, 0.1, 0.4
"""s; m; inertia of a ball of 1 kg over m r^2."""
STATIC, KINETIC = 0.5, 0.3
FRICTION = {"friction": {"type": "coulomb", "static": STATIC, "kinetic": KINETIC}}
AWAY = np.array([0.6, 0.8])
DEPTH, SOFT = 0.005, {"compliance": {"stiffness": 2e3}}
BORNE = 2e3 * DEPTH
"""How deep a ball is in a floor that gives way [m], and what that bears [N]."""


def answers(
    push: float, twist: float, law: dict[str, Any], speed: float = 0.0, balls: int = 1
) -> list[tuple[float, ...]]:
    """Of balls on the floor, which a force pushes and a torque twists: what bears each, friction,
    rolling and spinning torques on average over a leap, and the modes then."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.events.impact_handling import leap
    from rb_sim.contact.events.instant import Instant
    from rb_sim.mechanics.contact.contact_table import CLOSED

    bodies = {
        name: ball(
            [2.0 * k, 0.0, RADIUS - DEPTH * ("compliance" in law)],
            linear_velocity=[*(speed * AWAY), 0.0],
        )
        for k, name in enumerate(("body", "other")[:balls])
    }
    floors = {name: touch(name, **law) for name in bodies}
    load = {"type": "wrench", "force": [*(push * AWAY), 0.0], "torque": [0.0, 0.0, twist]}
    loads = {f"load{k}": load | {"body": name} for k, name in enumerate(bodies)}
    motion: Any = Simulation(load_scene(scene(bodies, floors, **loads)))._motion
    at = Instant(motion.laws, motion._call, 0.0, np.array(motion.compiled.y))
    found = leap(at, OVER)
    assert found is not None
    told = []
    for c, k in enumerate(at.first[:balls]):
        n, t1, t2, *rest = (found[k:] / OVER).tolist()
        roll1, roll2, spin = (
            [*rest, 0.0, 0.0, 0.0][:3] if law.get("rolling_resistance") else (0, 0, 0)
        )
        modes = at.system.touch[c, CLOSED : CLOSED + 4].tolist()
        told.append((n, float(np.hypot(t1, t2)), float(np.hypot(roll1, roll2)), abs(spin), *modes))
    return told


SLIDES, STICKS, NO_MODE = 1.0, 2.0, 0.0


def rolling(push: float, resisted: float) -> float:
    """Friction on a ball that rolls: a = (F - M/r)/(m (1 + k)), f = k m a + M/r."""
    return SHARE * (push - resisted / RADIUS) / (1.0 + SHARE) + resisted / RADIUS


@pytest.mark.parametrize("balls", [1, 2])
@pytest.mark.parametrize(
    ("push", "twist", "arms", "friction", "torques"),
    [
        (1.0, 0.0, None, rolling(1.0, 0.0), (0.0, 0.0)),
        (-30.0, 0.0, None, KINETIC * G, (0.0, 0.0)),  # it slips beyond 1/2 N = 17 N 2/7
        (1.0, 0.02, (0.05, 0.01), 1.0, (0.1, 0.02)),
        (-1.0, -0.02, (0.05, 0.001), 1.0, (0.1, 0.001 * G)),
        (1.0, 0.02, (0.005, 0.01), rolling(1.0, 0.005 * G), (0.005 * G, 0.02)),
        (30.0, 0.0, (0.005, 0.01), KINETIC * G, (0.005 * G, 0.0)),
    ],
)
def test_what_holds_a_ball_and_what_does_not(
    push: float, twist: float, arms: Any, friction: float, torques: Any, balls: int
) -> None:
    """Each up to its bound: beyond, friction is that of slips, resistances what they are."""
    law = dict(FRICTION)
    if arms is not None:
        law |= {"rolling_resistance": arms[0], "spinning_resistance": arms[1]}  # type: ignore[dict-item]
    found = interpreted(answers, push, twist, law, 0.0, balls)
    assert len(found) == balls
    for of_ball in found:
        assert_allclose(of_ball[:4], (G, friction, *torques), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize(
    ("push", "twist", "friction", "torques"),
    [
        (1.0, 0.02, 1.0, (0.1, 0.02)),
        (1.0, 0.2, 1.0, (0.1, 0.01 * BORNE)),
        (4.0, 0.02, rolling(4.0, 0.02 * BORNE), (0.02 * BORNE, 0.02)),
        (40.0, 0.0, KINETIC * BORNE, (0.02 * BORNE, 0.0)),
    ],
)
def test_what_a_support_that_gives_way_bears_bounds_friction(
    push: float, twist: float, friction: float, torques: Any
) -> None:
    """Its force is given, and no impulse of a line, whatever else is in the scene."""
    law = FRICTION | SOFT | {"rolling_resistance": 0.02, "spinning_resistance": 0.01}
    for of_ball in interpreted(answers, push, twist, law, 0.0, 2):
        assert_allclose(of_ball[:4], (0.0, friction, *torques), rtol=1e-7, atol=1e-9)
