# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reactions of the shipped scenes, by their closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from rb_sim.equilibrium.statics import solve
from rb_sim.equilibrium.statics_tables import StaticsResult
from rb_sim.scene.load import load_statics
from tests.equilibrium.scenes import table

CONFIG = Path(__file__).parents[2] / "config" / "statics"
G = 9.81
EXACT = 1e-12
"""Relative to the largest load: determinate reactions come from one well-conditioned solve."""


def along(result: StaticsResult, name: str) -> float:
    value = result.reactions[name].along
    assert value is not None
    return value


def shipped(name: str) -> StaticsResult:
    return solve(load_statics(CONFIG / f"{name}.yaml"))


def test_every_shipped_scene_is_in_equilibrium_and_described():
    paths = sorted(CONFIG.glob("*.yaml"))
    assert len(paths) >= 8
    for path in paths:
        scene = load_statics(path)
        assert scene.description and "\n" not in scene.description
        result = solve(scene)
        assert result.verdict in ("equilibrium", "indeterminate"), path
        for force, torque in result.balance.values():
            assert np.abs([force, torque]).max() < EXACT * 600.0


TILT = math.pi / 6
"""Of the shipped rods from the vertical; the ladders have other ones."""
SHORT_ROD, LADDER = 8.0 * G, 15.0 * G
EDGE = 10.0 * G * 3.0 * math.sin(2 * TILT) / (4 * 1.2)
"""Landau & Lifshitz, section 38, problem 2: P l sin(2 alpha) / (4 h)."""
TIED = 15.0 * math.tan(TILT)
"""Problem 4: (F/4) cot alpha of the floor."""
PULL = 0.5 * SHORT_ROD * math.tan(TILT)
"""Problem 3: (P/2) cot alpha; the rod's vertical plane is at 30 degrees to the wall."""
WALL = 0.5 * LADDER * math.tan(0.4363323129985824)
ROUGH_WALL = 0.5 * LADDER / (1.0 / math.tan(0.6108652381980153) + 0.25)
"""Of least norm, friction at the wall is as large as it may be: N H = (P/2 - mu N) D."""

BY_HAND: dict[str, dict[str, list[float]]] = {
    "hinged_rods": {
        "floor_A": [0, 0, 45.0],
        "floor_B": [0, 0, 15.0],
        "string": [-TIED, 0, 0],
        "hinge_C": [TIED, 0, -15.0],
    },
    "ladder_smooth_wall": {"floor": [WALL, 0, LADDER], "wall": [-WALL, 0, 0]},
    "ladder_rough_wall": {
        "floor": [ROUGH_WALL, 0, LADDER - 0.25 * ROUGH_WALL],
        "wall": [-ROUGH_WALL, 0, 0.25 * ROUGH_WALL],
    },
    "rod_over_wall": {
        "edge_C": [EDGE * math.cos(TILT), 0, EDGE * math.sin(TILT)],
        "floor_B": [0, 0, 10.0 * G - EDGE * math.sin(TILT)],
        "string": [-EDGE * math.cos(TILT), 0, 0],
    },
    "rod_two_planes": {
        "floor_B": [0, 0, SHORT_ROD],
        "string_BC": [-PULL * math.cos(TILT), -0.5 * PULL, 0],
        "wall_A": [0, 0.5 * PULL, 0],
        "string_AD": [PULL * math.cos(TILT), 0, 0],
    },
    "sphere_held": {"floor": [-7.0, 4.0, 2.0 * G]},
}


@pytest.mark.parametrize("name", BY_HAND)
def test_shipped_scene_has_the_reactions_of_its_closed_form(name: str) -> None:
    result = shipped(name)
    assert set(result.reactions) == set(BY_HAND[name])
    for support, force in BY_HAND[name].items():
        assert result.reactions[support].force == pytest.approx(force, rel=EXACT, abs=1e-9)


