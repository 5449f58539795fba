# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Shares of a load that the laws leave open are the least ones, and that they are is reported.

A block between flat pads on guides: the centre of pressure of the pads is in no law, and friction
at a pressure off the centre would turn the block. Forces and motions are closed forms.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from tests.contact.scenes import G, box

MU, STEP = 0.5, 1e-3
BLOCK, FINGERS = 0.3, {"left": -1.0, "right": 1.0}


def guided(parent: dict[str, str], finger: str, along: list[float]) -> dict[str, Any]:
    """Constraints that let a finger move along an axis of its parent only."""
    across = ([0.0, 1.0, 0.0] if along[0] else [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    own = {"body": finger} | parent
    return {
        f"{finger}_x": {"type": "parallel", "axis_B": along} | own,
        f"{finger}_z": {"type": "parallel", "axis_B": [0.0, 0.0, 1.0]} | own,
        f"{finger}_across": {"type": "plane", "normal_A": across[0]} | own,
        f"{finger}_up": {"type": "plane", "normal_A": across[1]} | own,
    }


def clamped(squeeze: float, friction: dict[str, Any], hand: bool) -> dict[str, Any]:
    """A block between two pads that slide in a hand on a vertical rail, or in the world."""
    bodies: dict[str, Any] = {}
    constraints: dict[str, Any] = {}
    effects: dict[str, Any] = {"weight": {"type": "gravity"}}
    parent = {"parent": "hand"} if hand else {}
    if hand:
        inertia = [0.01, 0.01, 0.01]
        bodies["hand"] = {"mass": 1.0, "inertia": inertia, "position": [0.0, 0.0, 0.3]}
        guide = {"type": "line", "direction": [0.0, 0.0, 1.0]}
        constraints["rail"] = {"type": "translation", "body": "hand", "guide": guide}
        effects["lift"] = {"type": "wrench", "body": "hand", "force": [0.0, 0.0, 1.5 * G]}
    for finger, side in FINGERS.items():
        bodies[finger] = box([0.02, 0.06, 0.06], [0.04 * side, 0.0, 0.1]) | {"mass": 0.1}
        constraints |= guided(parent, finger, [1.0, 0.0, 0.0])
        surface = {"type": "plane", "point": [-0.01 * side, 0, 0], "normal": [-side, 0, 0]}
        touching = {"type": "contact", "body": "block", "parent": finger, "surface": surface}
        constraints[f"on_{finger}"] = touching | {"friction": friction}
        effects[f"push_{finger}"] = {
            "type": "wrench",
            "body": finger,
            "force": [-side * squeeze, 0, 0],
        }
    bodies["block"] = box([0.06, 0.04, 0.04], [0.0, 0.0, 0.1]) | {"mass": BLOCK}
    return {"bodies": bodies, "constraints": constraints, "effects": effects}


def plate(squeeze: float) -> dict[str, Any]:
    """A plate between one flat finger and two that press against it."""
    bodies = {"block": box([0.1, 0.02, 0.1], [0.0, 0.0, 0.1]) | {"mass": BLOCK}}
    constraints: dict[str, Any] = {}
    effects: dict[str, Any] = {"weight": {"type": "gravity"}}
    for i, (side, x, force) in enumerate(((-1, 0.0, 2.0), (1, 0.03, 1.0), (1, -0.03, 1.0))):
        finger = f"finger{i}"
        bodies[finger] = box([0.02, 0.02, 0.02], [x, 0.02 * side, 0.1]) | {"mass": 0.1}
        constraints |= guided({}, finger, [0.0, 1.0, 0.0])
        surface = {"type": "plane", "point": [0, 0.01 * side, 0], "normal": [0, side, 0]}
        constraints[f"on_{finger}"] = {
            "type": "contact", "body": finger, "parent": "block", "surface": surface,
            "friction": {"type": "coulomb", "static": MU},
        }  # fmt: skip
        push = [0.0, -side * force * squeeze, 0.0]
        effects[f"push_{finger}"] = {"type": "wrench", "body": finger, "force": push}
    return {"bodies": bodies, "constraints": constraints, "effects": effects}


def run(scene: dict[str, Any], step: float = STEP) -> Any:
    """0.1 s by time stepping; (trajectory, texts of its warnings)."""
    options = {"method": "time_stepping", "step": step, "duration": 0.1, "rate": 100.0}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        run = Simulation(load_scene(scene | {"simulation": options})).run(check=False)
    return run, [str(w.message) for w in said]


COULOMB = {"type": "coulomb", "static": MU}


def falls(found: Any, friction: float) -> None:
    """The block falls without a turn, held back by the friction of all its contacts."""
    t = found.t
    way = 0.5 * (G - friction / BLOCK) * t**2
    assert_allclose(0.1 - found.position["block"][:, 2], way, atol=2e-6)
    assert np.abs(found.orientation["block"][:, :3]).max() < 1e-6


@pytest.mark.parametrize("hand", [True, False])
@pytest.mark.parametrize("step", [1e-2, 1e-3])
def test_a_block_slips_out_of_two_pads_without_a_turn(hand: bool, step: float) -> None:
    """Its four corners on a pad share the squeeze alike, whatever sweeps begin with."""
    squeeze = 0.985 * BLOCK * G / (2.0 * MU)
    found, _ = run(clamped(squeeze, COULOMB, hand), step)
    falls(found, 2.0 * MU * squeeze)
    for finger, side in FINGERS.items():
        corners = [found.reaction[f"on_{finger}/{i}"].force[1:, 0] for i in range(1, 9)]
        pushing = [c for c in corners if np.abs(c).max() > 0.0]
        assert len(pushing) == 4
        assert_allclose(pushing, -side * squeeze / 4.0, rtol=1e-3)
        assert_allclose(found.reaction[f"on_{finger}"].force[1:, 0], -side * squeeze, rtol=1e-6)


@pytest.mark.parametrize("torque", [0.05, 0.12])
@pytest.mark.parametrize(
    "method", [{"method": "dopri853", "tolerance": 1e-9}, {"method": "time_stepping", "step": STEP}]
)
def test_corners_share_alike_where_the_block_turns_as_well(
    torque: float, method: dict[str, Any]
) -> None:
    """Corners that slip are equal in least shares; a pad at its edge would spare its guide."""
    scene = clamped(3.2, COULOMB, False)
    scene["effects"]["twist"] = {"type": "wrench", "body": "block", "torque": [torque, 0.0, 0.0]}
    scene["simulation"] = method | {"duration": 0.03, "rate": 100.0}
    found = Simulation(load_scene(scene)).run(checks=False)
    for finger in FINGERS:
        corners = [np.abs(found.reaction[f"on_{finger}/{i}"].force[1:, 0]) for i in range(1, 9)]
        pushing = [c for c in corners if c.max() > 0.0]
        assert len(pushing) == 4
        assert_allclose(pushing, 0.8, rtol=1e-3)


def test_a_plate_slips_out_of_three_fingers_without_a_turn() -> None:
    found, _ = run(plate(1.4))
    falls(found, 4.0 * MU * 1.4)


def test_a_block_that_is_held_loads_both_pads_alike() -> None:
    """Also where the first solution that sweeps find has corners at the bound of friction."""
    found, reported = run(clamped(3.2, COULOMB, False))
    for finger in FINGERS:
        assert_allclose(found.reaction[f"on_{finger}"].force[1:, 2], BLOCK * G / 2.0, rtol=1e-6)
        assert_allclose(found.reaction[f"on_{finger}"].force[1:, 1], 0.0, atol=1e-6)
    assert not [text for text in reported if "ambiguous" in text]


@pytest.mark.parametrize("resists", [{}, {"rolling_resistance": 1e-3, "spinning_resistance": 2e-3}])
def test_a_motion_that_shares_leave_open_is_reported_once(resists: dict[str, float]) -> None:
    squeeze = 0.985 * BLOCK * G / (2.0 * MU)
    scene = clamped(squeeze, COULOMB, False)
    for finger in FINGERS:
        scene["constraints"][f"on_{finger}"] |= resists
    found, reported = run(scene)
    falls(found, 2.0 * MU * squeeze)
    assert (
        len([text for text in reported if "accelerations that the contact laws allow" in text]) == 1
    )


# A table on four legs, its centre of mass beside their middle: three loads are determined.

LEGS = np.array([[x, y] for x in (-0.6, 0.4) for y in (-0.35, 0.25)])
TABLE = 10.0


def table(size: float, velocity: float, spin: float) -> dict[str, Any]:
    """It slides at so many times the speed, and turns at so many times the rate, of its size."""
    points = [[size * x, size * y, -0.5 * size] for x, y in LEGS]
    body = {"mass": TABLE, "position": [0.0, 0.0, 0.5 * size]}
    body["inertia"] = [TABLE * size * size * k for k in (0.1, 0.15, 0.2)]
    body["linear_velocity"] = [velocity * size**0.5, 0.0, 0.0]
    body["angular_velocity"] = [0.0, 0.0, spin * size**-0.5]
    floor = {"type": "contact", "body": "table", "points": points, "friction": COULOMB}
    return {"bodies": {"table": body}, "constraints": {"floor": floor},
            "effects": {"weight": {"type": "gravity"}}}  # fmt: skip


def pulled(size: float, velocity: float, spin: float, how: dict[str, Any]) -> tuple[Any, list[str]]:
    """(run of 0.2 times its time at ten samples, what it warned of)."""
    time = 0.2 * size**0.5
    scene = table(size, velocity, spin) | {
        "simulation": how | {"duration": time, "rate": 10 / time}
    }
    with warnings.catch_warnings(record=True) as reported:
        warnings.simplefilter("always")
        found = Simulation(load_scene(scene)).run(check=False)
    return found, [str(warning.message) for warning in reported]


@pytest.mark.parametrize("velocity", [0.0, 2.0])
def test_a_table_loads_its_legs_least(velocity: float) -> None:
    """Minimum norm of what balances weight and, as it slides, the moment of friction."""
    found, reported = pulled(1.0, velocity, 0.0, {"method": "time_stepping", "step": STEP})
    sliding = MU if velocity else 0.0
    balance = np.vstack([np.ones(4), LEGS.T - [[0.5 * sliding], [0.0]]])
    loads = np.linalg.pinv(balance) @ [TABLE * G, 0.0, 0.0]
    given = [found.reaction[f"floor/{i}"].force[1:, 2] for i in range(1, 5)]
    assert_allclose(given, np.tile(loads[:, None], 10), rtol=1e-3)
    assert not reported


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_table_that_turns_moves_as_by_events_and_says_what_is_open(size: float) -> None:
    """Four legs that slip in several directions: the motion depends on the shares."""
    exact, _ = pulled(size, 1.0, 3.0, {"method": "dopri853", "tolerance": 1e-9})
    step = {"method": "time_stepping", "step": STEP * size**0.5}
    found, reported = pulled(size, 1.0, 3.0, step)
    assert_allclose(found.position["table"], exact.position["table"], atol=2e-4 * size)
    assert [text for text in reported if "accelerations that the contact laws allow" in text]


def test_a_block_that_comes_to_rest_leaves_nothing_open() -> None:
    """In the step in which it stops on the incline some corners still slip, and others do not."""
    run = Simulation(load_scene("incline_block", method="time_stepping", step=1e-3)).run(0.5)
    assert not [found for found in run.findings if found.check == "ambiguous"]
