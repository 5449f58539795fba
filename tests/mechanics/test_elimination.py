# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The sparse elimination: its threshold, which lines it leaves out, multipliers of least norm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim import Simulation
from rb_sim.compiler.graph.machine import compile_law, evaluate
from rb_sim.compiler.graph.symbols import Graph
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.systems.elimination import (
    SURE,
    Factors,
    changes_of_least_norm,
    constraint_matrix,
    factored,
    least_norm,
    with_object_tables,
)
from rb_sim.mechanics.systems.multibody import write_rows
from rb_sim.numerics.rank import RANK_TOLERANCE
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.initial import jacobian
from rb_sim.scene.load import scene_from_mapping
from tests.interpreted import interpreted
from tests.moving import difference


def test_what_lies_on_either_side_of_the_threshold() -> None:
    """A pivot relative to the diagonal element, or to the scale that is given for it."""
    for share, rank in ((0.5 * RANK_TOLERANCE, 1.0), (2.0 * RANK_TOLERANCE, 2.0)):
        for size in (1e-6, 1e6):
            matrix = {0: {0: 1.0, 1: size}, 1: {0: size, 1: size**2 * (1.0 + share)}}
            assert Factors(matrix, [0, 1]).rank == rank
    for smallest, rank in ((0.3, 2.0), (0.6, 1.0)):
        matrix = {0: {0: 4.0, 1: 2.0}, 1: {0: 2.0, 1: 2.0}}
        assert Factors(matrix, [0, 1], smallest).rank == rank
    for scale, rank in ((1.0, 2.0), (1e12, 1.0)):
        assert Factors({0: {0: 2.0}, 1: {1: 3.0}}, [0, 1], scales={1: scale}).rank == rank


# Which lines depend on others, on closed chains of hinges with parallel axes in a tilted plane.
#
# Such a chain has three lines more than its motion needs: a force along the axes, and two torques
# across them. In a tilted plane they lie along no axis of the world, so that each line has its
# share.


GROUND = ""


def hinge(places: dict[str, Any], at: np.ndarray, axis: np.ndarray, on: str, parent: str) -> dict:
    where, turned = places[on]
    own: dict[str, Any] = {
        "type": "fixed_axis",
        "body": on,
        "point_B": turned.inv().apply(at - where).tolist(),
        "axis_B": turned.inv().apply(axis).tolist(),
        "bearing_distance": 0.3,
    }
    return own if parent == GROUND else own | {"parent": parent}


def closed_chain(seed: int, turned_round: bool = False, **run: Any) -> dict[str, Any]:
    """Three to five links in a plane, ground at both ends; turned_round: joints in reverse."""
    rng = np.random.default_rng(seed)
    plane = Rotation.random(random_state=seed)
    links = 3 + seed % 3
    steps = np.cumsum(rng.uniform(-1.2, 1.2, links))
    flat = np.cumsum(rng.uniform(0.4, 1.3, links) * [np.cos(steps), np.sin(steps)], axis=1)
    flat = np.hstack([np.zeros((2, 1)), flat])
    ends = plane.apply(np.column_stack([*flat, rng.uniform(-0.1, 0.1, links + 1)]))
    places, bodies = {}, {}
    for i in range(links):
        name, mass = f"link{i}", rng.uniform(0.3, 3.0)
        places[name] = 0.5 * (ends[i] + ends[i + 1]), Rotation.from_rotvec(rng.normal(size=3))
        bodies[name] = {
            "mass": mass,
            "inertia": (mass * rng.uniform(0.04, 0.06, 3)).tolist(),
            "position": places[name][0].tolist(),
            "orientation": places[name][1].as_quat().tolist(),
            "angular_velocity": places[name][1].inv().apply(plane.apply([0, 0, 1.0])).tolist(),
        }
    axis = plane.apply([0.0, 0.0, 1.0])
    names = [GROUND, *bodies]
    joints = {
        f"pin{i}": hinge(places, ends[i], axis, names[i + 1], names[i]) for i in range(links)
    } | {"last": hinge(places, ends[-1], axis, names[-1], GROUND)}
    return {
        "bodies": bodies,
        "constraints": dict(reversed(joints.items())) if turned_round else joints,
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"project_initial": True} | run,
    }


