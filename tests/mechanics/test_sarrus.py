# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sarrus' linkage (1853): two pairs of links in planes across each other guide a platform along z.

Six hinges hold 30 coordinates by 30 lines, and it moves all the same. With both pairs alike, phi
the angle of the lower links from the vertical, links of length l, mass m and moment J, platform M:

    I phi'' = -I' phi'^2 / 2 + (4 m + 2 M) g l sin(phi),
    I = 4 J + m l^2 + 4 (m + M) l^2 sin^2(phi),

and each pair carries half of M (g + z''), z = 2 l cos(phi). Where all links are in line each pair
may go on to either side.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rb_sim import Simulation
from rb_sim.base.errors import AccuracyWarning, SceneError
from rb_sim.scene.load import scene_from_mapping

LENGTH, LINK, PLATFORM, MOMENT, APART = 0.5, 0.7, 2.0, 0.03, 0.4
WAYS = {
    "dopri853": {"method": "dopri853", "tolerance": 1e-11},
    "rk4": {"method": "rk4", "step": 1e-3},
    "gauss6": {"method": "gauss6", "step": 5e-3},
    "radau5": {"method": "radau5", "tolerance": 1e-10},
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


@pytest.mark.parametrize("way", WAYS)
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
def test_that_its_links_came_in_line_is_told(way: str) -> None:
    """Hanging it swings through, by 0.14 rad from sample to sample; s is within 0.02 rad alike."""
    scene = scene_from_mapping(linkage(0.9, 0.0, -9.81, duration=0.5, **WAYS[way]))
    with pytest.warns(AccuracyWarning, match="singular configuration"):
        run = Simulation(scene).run()
    (found,) = [finding for finding in run.findings if finding.watch == "singular configuration"]
    t = np.linspace(0.0, 0.5, 50001)
    in_line = t[np.argmin(np.abs(angle(0.9, 0.0, -9.81, t)[0]))]
    assert found.t == pytest.approx(in_line, abs=1e-3)
