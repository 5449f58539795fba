# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Many bodies and many constraints: redundant ones, closed loops, starts off the manifold."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from rb_sim import Simulation
from rb_sim.base.errors import AccuracyWarning, SceneError
from rb_sim.scene.load import scene_from_mapping
from tests.runs import trajectory

G = 9.81
DOWN = {"type": "gravity", "acceleration": [0.0, 0.0, -G]}
MANIFOLD = 1e-12

A, B, MASS = 0.5, 0.8, 12.0
LEGS = {"N1": [A, B, 0.0], "N2": [-A, B, 0.0], "N3": [-A, -B, 0.0], "N4": [A, -B, 0.0]}


def compiled(mapping: Any, coordinates: str = "auto") -> tuple[tuple[str, ...], int, int]:
    """(indeterminate reactions, rows, degrees of freedom)."""
    from rb_sim import Simulation, load_scene

    made = Simulation(load_scene(mapping), coordinates=coordinates).compiled
    return made.indeterminate, made.rows, made.degrees_of_freedom


def table(x: float, y: float) -> dict[str, Any]:
    """A table on four legs with its centre of mass at (x, y)."""
    leg = {"type": "plane", "body": "top", "normal_A": [0.0, 0.0, 1.0], "point_A": [0.0, 0.0, 0.0]}
    top = {"mass": MASS, "inertia": [1.0, 1.0, 1.5], "center_of_mass": [x, y, 0.4]}
    return {
        "bodies": {"top": top},
        "constraints": {name: leg | {"point_B": foot} for name, foot in LEGS.items()},
        "effects": {"weight": DOWN},
        "simulation": {"duration": 0.1, "rate": 10.0, "tolerance": 1e-10},
    }


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.1, -0.2), (0.3, 0.3)])
def test_table_on_four_legs(x: float, y: float) -> None:
    """The reactions of least norm, N = W/4 (1 +- x/a +- y/b); reported as indeterminate."""
    run = trajectory(table(x, y))
    for i, (leg_x, leg_y, _) in enumerate(LEGS.values()):
        share = 0.25 * (1.0 + x / leg_x + y / leg_y)
        assert_allclose(run.reaction_force[:, i], [[0.0, 0.0, MASS * G * share]] * 2, atol=1e-9)
    indeterminate, rows, freedom = compiled(table(x, y))
    assert indeterminate == tuple(LEGS)
    assert (rows, freedom) == (4, 3)


def test_three_legs_are_determinate() -> None:
    scene = table(0.0, 0.0)
    scene["constraints"].pop("N4")
    assert compiled(scene) == ((), 3, 3)


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize(("floating", "share"), [("A", 0.0), ("B", 1.0), ("none", 0.5)])
def test_bearings_share_the_axial_force(coordinates: str, floating: str, share: float) -> None:
    """A vertical shaft: the fixed bearing carries it, or half each and reported so."""
    joint = {"type": "fixed_axis", "body": "rotor", "axis_B": [0.0, 0.0, 1.0]}
    scene = {
        "bodies": {"rotor": {"mass": 3.0, "inertia": [0.1, 0.1, 0.2]}},
        "constraints": {"shaft": joint | {"bearing_distance": 0.5, "floating": floating}},
        "effects": {"weight": DOWN},
    }
    run = trajectory(scene, coordinates, duration=0.1, rate=10.0, tolerance=1e-10)
    axial = run.reaction_force[:, :, 2]
    assert_allclose(axial[:, 0], 3.0 * G)
    assert_allclose(axial[:, 1], share * 3.0 * G, atol=1e-12)
    assert_allclose(axial[:, 2], (1.0 - share) * 3.0 * G, atol=1e-12)
    indeterminate, rows, freedom = compiled(scene, coordinates)
    assert freedom == 1
    assert rows == (6 if floating == "none" else 5)
    assert bool(indeterminate) == (floating == "none")


