# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Complementarity with friction: the laws hold, and small problems agree with trying all modes."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.numerics.problems import Bounded, Normal, Solution, solved

SLACK = 1e-9


def contacts_of(
    rng: np.random.Generator, contacts: int, size: int = 3
) -> tuple[np.ndarray, np.ndarray]:
    """(G M^-1 G^T, G u) of random lines (n, t1, t2 or n, t) on two bodies (in space or plane)."""
    G = rng.normal(size=(contacts * size, 4 * size if size == 3 else 6))
    inverse = np.diag(rng.uniform(0.3, 3.0, G.shape[1]))
    return G @ inverse @ G.T, G @ rng.normal(size=G.shape[1])


def obeys(
    A: np.ndarray,
    b: np.ndarray,
    found: Solution,
    normals: list[Normal],
    bounded: list[Bounded],
) -> None:
    """The laws, line by line, to round-off."""
    x, w = found.x, found.w
    size = np.abs(x).max() + 1e-300
    rate = np.abs(b).max() + np.abs(A).max() * size
    assert_allclose(w, A @ x + b, atol=1e-14 * rate)
    taken = {item.line for item in normals} | {k for item in bounded for k in item.lines}
    for k in set(range(len(b))) - taken:
        assert abs(w[k]) <= SLACK * rate
    for item in normals:
        k = item.line
        if item.bilateral:
            assert abs(w[k]) <= SLACK * rate
        else:
            assert x[k] - item.least >= -SLACK * size
            assert w[k] >= -SLACK * rate
            assert abs((x[k] - item.least) * w[k]) <= SLACK * size * rate
    for item in bounded:
        k = list(item.lines)
        push = abs(x[item.normal])
        most = item.bound * push if push > SLACK * size else 0.0
        slip = float(np.linalg.norm(w[k]))
        assert np.linalg.norm(x[k]) <= most + SLACK * size
        if slip > 1e-6 * rate and math.isfinite(most):
            assert_allclose(x[k], -most * w[k] / slip, atol=1e-6 * size)
        if math.isinf(most):
            assert slip <= SLACK * rate


