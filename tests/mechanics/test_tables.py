# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws over tables are the traced laws: on trees, loops, hubs, redundant and driven joints."""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.many_body_scenes import chain, lattice, rods, star
from rb_sim.graph import machine
from rb_sim.graph.symbols import operations
from rb_sim.mechanics.blocks import Node, planned
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.table_laws import BODIES, TableLaws
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.interpreted import interpreted

POINTER = ctypes.POINTER(ctypes.c_double)
LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)


def outputs(law: Any, t: float, y: np.ndarray, p: np.ndarray, count: int) -> np.ndarray:
    """The law's numbers; through its address if it has one."""
    out = np.zeros(count)
    if machine.interpreted():
        law(t, y, p, out)
    else:
        LAW(law.address)(t, *(a.ctypes.data_as(POINTER) for a in (y, p, out)))
    return out


def hinged() -> dict[str, Any]:
    """Four links on parallel hinges, the last one to the ground: a loop with redundant lines."""
    scene = chain(4)
    places = ([0, 0, 0.5], [0.5, 0, 1.0], [1.0, 0, 0.5], [1.0, 0.0, 0.0])
    ends = ([0, 0, -0.5], [-0.5, 0, 0], [0, 0, 0.5], [0, 0, 0.0])
    outer = (None, [0, 0, 0.5], [0.5, 0, 0], [0, 0, -0.5])
    for i, (place, end, far) in enumerate(zip(places, ends, outer, strict=True)):
        scene["bodies"][f"b{i}"]["position"] = place
        joint = {"type": "fixed_axis", "body": f"b{i}", "point_B": end, "axis_B": [0, 1, 0]}
        joint["bearing_distance"] = 0.2
        if i:
            joint |= {"parent": f"b{i - 1}", "point_A": far, "axis_A": [0, 1, 0]}
        scene["constraints"][f"j{i}"] = joint
    scene["constraints"]["ground"] = {"type": "fixed_point", "body": "b3", "point_B": [0, 0, 0]}
    return scene


def driven() -> dict[str, Any]:
    """Every way in which something changes between steps, a rolling drive, and free spins."""
    scene = chain(3)
    scene["bodies"]["free"] = {
        "mass": 2.0,
        "inertia": [0.3, 0.2, 0.1],
        "position": [0, 0, 5],
        "angular_velocity": [0.1, 2.0, 0.1],
    }
    scene["effects"] |= {
        "by_hand": {"type": "commanded_wrench", "body": "b1"},
        "table": {
            "type": "wrench_table",
            "body": "b2",
            "times": [0.0, 1.0],
            "forces": [[1.0, 0.5, 0.0], [0.0, 2.0, 1.0]],
            "interpolation": "linear",
        },
        "spring": {
            "type": "spring",
            "body": "b2",
            "parent": "b0",
            "stiffness": 30.0,
            "rest_length": 0.9,
        },
    }
    return scene


def compared(mapping: dict[str, Any]) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """What both give, law by law, at a state off the manifold."""
    compiled = compile_scene(scene_from_mapping(mapping))
    system, width = compiled.system, compiled.laws_with(()).width
    whole = MultiBodyLaws(system, width, compiled.redundant, (), compiled.dependent)
    whole.__dict__["plan"] = None  # the elimination without hubs, which is another one
    tables = TableLaws(system, width, compiled.redundant, (), compiled.dependent)
    y = compiled.y + 1e-3 * np.random.default_rng(1).normal(size=len(compiled.y))
    p = np.array([*whole.inputs.values(system, 0.3), 0.0])
    n = len(y)
    counts = {"project": n, "rate": n, "gap": 1, "position": n, "velocity": n, "sample": width}
    counts["back"] = n + 1
    made = []
    for name, count in counts.items():
        if getattr(whole, name) is None:
            assert getattr(tables, name) is None
            continue
        expected = outputs(getattr(whole, name), 0.3, y, p, count)
        made.append((name, expected, outputs(getattr(tables, name), 0.3, y, p, count)))
    return made


CASES = {
    "chain": lambda: chain(4),
    "star on a hub": lambda: star(6),
    "rods": lambda: rods(3),
    "springs": lambda: lattice(2),
    "redundant loop": hinged,
    "driven": driven,
}


def test_interpreted_laws_over_tables_are_the_compiled_ones():
    for (law, _, compiled), (_, _, plain) in zip(
        compared(CASES["star on a hub"]()),
        interpreted(compared, CASES["star on a hub"]()),
        strict=True,
    ):
        assert_allclose(plain, compiled, atol=1e-12, err_msg=law)


def test_the_laws_of_a_star_grow_with_its_arms():
    sizes = []
    for arms in (8, 16):
        compiled = compile_scene(scene_from_mapping(star(arms)))
        laws = MultiBodyLaws(compiled.system, 0, compiled.redundant, (), compiled.dependent)
        sizes.append(operations(laws.outputs(laws.slopes)))
    assert sizes[1] < 2.2 * sizes[0]


def test_the_elimination_of_a_chain_meets_one_neighbour_a_link():
    plan = planned([Node(i, i - 1, (i,), 3) for i in range(50)], frozenset())
    assert max(map(len, plan.later)) == 1


def test_a_star_swings_as_its_arms_alone_would_on_a_heavy_hub():
    """A hub a thousand million times as heavy does not move: each arm is a pendulum of its own."""
    from rb_sim import Simulation

    scene = star(BODIES)
    scene["bodies"]["hub"] |= {"mass": 1e9, "inertia": [1e9, 1e9, 1e9]}
    scene["effects"] = {
        "g": {
            "type": "gravity",
            "bodies": [f"a{i}" for i in range(BODIES)],
            "acceleration": [0.0, 0.0, -9.81],
        }
    }
    run = Simulation(scene_from_mapping(scene)).run(watched=False)
    heights = run.block.position[-1, 1:, 2]
    assert_allclose(heights, heights[0], atol=1e-7)
    moment, length = 0.09 + 0.25, 0.5
    period = 2.0 * math.pi * math.sqrt(moment / (9.81 * length))
    assert heights[0] == pytest.approx(-0.5 * math.sin(angle_from_level(0.2, period)), abs=1e-6)


def angle_from_level(t: float, period: float) -> float:
    """Angle through which a pendulum released level has turned at t, by its elliptic integral."""
    from scipy.special import ellipj, ellipk

    k = math.sin(math.pi / 4)
    sn = float(ellipj(float(ellipk(k * k)) - 2.0 * math.pi * t / period, k * k)[0])
    return math.pi / 2 - 2.0 * math.asin(k * sn)
