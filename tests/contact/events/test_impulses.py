"""Laws of impact on their own: what Newton's and Poisson's rules give in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.events.laws import SOLVED
from tests.contact.scenes import ball, scene, touch
from tests.interpreted import interpreted

E = 0.6


def impulses(rule: str, mu: float) -> tuple[list[float], float, float]:
    """(impulses of normal and tangents, mass, approach) of a ball that strikes the floor without
    spin, sliding at 1 m/s, by one of the rules."""
    from rb_sim import load_scene
    from rb_sim.contact.events import impulses as rules
    from rb_sim.contact.events.dense import velocities
    from rb_sim.contact.events.instant import Instant
    from rb_sim.contact.events.tasks import Tasks
    from rb_sim.contact.events.touching import find_touching
    from rb_sim.scene.compile import compile_scene

    body = ball([0.0, 0.0, 0.1], linear_velocity=[1.0, 0.0, -2.0])
    compiled = compile_scene(load_scene(scene(body, touch(mu=mu, restitution=E))))
    at = Instant(compiled.contact_laws, Tasks(compiled.system), 0.0, compiled.y.copy())
    u = velocities(at.system, at.y)
    before = rules.Velocities(u, at.room.J @ u - at.room.line_rate)
    find_touching(at.system, at.room)
    x = np.zeros(len(at.room.J))
    assert getattr(rules, rule)(at.system, at.room, before, np.array([E]), x) == SOLVED
    return [float(value) for value in x], 1.0, 2.0


@pytest.mark.parametrize("rule", ["newton_impulses", "poisson_impulses"])
def test_a_ball_alone_rebounds_by_e(rule: str) -> None:
    """(1 + e) m v by both: Poisson's second phase gives back e times the impulse of the first."""
    x, mass, approach = interpreted(impulses, rule, 0.0)
    assert_allclose(x[0], (1.0 + E) * mass * approach, rtol=1e-12)


@pytest.mark.parametrize("rule", ["newton_impulses", "poisson_impulses"])
def test_friction_of_an_impact_is_at_its_bound_while_it_slides(rule: str) -> None:
    """mu (1 + e) m v against the slip, as long as that does not stop it (mu 0.05: it does not)."""
    x, mass, approach = interpreted(impulses, rule, 0.05)
    push = (1.0 + E) * mass * approach
    assert_allclose(x[0], push, rtol=1e-12)
    assert_allclose(np.hypot(x[1], x[2]), 0.05 * push, rtol=1e-12)
