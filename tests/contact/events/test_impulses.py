"""Laws of impact on their own: what Newton's and Poisson's rules give in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.problem import impacts as rules
from rb_sim.contact.problem.forces import SOLVED
from rb_sim.numerics.complementarity import HOLDS, PUSHES, RUBS
from tests.contact.scenes import ball, scene, touch
from tests.interpreted import interpreted

E = 0.6


def impulses(rule: str, mu: float) -> tuple[list[float], float, float]:
    """(impulses of normal and tangents, mass, approach) of a ball that strikes the floor without
    spin, sliding at 1 m/s, by one of the rules."""
    from rb_sim import load_scene
    from rb_sim.contact.events.instant import Instant
    from rb_sim.contact.events.tasks import Tasks
    from rb_sim.contact.problem.delassus import velocities
    from rb_sim.contact.problem.event_workspace import find_touching
    from rb_sim.scene.compile import compile_scene

    body = ball([0.0, 0.0, 0.1], linear_velocity=[1.0, 0.0, -2.0])
    compiled = compile_scene(load_scene(scene(body, touch(mu=mu, restitution=E))))
    at = Instant(compiled.contact_laws, Tasks(compiled.system), 0.0, compiled.y.copy())
    u = velocities(at.system, at.y)
    before = rules.Velocities(u, at.workspace.J @ u - at.workspace.line_rate)
    find_touching(at.system, at.workspace)
    x = np.zeros(len(at.workspace.J))
    assert getattr(rules, rule)(at.system, at.workspace, before, np.array([E]), x) == SOLVED
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


def of_ball(
    velocity: list[float], spin: list[float], rule: dict[str, bool], law: dict[str, Any]
) -> list[float]:
    """Impulses of a ball of 1 kg and radius 0.1 at the floor, of each of its lines."""
    from rb_sim import load_scene
    from rb_sim.contact.events.instant import Instant
    from rb_sim.contact.events.tasks import Tasks
    from rb_sim.contact.problem.delassus import velocities
    from rb_sim.contact.problem.event_workspace import find_touching
    from rb_sim.scene.compile import compile_scene

    body = ball([0.0, 0.0, 0.1], linear_velocity=velocity, angular_velocity=spin)
    mapping = scene(body, touch(**law))
    mapping["simulation"]["project_initial"] = True
    compiled = compile_scene(load_scene(mapping))
    y = compiled.y.copy()
    y[7:13] = velocity + spin
    at = Instant(compiled.contact_laws, Tasks(compiled.system), 0.0, y)
    u = velocities(at.system, at.y)
    before = rules.Velocities(u, at.workspace.J @ u - at.workspace.line_rate)
    find_touching(at.system, at.workspace)
    at.workspace.together[:] = 1
    x, none = np.zeros(len(at.workspace.J)), np.zeros(1)
    asked = rules.Rule(none, none, rule.get("together", False), rule.get("stop", False))
    assert rules.impulses_with(at.system, at.workspace, before, asked, x) == SOLVED
    return [float(value) for value in x]


@pytest.mark.parametrize(
    ("law", "rule", "pull"),
    [({}, {}, 0.0), ({"mode": "bilateral"}, {}, -1.0), ({}, {"together": True}, -1.0)],
)
def test_only_what_holds_both_ways_pulls_back_what_leaves(
    law: dict[str, str], rule: dict[str, bool], pull: float
) -> None:
    """A ball that leaves at 1 m/s: no impulse, or the one that keeps it."""
    x = interpreted(of_ball, [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], rule, law)
    assert_allclose(x, [pull, 0.0, 0.0], atol=1e-12)


def test_what_is_rough_stops_its_slip_without_a_push_only_where_that_is_asked() -> None:
    """Of a homogeneous ball m 2/7 of its slip: 1/m + r^2/I = 7/(2 m)."""
    rough = {"friction": {"type": "rough"}}
    lies = ([0.0, 0.5, 0.0], [0.0, 0.0, 0.0])
    x = interpreted(of_ball, *lies, {"stop": True}, rough)
    assert_allclose(np.abs(x[0]), 0.0, atol=1e-12)
    assert_allclose(np.hypot(*x[1:3]), 2.0 / 7.0 * 0.5, rtol=1e-12)
    assert_allclose(interpreted(of_ball, *lies, {}, rough), 0.0, atol=1e-12)
    strikes = interpreted(of_ball, [0.0, 0.5, -1.0], [0.0, 0.0, 0.0], {}, rough)
    assert_allclose(strikes[0], 1.0, rtol=1e-12)
    assert_allclose(np.hypot(*strikes[1:3]), 2.0 / 7.0 * 0.5, rtol=1e-12)


def test_resistance_to_turning_is_at_its_bound_while_it_turns() -> None:
    """Arms times the push, against the turning: the ball rolls about x and y and spins about z."""
    law = {"rolling_resistance": 1e-3, "spinning_resistance": 2e-3}
    x = interpreted(of_ball, [0.0, 0.0, -2.0], [-5.0, 9.0, 8.0], {}, law)
    assert_allclose(x[0], 2.0, rtol=1e-12)
    assert_allclose(np.abs(x[1:3]), 0.0, atol=1e-12)
    assert_allclose(np.hypot(*x[3:5]), 1e-3 * 2.0, rtol=1e-12)
    assert_allclose(x[5], -2e-3 * 2.0, rtol=1e-12)


@pytest.mark.parametrize("slip", [(0.6, 0.8), (-0.5, 0.0), (0.0, -0.7)])
def test_friction_without_a_corner_is_that_of_the_slip_before(slip: tuple[float, float]) -> None:
    """mu s / sqrt(s^2 + v0^2) of the push, against the slip."""
    law = {"friction": {"type": "regularised", "coefficient": 0.1, "speed": 0.5}}
    x = interpreted(of_ball, [*slip, -2.0], [0.0, 0.0, 0.0], {}, law)
    s = float(np.hypot(*slip))
    assert_allclose(x[0], 2.0, rtol=1e-12)
    assert_allclose(np.hypot(*x[1:3]), 2.0 * 0.1 * s / np.hypot(s, 0.5), rtol=1e-12)


WORKSPACE = SimpleNamespace(
    rules=np.array([PUSHES, RUBS, PUSHES, HOLDS, PUSHES]),
    least=np.array([0.0, 0.0, 1.0, 0.0, 0.0]),
    undetermined=np.zeros(7),
)
A = np.array([[2.0, 0.5, 0.0, 1.0, 0.0], *np.eye(5)[1:]])


def test_pushes_that_do_not_part_are_let_hold() -> None:
    """w = A x + b of 0, 1e-3, -1 and 1 times what is still, 1e-10 of 3 m/s."""
    workspace = SimpleNamespace(rules=WORKSPACE.rules.copy())
    x, pressing = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.full(5, 7.0)
    b = np.array([-7.0, -2.0, -3.0 + 2e-10, 0.0, -5.0 + 5e-10])
    system = SimpleNamespace(speed=3.0)
    assert rules.velocity_after(A, b, 0, x) == 0.0 and rules.velocity_after(A, b, 3, x) == 4.0
    assert rules.let_press_hold(system, workspace, A, b, x, pressing) == 2
    assert pressing.tolist() == [1.0, 0.0, 1.0, 0.0, 0.0]
    assert workspace.rules.tolist() == [HOLDS, RUBS, HOLDS, HOLDS, PUSHES]


def test_what_presses_may_not_have_to_pull() -> None:
    """No less than the least of each, but for 1e-12 of the largest impulse."""
    pressing = np.array([1.0, 0.0, 1.0, 0.0, 0.0])
    rest = [-8.0, 1.0, -5.0, -5.0]
    for push, other, keeps in ((0.0, 1.0, True), (-7e-12, 1.0, True), (-9e-12, 1.0, False),
                               (0.0, 1.0 - 7e-12, True), (0.0, 1.0 - 9e-12, False)):  # fmt: skip
        x = np.array([push, rest[0], other, *rest[2:]])
        assert rules.keeps_pushing(WORKSPACE, pressing, x) is keeps


def test_how_far_two_impulses_end_apart() -> None:
    """By 3 of terms up to 6, or nothing; the most of all impacts counts."""
    workspace = SimpleNamespace(undetermined=np.zeros(7))
    x, b, terms = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.arange(5.0), np.array([1, 6, 2, 3, 0.5])
    other = x + [1.0, 2.0, 0.0, 0.0, -1.0]
    rules.leave_open(workspace, A, b, terms, x, x)
    assert not workspace.undetermined.any()
    rules.leave_open(workspace, A, b, terms, x, other)
    assert workspace.undetermined[0] == pytest.approx(0.5)
    rules.leave_open(workspace, A, b, terms, x, x + 0.1 * (other - x))
    assert workspace.undetermined[0] == pytest.approx(0.5) and not workspace.undetermined[1:].any()


def test_the_least_push_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what presses; its line stands alone then, with nothing to answer."""
    asked = []
    monkeypatch.setattr(rules, "solve_in", lambda *problem: asked.append(problem) or 3)
    full = np.arange(25.0).reshape(5, 5) + 1.0
    x, b, pressing = np.array([3.0, -9.0, 2.0, 1.0, 4.0]), np.ones(5), np.array([1.0, 0, 1, 0, 1])
    assert (
        rules.without_least_push(WORKSPACE, 2, full, b, np.ones(5), pressing, x, np.zeros(5)) == 3
    )
    _, n, m, alone, rest, *_ = asked[0]
    wanted = full.copy()
    wanted[2], wanted[:, 2] = 0.0, 0.0
    wanted[2, 2] = 13.0
    assert (n, m) == (5, 2) and (alone == wanted).all() and rest.tolist() == [1, 1, 0, 1, 1]
    assert (full == np.arange(25.0).reshape(5, 5) + 1.0).all() and (b == 1.0).all()