@pytest.mark.parametrize(("name", "x", "y"), [("table_centred", 0, 0), ("table_offset", 0.2, -0.1)])
def test_shipped_table_has_the_reactions_and_ranges_of_its_closed_form(
    name: str, x: float, y: float
) -> None:
    """Legs at (+-a, +-b) bear (P/4) (1 +- x/a +- y/b), and s (+1, -1, +1, -1) besides until a leg
    lifts."""
    result = shipped(name)
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    normals = [5.0 * G + 100.0 * (1 + i * x / 0.8 + j * y / 0.5) for i, j in signs]
    down, rise = min(normals[::2]), min(normals[1::2])
    for k, normal in enumerate(normals):
        leg = f"leg_{k + 1}"
        less, more = (down, rise) if k % 2 == 0 else (rise, down)
        assert along(result, leg) == pytest.approx(normal, rel=EXACT)
        span = [normal - less, normal + more]
        assert result.ranges[leg].along == pytest.approx(span, abs=1e-9 * 600.0)


def test_least_norm_with_a_leg_off_the_ground():
    """Load near leg 1: equal stiffness would pull leg 3 down, so it carries nothing."""
    legs = [(0.8, 0.5, 0.0), (-0.8, 0.5, 0.0), (-0.8, -0.5, 0.0), (0.8, -0.5, 0.0)]
    result = solve(load_statics(table(legs, (0.0, 0.0, -400.0), (0.7, 0.3, 0.0))))
    found = [along(result, f"N{i}") for i in (1, 2, 3, 4)]
    assert found == pytest.approx([295.0, 25.0, 0.0, 80.0], rel=EXACT, abs=1e-11)


def test_friction_disc_is_round():
    """Two feet at +-a, weight W, a push q across the line that joins them.

    Each foot carries q/2 across; along the line they may press each other with up to
    sqrt((mu W/2)^2 - (q/2)^2): the boundary of the disc, which no polygon reproduces.
    """
    mu, weight, push = 0.5, 100.0, 30.0
    scene = table([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)], (0.0, push, -weight), (0.0, 0.0, 0.0), mu)
    result = solve(load_statics(scene))
    most = math.sqrt((0.5 * mu * weight) ** 2 - (0.5 * push) ** 2)
    assert result.verdict == "indeterminate"
    for name in ("N1", "N2"):
        span = result.ranges[name]
        assert span.force[0] == pytest.approx([-most, most], rel=1e-11)
        assert span.force[1] == pytest.approx([-0.5 * push] * 2, rel=EXACT)
        assert span.along == pytest.approx([0.5 * weight] * 2, rel=EXACT)
        assert result.reactions[name].force[0] == pytest.approx(0.0, abs=1e-11)


def test_weld_and_pin():
    """A cantilever of length l with a load at its end, and a door on a pin held by a string."""
    load = {"type": "wrench", "body": "beam", "force": [0.0, 3.0, -7.0], "point_B": [2.0, 0.0, 0.0]}
    scene = {
        "bodies": {"beam": {}},
        "supports": {"wall": {"type": "weld", "body": "beam"}},
        "loads": {"end": load},
    }
    result = solve(load_statics(scene))
    assert result.verdict == "equilibrium"
    assert result.reactions["wall"].force == pytest.approx([0.0, -3.0, 7.0], rel=EXACT, abs=1e-12)
    assert result.reactions["wall"].torque == pytest.approx(
        [0.0, -14.0, -6.0], rel=EXACT, abs=1e-12
    )
    pin = {"type": "hinge", "body": "beam", "axis_A": [0.0, 1.0, 0.0]}
    string = {"type": "string", "body": "beam", "point_B": [2.0, 0.0, 0.0]}
    scene["supports"] = {"pin": pin, "string": string | {"point_A": [0.0, 0.0, 2.0]}}
    result = solve(load_statics(scene))
    assert result.verdict == "equilibrium"
    assert along(result, "string") == pytest.approx(7.0 * math.sqrt(2.0), rel=EXACT)
    assert result.reactions["pin"].force == pytest.approx([7.0, -3.0, 0.0], rel=EXACT, abs=1e-11)
    assert result.reactions["pin"].torque == pytest.approx([0.0, 0.0, -6.0], rel=EXACT, abs=1e-11)