@pytest.mark.parametrize("floating", ["A", "B"])
def test_close_bearings_in_space_are_as_exact(floating: str) -> None:
    """Quaternions in the stages of a step are a little off length 1; the lines of close bearings
    must turn their arms by them in the same way, or the body tilts by the difference over their
    distance: an error of 4e-4 at 0.1 mm, where rk4 makes 1e-7."""
    body = {"mass": 1.0, "inertia": [0.05, 0.08, 0.06]}
    hinge = {
        "type": "fixed_axis",
        "body": "low",
        "parent": "up",
        "axis_B": [0.6, -0.48, 0.64],
        "point_B": [0.5, -0.2, 0.3],
        "floating": floating,
    }

    def ends(distance: float) -> np.ndarray:
        scene = {
            "bodies": {
                "up": body | {"center_of_mass": [0.2, -0.1, 0.3]},
                "low": body | {"position": [0.7, 0.2, -0.4], "center_of_mass": [-0.3, 0.2, 0.1]},
            },
            "constraints": {
                "pivot": {"type": "fixed_point", "body": "up", "point_B": [-0.4, 0.3, 0.5]},
                "hinge": hinge | {"bearing_distance": distance},
            },
            "effects": {"weight": DOWN},
        }
        run = trajectory(scene, duration=0.5, rate=10.0, method="rk4", step=2e-3)
        return np.stack([run.position[:, 0], run.position[:, 1]])

    apart, near = ends(1.0), ends(0.01)
    assert_allclose(near, apart, atol=1e-7)  # of the method
    assert_allclose(ends(1e-4), near, atol=1e-10)


PLANE = {"type": "plane", "normal_A": [0.8, 0.0, -0.6]}
ROD = {"type": "distance"}


@pytest.mark.parametrize("beside", [PLANE, ROD], ids=lambda row: row["type"])
def test_what_holds_a_body_close_to_its_ball_is_as_exact(beside: dict[str, Any]) -> None:
    """A ball's lines lay along the world's axes, those beside it turned with the parent: off the
    manifold they tilted the body, by 6e-5 where a lever is 0.1 mm long."""
    body = {"mass": 1.0, "inertia": [0.05, 0.08, 0.06]}
    up = body | {"center_of_mass": [0.2, -0.1, 0.3]}
    low = body | {"position": [0.7, 0.2, -0.4], "center_of_mass": [-0.3, 0.2, 0.1]}
    ball = np.array([0.5, -0.2, 0.3])

    def error(lever: float) -> float:
        held = ball + np.array([0.6, 0.0, 0.8]) * lever
        link = beside | {"body": "low", "parent": "up", "point_B": held.tolist()}
        if beside is ROD:  # from 0.4 m beside where the lever starts, across it
            at = held + np.array(low["position"]) + [0.32, 0.0, -0.24]
            link["point_A"] = at.tolist()
        pin = {"type": "fixed_point", "body": "up", "point_B": [-0.4, 0.3, 0.5]}
        joint = {"type": "fixed_point", "body": "low", "parent": "up", "point_B": ball.tolist()}
        scene = {
            "bodies": {"up": up, "low": low},
            "constraints": {"pin": pin, "ball": joint, "link": link},
            "effects": {"weight": DOWN},
        }
        true = trajectory(scene, duration=0.5, rate=10.0, method="taylor", tolerance=1e-12)
        run = trajectory(scene, duration=0.5, rate=10.0, method="rk4", step=2e-3)
        return float(np.abs(np.subtract(run.position, true.position)).max())

    assert error(1e-4) < max(4.0 * error(0.5), 1e-9)


def chain() -> dict[str, Any]:
    """Every holonomic kind between three bodies and the world, and one that is not holonomic."""
    return {
        "bodies": {
            "a": {"mass": 1.0, "inertia": [0.02, 0.03, 0.025], "position": [0.0, 0.0, -0.5]},
            "b": {
                "mass": 0.7,
                "inertia": [0.01, 0.012, 0.008],
                "position": [0.4, 0.0, -0.9],
                "angular_velocity": [0.0, 2.0, 1.0],
            },
            "c": {
                "mass": 0.5,
                "inertia": [0.01, 0.011, 0.012],
                "position": [0.9, 0.2, -1.0],
                "linear_velocity": [0.3, 0.4, 0.0],
            },
        },
        "constraints": {
            "pivot": {"type": "fixed_point", "body": "a", "point_B": [0.0, 0.0, 0.5]},
            "hinge": {
                "type": "fixed_axis",
                "body": "b",
                "parent": "a",
                "axis_B": [0.0, 1.0, 0.0],
                "point_B": [-0.4, 0.0, 0.4],
            },
            "rod": {"type": "distance", "body": "c", "parent": "b", "point_A": [0.1, 0.0, 0.0]},
            "table": {"type": "plane", "body": "c", "normal_A": [0.0, 0.0, 1.0]},
            "upright": {"type": "parallel", "body": "c", "axis_B": [0.0, 0.0, 1.0]},
            "blade": {"type": "velocity", "body": "c", "linear": [0.0, 1.0, 0.0]},
        },
        "effects": {"weight": DOWN},
        "simulation": {"duration": 0.2, "project_initial": True},
    }


