# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Stiff scenes: implicit methods by Newton's method with the exact Jacobian of the laws."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

G = 9.81


def point(stiffness: float, damping: float, **options: Any) -> dict[str, Any]:
    """A ball below a spring of rest length 0.5, 0.1 mm longer than that, at rest."""
    spring = {"stiffness": stiffness, "damping": damping, "rest_length": 0.5}
    body = {
        "mass": 1.0,
        "shape": {"type": "sphere", "radius": 0.1},
        "position": [0.0, 0.0, -0.5001],
    }
    return {
        "bodies": {"ball": body},
        "effects": {
            "weight": {"type": "gravity"},
            "spring": {"type": "spring", "body": "ball"} | spring,
        },
        "simulation": {"rate": 100, "duration": 0.2} | options,
    }


def run(scene: dict[str, Any], coordinates: str = "auto") -> Any:
    from rb_sim import Simulation, load_scene

    simulation = Simulation(load_scene(scene), coordinates=coordinates)
    return simulation.run(checks=False), simulation.steps


def last(scene: dict[str, Any], coordinates: str = "auto") -> tuple[np.ndarray, int]:
    """(position and velocity of the first body at the end, steps)."""
    found, steps = run(scene, coordinates)
    block = found.block
    return np.concatenate([block.position[-1, 0], block.linear_velocity[-1, 0]]), steps


STEPS = {
    "gauss6": ({"method": "gauss6", "step": 1e-3}, 1e-6),
    "radau5": ({"method": "radau5", "step": 1e-3}, 1e-12),
    "adaptive radau5": ({"method": "radau5", "tolerance": 1e-6}, 1e-9),
}
"""Options, and how near the ball is to rest after 0.2 s [m]."""


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize("how", list(STEPS))
@pytest.mark.parametrize("stiffness", [1e8, 1e10, 1e12])
def test_a_stiff_damped_spring_is_at_rest_where_its_force_is_the_weight(
    stiffness: float, how: str, coordinates: str
) -> None:
    """After the fast motion has died out: 0.5 + m g / k, whatever the step.

    Gauss6 is not L-stable: it turns the sign of the fastest part and takes long to damp it.
    """
    options, near = STEPS[how]
    found, steps = last(point(stiffness, 1e6, **options), coordinates)
    assert found[2] == pytest.approx(-0.5 - G / stiffness, abs=near)
    if how == "radau5":
        assert np.abs(found[3:]).max() < 1e-9
    if how == "adaptive radau5":
        assert steps < 200


def test_gauss6_keeps_the_energy_of_a_stiff_spring() -> None:
    """Steps of ten radians of its oscillation: 1e8 N/m and 1 kg at 1 ms."""
    found, _ = run(point(1e8, 0.0, method="gauss6", step=1e-3))
    assert np.ptp(found.energy) < 1e-9 * 0.5  # half a joule in the spring


def test_radau5_damps_what_its_step_does_not_resolve() -> None:
    """L-stable: the oscillation of 1e12 N/m is gone after a few steps of 1 ms."""
    found, _ = last(point(1e12, 0.0, method="radau5", step=1e-3))
    assert found[2] == pytest.approx(-0.5 - G / 1e12, abs=1e-13)


def links(ratio: float, **options: Any) -> dict[str, Any]:
    """A double pendulum whose lower bar has `ratio` times the mass of the upper one."""
    bodies, constraints = {}, {}
    for i, (name, mass) in enumerate((("upper", 1.0), ("lower", ratio))):
        inertia = [1e-2 * mass, 0.09 * mass, 0.08 * mass]
        bodies[name] = {"mass": mass, "inertia": inertia, "position": [0.5 + i, 0.0, 0.0]}
        constraints[f"joint_{i}"] = {
            "type": "fixed_point",
            "body": name,
            "point_B": [-0.5, 0.0, 0.0],
        }
    constraints["joint_1"] |= {"parent": "upper", "point_A": [0.5, 0.0, 0.0]}
    return {
        "bodies": bodies,
        "constraints": constraints,
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"rate": 100, "duration": 0.2} | options,
    }


@pytest.mark.parametrize("ratio", [1e-6, 1e6])
def test_methods_agree_on_a_mass_ratio_of_a_million(ratio: float) -> None:
    """Motion and reactions of three methods that share neither coefficients nor idea."""
    exact = run(links(ratio, method="dopri853", tolerance=1e-11))[0].block
    size = np.abs(exact.reaction_force).max()
    for options in ({"method": "radau5", "tolerance": 1e-8}, {"method": "gauss6", "step": 4e-3}):
        found = run(links(ratio, **options))[0].block
        assert np.abs(found.position - exact.position).max() < 1e-9
        assert np.abs(found.reaction_force - exact.reaction_force).max() < 1e-7 * size


def decay(h: float, rate: float) -> float:
    """Radau IIA's own factor over a step for y' = - rate y, z = - rate h."""
    z = -rate * h
    return (1.0 + 2.0 * z / 5.0 + z * z / 20.0) / (
        1.0 - 3.0 * z / 5.0 + 3.0 * z * z / 20.0 - z**3 / 60.0
    )


@pytest.mark.parametrize("drag", [0.5, 50.0, 5e5])
def test_radau5_multiplies_a_decay_by_its_stability_function(drag: float) -> None:
    """R(z) of Hairer & Wanner II, table IV.3.2: the coefficients, and a Newton that converged."""
    ball = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "linear_velocity": [1.0, 0.0, 0.0]}
    scene = {
        "bodies": {"ball": ball},
        "effects": {"drag": {"type": "linear_drag", "body": "ball", "coefficient": drag}},
        "simulation": {"method": "radau5", "step": 0.01, "duration": 0.01},
    }
    found, steps = last(scene)
    assert steps == 1
    assert found[3] == pytest.approx(decay(0.01, drag), rel=1e-12, abs=1e-15)
    assert math.isclose(found[0], (1.0 - found[3]) / drag, rel_tol=1e-11)


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize("how", [{"method": "gauss6", "step": 0.01}, {"method": "radau5"}], ids=str)
def test_a_fall_from_rest_through_air(how: dict[str, Any], coordinates: str) -> None:
    """z = -(m/c) ln cosh(t sqrt(g c / m)) under -c |v| v: the slope of |v| alone has no value at
    rest, where radau5 found no step small enough."""
    c, duration = 0.5, 1.0
    scene = {
        "bodies": {"ball": {"mass": 1.0, "inertia": [0.1] * 3}},
        "effects": {
            "weight": {"type": "gravity"},
            "air": {"type": "quadratic_drag", "body": "ball", "coefficient": c},
        },
        "simulation": {"rate": 10, "duration": duration, "tolerance": 1e-8} | how,
    }
    if "step" in how:
        del scene["simulation"]["tolerance"]
    found, _ = last(scene, coordinates)
    assert found[2] == pytest.approx(-math.log(math.cosh((G * c) ** 0.5 * duration)) / c, abs=1e-7)
