"""A body with many joints stays an unknown: the laws are the same, and grow with the joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.many_body_scenes import star
from rb_sim.graph.machine import evaluate
from rb_sim.graph.symbols import operations
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping


def held(arms: int) -> dict[str, Any]:
    """A star that hangs on the world by its hub, whose axes of inertia are not the body's."""
    scene = star(arms)
    scene["bodies"]["hub"]["inertia"] = [[0.5, 0.05, -0.02], [0.05, 0.6, 0.03], [-0.02, 0.03, 0.7]]
    scene["constraints"]["ground"] = {"type": "fixed_point", "body": "hub", "point_B": [0, 0, 0.1]}
    return scene


def driven(arms: int) -> dict[str, Any]:
    """A star whose hub has a blade, a line that is not holonomic."""
    scene = star(arms)
    blade = {"type": "velocity", "body": "hub", "linear": [0.0, 1.0, 0.0]}
    scene["constraints"]["blade"] = blade
    return scene


def laws_of(scene: dict[str, Any], hubs: bool = True) -> tuple[MultiBodyLaws, np.ndarray]:
    """The traced laws, with or without hubs, and a state off the manifold."""
    compiled = compile_scene(scene_from_mapping(scene))
    width = compiled.laws_with(()).width
    laws = MultiBodyLaws(compiled.system, width, compiled.redundant, (), compiled.dependent)
    if not hubs:
        laws.__dict__["plan"] = None
    return laws, compiled.y + 1e-3 * np.random.default_rng(1).normal(size=len(compiled.y))


@pytest.mark.parametrize("scene", [star, held, driven])
def test_laws_with_hubs_are_those_without(scene):
    laws, y = laws_of(scene(5))
    plain, _ = laws_of(scene(5), hubs=False)
    assert laws.plan is not None
    assert laws.plan.hubs == {0}
    n = laws.n
    counts = {"rate": n, "velocity": n}
    counts |= {"back": n + 1} if all(laws.holonomic) else {"position": n}
    inputs = np.array([*laws.inputs.values(laws.system, 0.3), 0.0])
    for name, count in counts.items():
        found, expected = np.zeros(count), np.zeros(count)
        evaluate(getattr(laws, name), 0.3, y, inputs, found)
        evaluate(getattr(plain, name), 0.3, y, inputs, expected)
        size = abs(expected).max()
        assert size > 0.0
        assert_allclose(found, expected, atol=1e-12 * size, rtol=0.0, err_msg=name)


def test_the_laws_of_a_star_grow_with_its_arms():
    sizes = []
    for arms in (8, 16):
        laws, _ = laws_of(star(arms))
        sizes.append(operations(laws.outputs(laws.slopes)))
    assert sizes[1] < 2.2 * sizes[0]