@pytest.mark.parametrize("turned_round", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_the_lines_left_are_as_many_as_the_rank_and_well_conditioned(
    seed: int, turned_round: bool
) -> None:
    """The rank beside numpy's of G itself, whose small singular values A has squared."""
    compiled = compile_scene(scene_from_mapping(closed_chain(seed, turned_round)))
    system = with_object_tables(compiled.system)
    write_rows(system, 0.0, compiled.y.tolist())
    order = MultiBodyLaws(compiled.system, 0, redundant=True).order
    G = jacobian(system._replace(rows=system.rows.astype(float)))
    rank = np.linalg.matrix_rank(G / np.linalg.norm(G, axis=1, keepdims=True), 1e-6)
    assert rank == len(order) - 3
    found = list(factored(system, order).kept)
    assert len(found) == rank
    assert compiled.degrees_of_freedom == 6 * len(compiled.layout.bodies) - rank
    assert min(Factors(constraint_matrix(system, found), found).shares.values()) > SURE


def test_reactions_of_least_norm_do_not_hang_on_the_order_of_the_joints() -> None:
    """They did by twice their size where round-off was taken for a pivot."""
    runs = [
        Simulation(scene_from_mapping(closed_chain(SHAKEN, turned_round, duration=0.5))).run(
            checks=False
        )
        for turned_round in (False, True)
    ]
    for name, reaction in runs[0].reaction.items():
        largest = np.abs(reaction.force).max()
        np.testing.assert_allclose(
            runs[1].reaction[name].force, reaction.force, rtol=0.0, atol=1e-6 * largest
        )


SHAKEN = 3
"""Seed of a chain that showed it."""


# How multipliers of least norm change, beside differences of what they are.


def by_law(matrix: np.ndarray, x: np.ndarray, rank: int) -> np.ndarray:
    """The multipliers of least norm as laws call for them."""
    n = len(x)
    given = list(Graph().vector("y", n * n + n))
    law = compile_law(list(least_norm(given[: n * n], given[n * n :], float(rank))))
    found = np.zeros(n)
    evaluate(law, 0.0, np.concatenate([matrix.ravel(), x]), np.zeros(1), found)
    return found


def change_by_law(rank: int, *numbers: np.ndarray) -> np.ndarray:
    """How they change: of A, x, dA and dx."""
    n = len(numbers[1])
    half = n * n + n
    given = list(Graph().vector("y", 2 * half))
    now, change = [float(n), float(rank), *given[:half]], [0.0, 0.0, *given[half:]]
    law = compile_law(list(changes_of_least_norm(*now, *change)))
    found = np.zeros(n)
    evaluate(law, 0.0, np.concatenate([a.ravel() for a in numbers]), np.zeros(1), found)
    return found


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize(("n", "rank"), [(1, 1), (5, 3), (9, 9), (20, 17)])
def test_laws_call_for_the_same(n: int, rank: int, plain: bool) -> None:
    """Compiled and as Python: the part of x in the span of the lines, and its change."""
    rng = np.random.default_rng(n)
    G, turned = rng.normal(size=(2, n, rank))
    x, slope = rng.normal(size=(2, n))

    def expected(t: float) -> np.ndarray:
        across = np.linalg.qr(G + t * turned)[0]
        return across @ (across.T @ (x + t * slope))

    matrix, d_matrix = G @ G.T, turned @ G.T + G @ turned.T
    own = interpreted(by_law, matrix, x, rank) if plain else by_law(matrix, x, rank)
    np.testing.assert_allclose(own, expected(0.0), atol=1e-11)
    given = rank, matrix, x, d_matrix, slope
    own = interpreted(change_by_law, *given) if plain else change_by_law(*given)
    wanted = difference(expected)
    np.testing.assert_allclose(own, wanted, atol=1e-7 * (1.0 + np.abs(wanted).max()))


@pytest.mark.parametrize("plain", [False, True])
def test_what_is_not_finite_stays_so(plain: bool) -> None:
    """As Python; compiled it is no number either."""
    x = np.array([1.0, np.nan, 0.0])
    own = interpreted(by_law, np.eye(3), x, 2) if plain else by_law(np.eye(3), x, 2)
    assert np.isnan(own).any()
    given = 2, np.eye(3), x, np.eye(3), np.ones(3)
    own = interpreted(change_by_law, *given) if plain else change_by_law(*given)
    assert np.isnan(own).any()