@pytest.mark.parametrize("step", [0.05, 0.005])
@pytest.mark.parametrize("method", ["euler", "rk4", "dopri853", "gauss6"])
def test_on_the_manifold_after_every_step(method: str, step: float) -> None:
    """|g| and |G u - b| are at round-off whatever the method and the step."""
    run = trajectory(chain(), method=method, step=step, rate=1.0 / step)
    assert len(run.t) == round(0.2 / step) + 1
    assert run.residual.max() <= MANIFOLD


def test_reactions_between_bodies_are_opposite() -> None:
    """Momentum of the chain changes by the weight and the reactions of the world alone."""
    run = trajectory(chain(), tolerance=1e-12, rate=200.0)
    world = run.reaction_force[:, [0, 5, 6, 7]].sum(axis=1) + [0.0, 0.0, -2.2 * G]
    rate = np.gradient(run.momentum, run.t, axis=0, edge_order=2)
    assert_allclose(rate[2:-2], world[2:-2], atol=3e-3 * np.abs(world).max())


def refusal(mapping: Any) -> str:
    from rb_sim import Simulation, load_scene

    try:
        Simulation(load_scene(mapping))
    except SceneError as error:
        return str(error)
    return ""


def two_pins(apart: float, project: bool) -> dict[str, Any]:
    pin = {"type": "fixed_point", "body": "body"}
    return {
        "bodies": {"body": {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}},
        "constraints": {
            "first": pin | {"point_A": [0.0, 0.0, 0.0]},
            "second": pin | {"point_B": [1.0, 0.0, 0.0], "point_A": [1.0 + apart, 0.0, 0.0]},
        },
        "simulation": {"project_initial": project},
    }


def test_contradiction_is_refused() -> None:
    """Points 1 m apart in the body and 1.5 m in the world: no state fits."""
    assert "contradict each other" in refusal(two_pins(0.5, True))
    message = refusal(two_pins(0.5, False))
    assert "constraints.second" in message and "violates it by" in message
    assert refusal(two_pins(0.0, False)) == ""


def test_start_off_the_manifold() -> None:
    """Refused with the way out; with project_initial moved onto the manifold."""
    scene = chain()
    scene["constraints"]["pivot"]["point_A"] = [0.02, -0.01, 0.03]
    refused = scene | {"simulation": {"duration": 0.1}}
    assert "project_initial: true" in refusal(refused)
    run = trajectory(scene, tolerance=1e-10, rate=10.0)
    assert run.residual[0] <= MANIFOLD
    assert_allclose(run.anchor[0, 0], [0.02, -0.01, 0.03], atol=1e-12)


# Sarrus' linkage (1853): two pairs of links in planes across each other guide a platform along z.
#
# Six hinges hold 30 coordinates by 30 lines, and it moves all the same. With both pairs alike, phi
# the angle of the lower links from the vertical, links of length l, mass m and moment J, and a
# platform M:
#
#     I phi'' = -I' phi'^2 / 2 + (4 m + 2 M) g l sin(phi),
#     I = 4 J + m l^2 + 4 (m + M) l^2 sin^2(phi),
#
# and each pair carries half of M (g + z''), z = 2 l cos(phi). Where all links are in line each pair
# may go on to either side.


LENGTH, LINK, PLATFORM, MOMENT, APART = 0.5, 0.7, 2.0, 0.03, 0.4
WAYS = {
    "dopri853": {"method": "dopri853", "tolerance": 1e-11},
    "rk4": {"method": "rk4", "step": 1e-3},
    "gauss6": {"method": "gauss6", "step": 5e-3},
    "taylor": {"method": "taylor", "tolerance": 1e-11},
}


