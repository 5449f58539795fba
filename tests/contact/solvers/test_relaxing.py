"""One contact of a heap with the others as they are: its laws hold at once, by their inequalities.

After it, w = J u - target (and what its support gives) is what each line has left.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.solvers.gauss_seidel import fill_block, is_plain, relax
from rb_sim.contact.solvers.graph import (
    BOUND,
    GIVE,
    LIGHT_A,
    LIGHT_B,
    LINES,
    PULLS,
    ROLLS,
    SPINS,
    TURN_A,
    TURN_B,
    VISCOUS,
    VISCOUS_PER_PUSH,
)
from tests.contact.solvers.problems import random_heap

SIZE = 0.3
"""Of the scene [m]."""


def heap(seed: int, **rules: float) -> tuple[Any, np.ndarray, np.ndarray]:
    """(graph, u, x): contacts with goals for all lines, which turn about their axes too."""
    rng = np.random.default_rng(100 + seed)
    graph, u = random_heap(seed)
    for i, (_, a) in enumerate(graph.ends):
        for p in range(3):  # of rolling and spinning: about both tangents and the normal
            k, of = LINES * i + 3 + p, LINES * i + (1, 2, 0)[p]
            axis = graph.rows[of, :3]
            graph.rows[k, 3:6] = axis
            graph.rows[k, TURN_B : TURN_B + 3] = axis / (0.4 / graph.rows[of, LIGHT_B])
            if a >= 0:
                graph.rows[k, 9:12] = -axis
                graph.rows[k, TURN_A : TURN_A + 3] = -axis / (0.4 / graph.rows[of, LIGHT_A])
    graph.targets[:] = 0.3 * rng.normal(size=len(graph.targets))
    for name, value in rules.items():
        graph.rules[:, COLUMNS[name]] = value
    for c in range(len(graph.ends)):
        fill_block(graph, c)
    x = np.abs(rng.normal(size=len(graph.targets))) * 0.1
    if rules.get("mu") == 0.0:  # what has no friction has no impulses of it
        x.reshape(-1, LINES)[:, 1:3] = 0.0
    return graph, u, x


COLUMNS = {"mu": BOUND, "give": GIVE, "per_push": VISCOUS_PER_PUSH, "viscous": VISCOUS,
           "pulls": PULLS, "rolls": ROLLS, "spins": SPINS}  # fmt: skip


def relaxed(seed: int, c: int, **rules: float) -> tuple[np.ndarray, np.ndarray]:
    """(impulses, what is left) of the six lines of a contact after it has been solved alone; what
    has changed is what was said, and was pushed into the bodies."""
    graph, u, x = heap(seed, **rules)
    before, start = x.copy(), u.copy()
    change = relax(graph, u, x, c, SIZE)
    own = slice(LINES * c, LINES * c + LINES)
    moved = x - before
    assert not np.delete(moved, np.arange(len(x))[own]).any()
    sizes = np.abs(moved[own]) / np.array([1.0] * 3 + [SIZE] * 3)
    assert change == pytest.approx(sizes.max(), rel=1e-12)
    b, a = graph.ends[c]
    pushed, rows = np.zeros_like(u), graph.rows[own]
    pushed[b, :3] = (rows[:, LIGHT_B] * moved[own]) @ rows[:, 0:3]
    pushed[b, 3:] = moved[own] @ rows[:, TURN_B : TURN_B + 3]
    if a >= 0:
        pushed[a, :3] = (rows[:, LIGHT_A] * moved[own]) @ rows[:, 6:9]
        pushed[a, 3:] = moved[own] @ rows[:, TURN_A : TURN_A + 3]
    assert_allclose(u - start, pushed, atol=1e-13)
    w = rows[:, 0:6] @ u[b] - graph.targets[own]
    w += rows[:, 6:12] @ u[a] if a >= 0 else 0.0
    return x[own], w


CASES = [(seed, c) for seed in (2, 3, 7) for c in range(0, 12, 2)]


def in_bound(x: np.ndarray, w: np.ndarray, most: float) -> None:
    """Of size `most` against what is left, or less where nothing is."""
    size = float(np.linalg.norm(x))
    assert size <= most * (1.0 + 1e-12) + 1e-14
    if size < most * (1.0 - 1e-9):
        assert_allclose(w, 0.0, atol=1e-11)
    else:
        assert float(x @ w) <= 1e-11
        assert abs(x[0] * w[-1] - x[-1] * w[0]) < 1e-10 or len(x) == 1


@pytest.mark.parametrize(("seed", "c"), CASES)
@pytest.mark.parametrize("give", [0.0, 0.4])
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_normal_and_friction_by_coulombs_law(seed: int, c: int, mu: float, give: float) -> None:
    """N >= 0, w + give N >= 0, N (w + give N) = 0; friction up to mu N, against the slip."""
    x, w = relaxed(seed, c, mu=mu, give=give)
    opens = w[0] + give * x[0]
    assert x[0] >= 0.0 and opens >= -1e-12 and abs(x[0] * opens) < 1e-12
    if mu > 0.0:
        in_bound(x[1:3], w[1:3], mu * x[0])


@pytest.mark.parametrize(("seed", "c"), CASES)
def test_what_may_pull_holds_both_ways(seed: int, c: int) -> None:
    """Normal first, then friction of the push that there is, of either sign."""
    graph, u, x = heap(seed, mu=0.3, pulls=1.0)
    first = graph.rows[LINES * c, :6] @ u[graph.ends[c, 0]] - graph.targets[LINES * c]
    first += graph.rows[LINES * c, 6:12] @ u[graph.ends[c, 1]] if graph.ends[c, 1] >= 0 else 0.0
    found, w = relaxed(seed, c, mu=0.3, pulls=1.0)
    assert_allclose(found[0], x[LINES * c] - first / graph.blocks[c, 0], rtol=1e-12)
    in_bound(found[1:3], w[1:3], 0.3 * abs(found[0]))


@pytest.mark.parametrize(("seed", "c"), CASES)
def test_drags_grow_with_the_slip(seed: int, c: int) -> None:
    """x = -(v_n N + v) w for a law without a corner; none where it gives nothing."""
    x, w = relaxed(seed, c, mu=-1.0, per_push=0.2, viscous=0.05)
    assert_allclose(x[1:3], -(0.2 * abs(x[0]) + 0.05) * w[1:3], rtol=1e-10, atol=1e-13)
    x, _ = relaxed(seed, c, mu=-1.0)
    assert not x[1:3].any()


@pytest.mark.parametrize(("seed", "c"), CASES)
def test_torques_up_to_their_arms(seed: int, c: int) -> None:
    x, w = relaxed(seed, c, mu=0.5, rolls=0.05, spins=0.02)
    in_bound(x[5:6], w[5:6], 0.02 * x[0])
    x, w = relaxed(seed, c, mu=0.5, rolls=0.05)
    in_bound(x[3:5], w[3:5], 0.05 * x[0])


def test_what_is_a_friction_problem_with_nothing_besides() -> None:
    assert is_plain(heap(2, mu=0.5)[0]) and is_plain(heap(2, mu=0.0, give=0.1)[0])
    for more in ({"pulls": 1.0}, {"rolls": 0.1}, {"spins": 0.1}, {"mu": -1.0}):
        assert not is_plain(heap(2, **{"mu": 0.5} | more)[0])
        graph = heap(2, mu=0.5)[0]
        (name,) = more
        graph.rules[7, COLUMNS[name]] = more[name]
        assert not is_plain(graph)
    graph = heap(2)[0]
    assert not is_plain(graph._replace(joint_rows=np.zeros((1, 20))))
