"""How much of a push lifts a contact that slips, joints holding, beside dense linear algebra."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.base.errors import SimulationError
from rb_sim.contact.events import impact_handling, limits
from rb_sim.contact.events.instant import Instant, frame
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    CLOSED,
    EVENT_RATES_BEFORE,
    NORMAL,
    SLIDE,
    SLIP,
    TOUCH_WIDTH,
)

MU = 0.4


def instant(joints: int, slip: float = 2.0, mu: float = MU, seed: int = 1) -> Any:
    """Two bodies in contact, with random lines and so many of joints before them."""
    rng = np.random.default_rng(seed)
    touch = np.zeros((2, TOUCH_WIDTH))
    touch[:, NORMAL : NORMAL + 3] = [0.6, 0.0, 0.8]
    t1, t2 = frame(touch[1, NORMAL : NORMAL + 3])
    touch[1, SLIP : SLIP + 3] = slip * (0.28 * t1 - 0.96 * t2)
    mass = rng.normal(size=(12, 12))
    at: Any = Instant.__new__(Instant)
    at.system, at.t, at.still = SimpleNamespace(touch=touch), 0.0, 1e-9
    at.laws = [SimpleNamespace(kinetic=9.0), SimpleNamespace(kinetic=mu)]
    at.first = [joints, joints + 3]
    J = rng.normal(size=(joints + 6, 12))
    at.workspace = SimpleNamespace(J=J, W=J + 0.3 * rng.normal(size=J.shape))
    at.__dict__["inverse_mass"] = mass @ mass.T + np.eye(12)
    return at


@pytest.mark.parametrize("joints", [0, 2])
def test_the_effective_pivot_is_that_of_push_and_friction(joints: int) -> None:
    """Of n M^-1 (n - mu d), over n M^-1 n, of velocities that the joints' lines do not hold."""
    at = instant(joints)
    held, k = at.workspace.J[:joints], joints + 3
    inverse = at.inverse_mass
    if joints:
        taken = np.linalg.solve(held @ inverse @ held.T, held @ inverse)
        inverse = inverse - inverse @ held.T @ taken
    n, t1, t2 = at.workspace.J[k : k + 3]
    push = n - MU * (0.28 * t1 - 0.96 * t2)
    assert_allclose(at.effective_pivot(1), (n @ inverse @ push) / (n @ inverse @ n), rtol=1e-12)
    rows, pushes = at.workspace.J[k : k + 2], at.workspace.J[k + 1 : k + 3]
    assert_allclose(at.pivot_of(rows, pushes), rows @ inverse @ pushes.T, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(("slip", "mu"), [(0.9e-9, MU), (2.0, 0.0), (2.0, math.inf)])
def test_what_does_not_slip_or_has_no_bound_is_lifted_as_it_is(slip: float, mu: float) -> None:
    assert instant(1, slip, mu).effective_pivot(1) == 1.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("mass", [1e-14, 1.0, 1e14])
def test_a_contact_that_the_joints_hold_has_no_pivot(mass: float, seed: int) -> None:
    """Its normal is one of the joints' lines."""
    at = instant(2, seed=seed)
    at.__dict__["inverse_mass"] = at.inverse_mass / mass
    at.workspace.J[1] = at.workspace.J[5]
    assert at.effective_pivot(1) == 1.0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("touching", [[0, 1], [1], []])
def test_the_contact_that_its_push_lifts_least(touching: list[int], seed: int) -> None:
    """Of n M^-1 W over n M^-1 n, the one of the least."""
    at = instant(2, seed=seed)
    at.touching = lambda: touching
    shares = [
        (at.workspace.J[k] @ at.inverse_mass @ at.workspace.W[k])
        / (at.workspace.J[k] @ at.inverse_mass @ at.workspace.J[k])
        for k in at.first
    ]
    wanted = min(touching, key=lambda c: shares[c]) if touching else None
    assert impact_handling.least_lifted(at) == wanted


@pytest.mark.parametrize("c", [0, 1])
def test_the_process_of_a_jam_sees_one_contact_and_the_joints_answer(
    monkeypatch: pytest.MonkeyPatch, c: int
) -> None:
    """A = J P M^-1 J^T of its three lines and v = J u - b; of the impulses x those of the joints
    keep their lines as they are."""
    at, seen = instant(2), []
    at.workspace.line_rate = np.linspace(-1.0, 1.0, 8)
    at.system.bodies, at.y = np.zeros((2, 1)), np.random.default_rng(5).normal(size=26)
    at.laws[c], k = SimpleNamespace(kinetic=MU, restitution=0.3), 2 + 3 * c
    x = np.array([2.0, -0.5, 0.25])
    monkeypatch.setattr(
        impact_handling, "impulse_process", lambda *process: seen.append(process) or x
    )
    found = impact_handling.impulses_of_jam(at, c)
    (A, v, friction, restitution), own = seen[0], at.workspace.J[k : k + 3]
    assert_allclose(A, at.pivot_of(own, own))
    u = np.concatenate([at.y[7:13], at.y[20:26]])
    assert_allclose(v, own @ u - at.workspace.line_rate[k : k + 3])
    assert (friction, restitution) == (MU, 0.3)
    assert (found[k : k + 3] == x).all() and np.count_nonzero(found) == 5
    assert_allclose(
        at.workspace.J[:2] @ at.inverse_mass @ at.workspace.J.T @ found, 0.0, atol=1e-10
    )
    monkeypatch.setattr(impact_handling, "impulse_process", lambda *process: None)
    assert impact_handling.impulses_of_jam(at, c) is None


def test_rough_contacts_that_slip_are_refused_by_what_ends_it() -> None:
    """Of those that are closed, slide and know no bound; a drag that lifts is another thing."""
    at = instant(1)
    touch = np.zeros((4, TOUCH_WIDTH))
    touch[:, CLOSED], touch[:, SLIDE] = (1.0, 0.0, 1.0, 1.0), (SLIDING, SLIDING, STUCK, SLIDING)
    at.system.touch, at.t = touch, 0.25
    at.laws = [
        SimpleNamespace(static=s, compliant=False) for s in (math.inf, math.inf, math.inf, 0.5)
    ]
    assert limits.slipping_rough(at) == [0]
    with pytest.raises(
        SimulationError, match="contact a would have to pull or to slip at t = 0.25 s"
    ):
        limits.refuse_rough(at, 0, ("a", "b"))
    at.laws[1].compliant = True
    with pytest.raises(
        SimulationError, match="contact b slips on a compliant support at t = 0.25 s"
    ):
        limits.refuse_rough(at, 1, ("a", "b"))
    with pytest.raises(SimulationError, match="b"):
        limits.refuse_drag(0.25, "b")


@pytest.mark.parametrize(
    ("slope", "soft", "drags", "closed", "refused"),
    [
        (-1.1 * 4e-6, True, True, 0.0, True),
        (-0.9 * 4e-6, True, True, 0.0, False),
        (-1.0, False, True, 0.0, False),
        (-1.0, True, False, 0.0, False),
        (-1.0, True, True, 1.0, False),
    ],
)
def test_a_drag_that_lifts_what_would_push_again_is_refused(
    slope: float, soft: bool, drags: bool, closed: float, refused: bool
) -> None:
    """Apart, its event function falls by more than 1e-6 in the unit of 1/4 s."""
    touch = np.zeros((1, TOUCH_WIDTH))
    touch[0, [CLOSED, EVENT_RATES_BEFORE]] = closed, slope
    system: Any = SimpleNamespace(touch=touch, length=0.5, speed=2.0)
    law: Any = SimpleNamespace(compliant=soft, drags=drags)
    if refused:
        with pytest.raises(SimulationError, match="viscous contact a can neither"):
            limits.refuse_to_be_dragged_off(system, law, 3.0, 0, ("a",))
    else:
        limits.refuse_to_be_dragged_off(system, law, 3.0, 0, ("a",))