def linkage(phi: float, rate: float, g: float, **run: Any) -> dict[str, Any]:
    """Links that lean by phi and turn at `rate`; g: weight, downwards where positive."""
    s, c = math.sin(phi), math.cos(phi)
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    for pair, (out, axis) in {"x": ([1, 0, 0], [0, 1, 0]), "y": ([0, 1, 0], [-1, 0, 0])}.items():
        direction = np.array(out)
        for name, height, lean in (("lower", 0.5, 1.0), ("upper", 1.5, -1.0)):
            at = (APART + 0.5 * LENGTH * s) * direction + [0, 0, height * LENGTH * c]
            v = 0.5 * LENGTH * c * direction - [0, 0, height * LENGTH * s]
            bodies[f"{name}_{pair}"] = {
                "mass": LINK,
                "inertia": [MOMENT] * 3,
                "position": at.tolist(),
                "orientation": {"axis": axis, "angle": lean * phi},
                "linear_velocity": (rate * v).tolist(),
                "angular_velocity": (lean * rate * np.array(axis)).tolist(),
            }
        lower, upper = {"body": f"lower_{pair}"}, {"body": f"upper_{pair}"}
        end = {"point_B": [0, 0, -0.5 * LENGTH]}
        top = {
            "body": "platform",
            "parent": f"upper_{pair}",
            "point_B": (APART * direction).tolist(),
        }
        joints[f"base_{pair}"] = lower | end
        joints[f"knee_{pair}"] = upper | end | {"parent": f"lower_{pair}"}
        joints[f"top_{pair}"] = top
        for name in ("base", "knee", "top"):
            joints[f"{name}_{pair}"] |= {"type": "fixed_axis", "axis_B": axis}
    bodies["platform"] = {
        "mass": PLATFORM,
        "inertia": [0.1, 0.12, 0.2],
        "position": [0, 0, 2 * LENGTH * c],
        "linear_velocity": [0, 0, -2 * LENGTH * s * rate],
    }
    weight = {"type": "gravity", "acceleration": [0, 0, -g]}
    return {
        "bodies": bodies,
        "constraints": joints,
        "effects": {"weight": weight},
        "simulation": {"rate": 50.0} | run,
    }


def acceleration(phi: Any, rate: Any, g: float) -> Any:
    """phi''."""
    s, c, masses = np.sin(phi), np.cos(phi), LINK + PLATFORM
    inertia = 4 * MOMENT + (LINK + 4 * masses * s**2) * LENGTH**2
    moved = -4 * masses * LENGTH**2 * s * c * rate**2
    return (moved + (4 * LINK + 2 * PLATFORM) * g * LENGTH * s) / inertia


def angle(phi: float, rate: float, g: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(phi, phi') at t."""
    found = solve_ivp(
        lambda _, y: [y[1], acceleration(y[0], y[1], g)],
        (0.0, t[-1]),
        [phi, rate],
        "DOP853",
        t,
        rtol=1e-12,
        atol=1e-12,
    )
    return found.y[0], found.y[1]


@pytest.mark.parametrize("way", ["dopri853", "gauss6", "taylor"])
def test_the_platform_falls_straight_on_half_its_load_each(way: str) -> None:
    g = 9.81
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = scene_from_mapping(linkage(0.5, 0.8, g, duration=0.2, **WAYS[way]))
        run = Simulation(scene).run()
    phi, rate = angle(0.5, 0.8, g, run.t)
    straight = np.outer(2 * LENGTH * np.cos(phi), [0, 0, 1])
    np.testing.assert_allclose(run.position["platform"], straight, atol=3e-10)
    rise = -2 * LENGTH * (np.cos(phi) * rate**2 + np.sin(phi) * acceleration(phi, rate, g))
    for pair in "xy":
        load = run.reaction[f"top_{pair}"].force[:, 2]
        np.testing.assert_allclose(load, 0.5 * PLATFORM * (g + rise), atol=1e-7)


def test_a_start_in_line_is_refused() -> None:
    with pytest.raises(SceneError, match="singular initial position: .*base_x, knee_x"):
        Simulation(scene_from_mapping(linkage(0.0, 0.3, 0.0, duration=0.1)))


@pytest.mark.parametrize("way", ["dopri853", "rk4"])
def test_that_its_links_came_in_line_is_reported(way: str) -> None:
    """Hanging it swings through, by 0.14 rad from sample to sample; s is within 0.02 rad alike."""
    scene = scene_from_mapping(linkage(0.9, 0.0, -9.81, duration=0.5, **WAYS[way]))
    with pytest.warns(AccuracyWarning, match="singular configuration"):
        run = Simulation(scene).run()
    (found,) = [finding for finding in run.findings if finding.check == "singular configuration"]
    t = np.linspace(0.0, 0.5, 50001)
    in_line = t[np.argmin(np.abs(angle(0.9, 0.0, -9.81, t)[0]))]
    assert found.t == pytest.approx(in_line, abs=1e-3)