def all_modes(
    A: np.ndarray, b: np.ndarray, contacts: int, mu: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every solution of a planar problem (lines n, t of each contact): open, stuck, slips +-."""
    solutions = []
    for modes in itertools.product(("open", "stuck", 1.0, -1.0), repeat=contacts):
        n = len(b)
        E, r = np.zeros((n, n)), np.zeros(n)
        for c, mode in enumerate(modes):
            k, t = 2 * c, 2 * c + 1
            if mode == "open":
                E[k, k] = E[t, t] = 1.0
                continue
            E[k], r[k] = A[k], -b[k]
            if mode == "stuck":
                E[t], r[t] = A[t], -b[t]
            else:
                E[t, t], E[t, k] = 1.0, mode * mu
        if np.linalg.cond(E) > 1e12:
            continue
        x = np.linalg.solve(E, r)
        w = A @ x + b
        if all(fits(mode, x[2 * c :], w[2 * c :], mu) for c, mode in enumerate(modes)):
            solutions.append((x, w))
    return solutions


def fits(mode: object, x: np.ndarray, w: np.ndarray, mu: float) -> bool:
    if mode == "open":
        return bool(w[0] >= -1e-12)
    if mode == "stuck":
        return bool(x[0] >= -1e-12 and abs(x[1]) <= mu * x[0] + 1e-12)
    return bool(x[0] >= -1e-12 and mode * w[1] >= -1e-12)


@pytest.mark.parametrize("contacts", [1, 2, 3])
@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0])
def test_planar_problems_agree_with_trying_all_modes(contacts: int, mu: float) -> None:
    rng = np.random.default_rng(int(10 * mu) + contacts)
    for _ in range(30 // contacts):
        A, b = contacts_of(rng, contacts, 2)
        expected = all_modes(A, b, contacts, mu)
        normals = [Normal(2 * c) for c in range(contacts)]
        bounded = [Bounded((2 * c + 1,), 2 * c, mu) for c in range(contacts)]
        found = solved(A, b, normals, bounded)
        if not expected:
            continue  # Painleve: none to be found
        assert found is not None
        obeys(A, b, found, normals, bounded)
        nearest = min(np.abs(found.w - w).max() for _, w in expected)
        assert nearest <= 1e-9 * (1.0 + np.abs(b).max())


@pytest.mark.parametrize("contacts", [1, 2, 4, 8])
@pytest.mark.parametrize("seed", range(6))
def test_laws_hold_in_space(contacts: int, seed: int) -> None:
    """Also with far more contacts than the bodies have freedoms."""
    rng = np.random.default_rng(seed)
    A, b = contacts_of(rng, contacts)
    normals = [Normal(3 * c) for c in range(contacts)]
    bounded = [Bounded((3 * c + 1, 3 * c + 2), 3 * c, 0.4) for c in range(contacts)]
    found = solved(A, b, normals, bounded)
    assert found is not None
    obeys(A, b, found, normals, bounded)


def box_on_corners(mu: float, pull: float) -> tuple[np.ndarray, np.ndarray, list, list]:
    """A unit cube of mass 1 on 4 corners, pulled sideways at its base: lines and rates of u."""
    G = []
    for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        r = 0.5 * np.array([x, y, -1.0])
        G += [np.concatenate([d, np.cross(r, d)]) for d in np.eye(3)[[2, 0, 1]]]
    G = np.array(G)
    inverse = np.diag([1.0] * 3 + [6.0] * 3)
    load = np.array([pull, 0.0, -10.0, 0.0, -0.5 * pull, 0.0])
    normals = [Normal(3 * c) for c in range(4)]
    bounded = [Bounded((3 * c + 1, 3 * c + 2), 3 * c, mu) for c in range(4)]
    return G @ inverse @ G.T, G @ inverse @ load, normals, bounded


@pytest.mark.parametrize(("pull", "rate"), [(0.0, 0.0), (3.9, 0.0), (6.0, 2.0)])
def test_redundant_contacts(pull: float, rate: float) -> None:
    """A box on 4 corners: the shares are not determined, the sum and the motion are."""
    A, b, normals, bounded = box_on_corners(0.4, pull)
    found = solved(A, b, normals, bounded)
    assert found is not None
    obeys(A, b, found, normals, bounded)
    assert_allclose(found.x[0::3].sum(), 10.0, atol=1e-9)
    assert_allclose(found.x[1::3].sum(), -min(pull, 4.0), atol=1e-9)
    assert_allclose(found.w[1::3], rate, atol=1e-9)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("mass", [1e-18, 1.0, 1e18])
def test_lines_of_turns_beside_lines_of_places(size: float, mass: float) -> None:
    """A block that may not turn, under a slanted force within its friction: lines of torque give
    way by 1/I, those of force by 1/m, and what holds in SI holds at every size."""
    push, across, bound = 7.0, 2.0, 0.3
    G = np.zeros((6, 6))
    G[:3, 3:] = np.eye(3)  # no turn
    arm = np.array([0.0, 0.0, -0.5 * size])
    for k, d in enumerate(np.eye(3)[[2, 0, 1]]):
        G[3 + k] = [*d, *np.cross(arm, d)]
    inverse = np.diag([1.0] * 3 + [1.0 / size**2] * 3) / mass
    load = mass * np.array([across, 0.0, -push, 0.0, 0.0, 0.0])
    found = solved(G @ inverse @ G.T, G @ inverse @ load, [Normal(3)], [Bounded((4, 5), 3, bound)])
    assert found is not None
    assert_allclose(found.x[3:] / mass, [push, -across, 0.0], atol=1e-12)
    assert_allclose(found.x[:3] / (mass * size), [0.0, -0.5 * across, 0.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_rough(seed: int) -> None:
    """It holds, it opens, or it would have to pull: only then there is no solution."""
    A, b = contacts_of(np.random.default_rng(seed), 1)
    held = -np.linalg.solve(A, b)
    found = solved(A, b, [Normal(0)], [Bounded((1, 2), 0, math.inf)])
    if held[0] >= 0.0:
        assert found is not None
        assert_allclose(found.x, held, atol=1e-10 * np.abs(held).max())
    elif b[0] >= 0.0:
        assert found is not None
        assert_allclose(found.x, 0.0, atol=1e-10)
    else:
        assert found is None


def test_points_that_contradict_each_other_by_rounding() -> None:
    """A rod that lies on both ends, whose velocities along itself differ in the last digits."""
    r = np.array([[0.2, 0.0, 0.0], [-0.2, 1e-11, 1e-11]])
    G = np.array([np.concatenate([d, np.cross(p, d)]) for p in r for d in np.eye(3)[[2, 0, 1]]])
    inverse = np.diag([1.0, 1.0, 1.0, 1000.0, 100.0, 100.0])
    A, u = G @ inverse @ G.T, np.array([0.0, 1e-9, -1e-5, 1e-7, 1e-4, 2e-4])
    b = G @ u + 1e-17 * np.array([1.0, -2.0, 3.0, -1.0, 2.0, 1.0])
    normals = [Normal(0), Normal(3)]
    bounded = [Bounded((1, 2), 0, 0.3), Bounded((4, 5), 3, 0.3)]
    found = solved(A, b, normals, bounded)
    assert found is not None
    obeys(A, b, found, normals, bounded)


def test_one_ball_on_the_floor() -> None:
    """Closed forms: rests, sticks, slips, leaves."""
    lines, friction = [Normal(0)], [Bounded((1, 2), 0, 0.5)]
    for b, x in (
        ((-9.81, 0.0, 0.0), (9.81, 0.0, 0.0)),
        ((-9.81, 3.0, -3.0), (9.81, -3.0, 3.0)),
        ((-10.0, 6.0, 8.0), (10.0, -3.0, -4.0)),
        ((1.0, 6.0, 8.0), (0.0, 0.0, 0.0)),
    ):
        found = solved(np.eye(3), np.array(b), lines, friction)
        assert found is not None
        assert_allclose(found.x, x, atol=1e-11)


def rubbing_under_given_pushes(seed: int) -> tuple[np.ndarray, np.ndarray, list, list]:
    """One body or two that rub at up to six points, scattered, in a line or on four corners, whose
    pushes over six decades are given: lines along two tangents of each point, and one that always
    has its push."""
    rng = np.random.default_rng([5, seed])
    points, bodies = int(rng.integers(1, 7)), int(rng.integers(1, 3))
    mobility = np.zeros((12, 12))
    for i in range(0, 6 * bodies, 6):
        mobility[i : i + 3, i : i + 3] = np.eye(3) / 10 ** rng.uniform(-1, 1)
        a = rng.normal(size=(3, 3))
        inertia = np.diag([1.0, 1.0, 1e-3]) if rng.random() < 0.3 else a @ a.T + 0.05 * np.eye(3)
        mobility[i + 3 : i + 6, i + 3 : i + 6] = np.linalg.inv(inertia) * 10 ** rng.uniform(0, 3)
    rows, pushes, kind = [], [], rng.integers(0, 3)
    for c in range(points):
        p = rng.normal(size=3) * 0.2
        normal = np.array([0.0, 0.0, 1.0]) if kind else rng.normal(size=3)
        if kind == 1:
            p = np.array([0.2 * (c - 0.5), 0.0, 0.0])
        if kind == 2:
            p = np.array([0.1 * (-1) ** c, 0.1 * (-1) ** (c // 2), -0.1])
        first = np.cross(normal, [1.0, 0.0, 0.0])
        for d in (first / np.linalg.norm(first), np.cross(normal, first / np.linalg.norm(first))):
            rng.integers(bodies)
            rows.append([*d, *np.cross(p, d), *-d, *-np.cross(p + [0.0, 0.0, 0.1], d)])
        pushes.append(10 ** rng.uniform(-4, 2))
    J, n = np.array(rows), 2 * points
    loads = J[:, : 6 * bodies] @ rng.normal(size=6 * bodies) * 10 ** rng.uniform(-2, 2)
    A = np.eye(n + points)
    A[:n, :n] = J @ mobility @ J.T
    normals = [Normal(n + i, True) for i in range(points)]
    bounded = [
        Bounded((2 * i, 2 * i + 1), n + i, float(rng.uniform(0.05, 1.0))) for i in range(points)
    ]
    return A, np.concatenate([loads, -np.array(pushes)]), normals, bounded


@pytest.mark.parametrize("seed", [*range(8), 883])
def test_friction_under_given_pushes_always_has_forces(seed: int) -> None:
    """It is the least of a convex function within the bounds; on problem 883 Newton's method alone
    ends at none of its starts."""
    A, b, normals, bounded = rubbing_under_given_pushes(seed)
    found = solved(A, b, normals, bounded)
    assert found is not None
    obeys(A, b, found, normals, bounded)


@pytest.mark.parametrize("seed", [53, 118, 166, 231])
def test_a_rod_that_hardly_resists_turning_about_itself_lands(seed: int) -> None:
    """Rolling and spinning friction act on moments of inertia eight decades apart; Newton's method
    alone ends at none of its starts."""
    rng = np.random.default_rng([7, seed])
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    along, inverse = np.outer(axis, axis), np.eye(6)
    inverse[3:, 3:] = 100.0 * (np.eye(3) - along) + 1e7 * along
    r = -0.15 * np.sign(axis[2]) * axis
    x, y, z = np.eye(3)
    turning = [np.concatenate([np.zeros(3), d]) for d in (x, y, z)]
    G = np.array([np.concatenate([z, np.cross(r, z)]), *turning])
    A = G @ inverse @ G.T
    b = G @ np.concatenate([rng.normal(size=3) - 3.0 * z, 20.0 * rng.normal(size=3)])
    normals, bounded = [Normal(0)], [Bounded((1, 2), 0, 0.004), Bounded((3,), 0, 0.0036)]
    found = solved(A, b, normals, bounded)
    assert found is not None
    obeys(A, b, found, normals, bounded)


# Problems between lines and laws do not depend on the units of the lines.


MU = 0.4


def two_contacts(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(A, b) of lines n, t1, t2 of two contacts of a body; one solution, as A is positive definite
    and friction is little."""
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(6, 6)) + 2.0 * np.eye(6)
    return G @ np.diag(rng.uniform(0.5, 2.0, 6)) @ G.T, 3.0 * rng.normal(size=6)


@pytest.mark.parametrize("unit", [1e-8, 1e-3, 3.0, 1e7])
@pytest.mark.parametrize("second", [False, True])
def test_units_of_a_contact_scale_its_forces(unit: float, second: bool) -> None:
    """Lines in other units: A by both, b by one; the least pushes with them."""
    A, b = two_contacts(11)
    scale = np.ones(6)
    scale[3 if second else 0 :] = unit
    x = forces_in(A, b, np.ones(6))
    assert_allclose(forces_in(A, b, scale) * scale, x, rtol=1e-7, atol=1e-9)


def forces_in(A: np.ndarray, b: np.ndarray, scale: np.ndarray) -> np.ndarray:
    normals = [Normal(k, least=0.1 / scale[k]) for k in (0, 3)]
    bounded = [Bounded((k + 1, k + 2), k, MU) for k in (0, 3)]
    found = solved(A * np.outer(scale, scale), b * scale, normals, bounded)
    assert found is not None
    return found.x
