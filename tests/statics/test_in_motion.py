# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Ranges of reactions of bodies in motion: which components the motion does not determine."""

from __future__ import annotations

from math import asin, cos, inf, sin
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import rb_sim
from rb_sim import RbSimError, Simulation
from rb_sim.cli.summary import _ranges_at_start as ranges_at_start

R, L, TURNED = 1.0, 2.5, 0.7
G = 9.81


def slider_crank() -> dict[str, Any]:
    """In the plane x, y; all pins along z, each able to carry bending and thrust."""
    tilt = -asin(R * sin(TURNED) / L)
    tip = np.array([R * cos(TURNED), R * sin(TURNED), 0.0])
    half = 0.5 * L * np.array([cos(tilt), sin(tilt), 0.0])

    def body(mass: float, at: Any, angle: float) -> dict[str, Any]:
        turned = [0.0, 0.0, sin(angle / 2), cos(angle / 2)]
        inertia = [0.1, 0.2, 0.2]
        return {"mass": mass, "inertia": inertia, "position": list(at), "orientation": turned}

    def pin(body: str, at: float, parent: str | None) -> dict[str, Any]:
        joint = {"type": "fixed_axis", "body": body, "axis_B": [0, 0, 1], "point_B": [at, 0, 0]}
        return joint if parent is None else joint | {"parent": parent}

    rail = {"type": "line", "direction": [1.0, 0.0, 0.0]}
    return {
        "bodies": {
            "crank": body(1.0, tip / 2, TURNED),
            "rod": body(2.0, tip + half, tilt),
            "slider": body(3.0, tip + 2.0 * half, 0.0),
        },
        "constraints": {
            "main": pin("crank", -R / 2, None),
            "pin": pin("rod", -L / 2, "crank"),
            "wrist": pin("rod", L / 2, "slider"),
            "guide": {"type": "translation", "body": "slider", "guide": rail},
        },
        "effects": {"g": {"type": "gravity", "acceleration": [0.0, -G, 0.0]}},
        "simulation": {"duration": 0.5, "rate": 10.0},
    }


def test_in_a_plane_the_components_out_of_it_are_nobodys_load():
    run = Simulation(slider_crank()).run(watched=False)
    ranges = rb_sim.reaction_ranges(run, 3)
    assert set(ranges) == set(run.layout.reactions)
    out_of_plane = {"force_z", "torque_x", "torque_y"}
    for name in ("main", "pin", "wrist", "guide"):
        assert set(ranges[name].undetermined) == out_of_plane
        assert all(span == [-inf, inf] for span in ranges[name].undetermined.values())
        inside = ranges[name].force[:2]
        assert_allclose(inside[:, 0], run.reaction[name].force[3, :2], atol=1e-6)
        assert_allclose(inside[:, 1], run.reaction[name].force[3, :2], atol=1e-6)
    assert set(ranges["pin/A"].undetermined) == {"force_x", "force_y", "force_z"}
    summary = ranges_at_start(Simulation(slider_crank()))
    assert set(summary["pin"]) == out_of_plane


def table(speed: float, mu: float) -> dict[str, Any]:
    half = 0.5
    legs = [[sx * half, sy * half, -half] for sx in (1, -1) for sy in (1, -1)]
    top = {"mass": 4.0, "inertia": [1.0, 1.0, 1.0], "position": [0.0, 0.0, half]}
    floor = {"type": "contact", "body": "top", "points": legs}
    floor |= {"friction": {"type": "coulomb", "static": mu, "kinetic": mu}}
    return {
        "bodies": {"top": top | {"linear_velocity": [speed, 0.0, 0.0]}},
        "constraints": {"floor": floor},
        "effects": {"g": {"type": "gravity"}},
        "simulation": {"duration": 0.2, "rate": 10.0},
    }


def test_a_sliding_table_brakes_with_all_its_legs():
    """Friction mu m g pitches it: the front pair carries m g / 2 (1 + mu), the rear one the rest,
    each side m g / 2. So a front leg carries mu m g / 2 to m g / 2, a rear one 0 to m g / 2 (1 -
    mu); the friction of a leg is -mu times its push."""
    mu, weight = 0.3, 4.0 * G
    run = Simulation(table(2.0, mu)).run(watched=False)
    ranges = rb_sim.reaction_ranges(run)
    for k, x in enumerate((1, 1, -1, -1)):
        span = ranges[f"floor/{k + 1}"]
        push = weight / 2.0 * np.array([mu, 1.0] if x > 0 else [0.0, 1.0 - mu])
        assert_allclose(span.force[2], push, atol=1e-6)
        assert_allclose(span.force[0], -mu * push[::-1], atol=1e-6)
        assert_allclose(span.force[1], 0.0, atol=1e-9)


def test_averages_of_a_step_have_no_ranges():
    scene = table(0.0, 0.3)
    scene["simulation"] |= {"method": "time_stepping", "step": 0.01}
    with pytest.raises(RbSimError, match="time_stepping reports averages"):
        rb_sim.reaction_ranges(Simulation(scene).run(watched=False))
