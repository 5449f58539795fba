# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which lines depend on others, on closed chains of hinges with parallel axes in a tilted plane.

Such a chain has three lines more than its motion needs: a force along the axes, and two torques
across them. In a tilted plane they lie along no axis of the world, so that each line has its share.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim import Simulation
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.systems import elimination as independent
from rb_sim.mechanics.systems.elimination import (
    SURE,
    Factors,
    constraint_matrix,
    factored,
    with_object_tables,
)
from rb_sim.mechanics.systems.multibody import write_rows
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.initial import jacobian
from rb_sim.scene.load import scene_from_mapping

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
@pytest.mark.parametrize("seed", range(24))
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
            watched=False
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


@pytest.mark.parametrize("seed", range(6))
def test_the_rank_as_a_whole_does_not_hang_on_the_sizes_of_lines(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """G of rank 5 in 8 lines of very different sizes; numbers that are none and too many lines tell
    nothing."""
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-4.0, 4.0, 8)
    G = rng.normal(size=(8, 5)) @ rng.normal(size=(5, 12))
    G /= np.linalg.norm(G, axis=1, keepdims=True)
    monkeypatch.setattr(independent, "dense_matrix", lambda system, order: order[0])

    def rank(matrix: Any, lines: int = 8) -> int:
        return independent.rank_as_a_whole(None, [matrix] * lines, 77)  # type: ignore[arg-type]

    assert rank(np.outer(sizes, sizes) * (G @ G.T)) == 5
    assert rank(np.diag([1.0, np.nan])) == 77 and rank(np.eye(2)) == 2
    assert rank(np.eye(2), independent.MOST + 1) == 77
