# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sides of bodies in supports: at samples, between them, and how deep they are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from rb_sim.base.errors import RbSimError
from tests.contact.scenes import body, box, scene, touch
from tests.contact_runs import contact_run

FALLEN = [5.0]
"""One sample, when what falls has long been through [s]."""

LOG: dict[str, Any] = {
    "surface": {"type": "cylinder", "axis": [1, 0, 0], "radius": 0.5, "side": "outside"}
}
ROD: dict[str, Any] = {"type": "rod", "length": 0.8, "axis_B": [0, 1, 0]}
DRUM = {"type": "cylinder", "radius": 0.5, "length": 0.6, "axis_B": [1, 0, 0]}
LEANING = {"axis": [0, 1, 0], "angle": 1}
OWN: dict[str, Any] = {"parent": "a", "surface": {"type": "shape"}}


def held(shape: dict[str, Any], top: float) -> dict[str, Any]:
    """A heavy body whose top is at the origin, far heavier than what falls on it."""
    return body(shape, [0, 0, -top], mass=1e6)


ACROSS: dict[str, Any] = {
    "rod on a log": scene(body(ROD, [0, 0, 0.6]), touch(**LOG)),
    "box on a log": scene(box([0.8, 0.8, 0.2], [0, 0, 0.7]), touch(**LOG)),
    "rod on a box": scene(
        {"body": body(ROD, [0, 0, 0.1]), "a": held({"type": "box", "size": [0.4, 0.4, 0.4]}, 0.2)},
        touch(**OWN),
    ),
    "box on a box": scene(
        {
            "body": box([0.8, 0.1, 0.2], [0, 0, 0.2]),
            "a": held({"type": "box", "size": [0.4, 0.4, 0.4]}, 0.2),
        },
        touch(**OWN),
    ),
    "box on the rim of a drum": scene(
        {
            "body": box([0.8, 0.8, 0.2], [0.25, 0, 0.2], orientation=LEANING),
            "a": held(DRUM, 0.5),
        },
        touch(**OWN),
    ),
    "a corner below a box": scene(
        {
            "body": box([0.8, 0.8, 0.2], [0, 0, 0.35]),
            "a": body({"type": "box", "size": [0.3, 0.3, 0.3]}, [0, 0, -0.15], mass=1e6)
            | {"orientation": {"axis": [1, 0.2, 0], "angle": 0.6}},
        },
        touch(**OWN),
    ),
}  # fmt: skip
for mapping in ACROSS.values():
    mapping["effects"]["weight"] = mapping["effects"]["weight"] | {"bodies": ["body"]}


@pytest.mark.parametrize("name", ACROSS)
def test_going_through_between_samples_is_reported(name: str) -> None:
    with pytest.raises(
        RbSimError,
        match=r"the body penetrates the support of contact floor by .* at t = 0\.",
    ):
        contact_run(ACROSS[name], FALLEN, tolerance=1e-8)


BOX_BELOW = held({"type": "box", "size": [0.2, 0.2, 0.4]}, 0.2)
DRUM_BELOW = held({"type": "cylinder", "radius": 0.1 * math.sqrt(2.0), "length": 0.4}, 0.2)


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("under", [BOX_BELOW, DRUM_BELOW])
def test_what_falls_flush_with_its_support_does_not_fall_through(under: Any, turn: float) -> None:
    """Its corners slide along the sides of what is below, at distance 0 from it all the way."""
    about = {"orientation": {"axis": [0, 0, 1], "angle": turn}}
    bodies = {"body": box([0.2, 0.2, 0.2], [0, 0, 0.11], **about), "a": under | about}
    made = scene(bodies, touch(**OWN, mu=0.5))
    made["effects"]["weight"] = made["effects"]["weight"] | {"bodies": ["body"]}
    with pytest.raises(RbSimError, match=r"the body penetrates the support.* time_stepping"):
        contact_run(made, [1.0], tolerance=1e-8)


def test_going_through_between_samples_is_reported_in_steps() -> None:
    steps = {"method": "time_stepping", "step": 1e-2, "tolerance": None}
    with pytest.raises(RbSimError, match=r"the body penetrates .* at t = 0\."):
        contact_run(ACROSS["rod on a log"], FALLEN, **steps)


def test_what_comes_at_speed_is_reported() -> None:
    """A rod thrown at 300 m/s is through the log in 3 ms."""
    thrown = ACROSS["rod on a log"] | {
        "bodies": {
            "body": ACROSS["rod on a log"]["bodies"]["body"]
            | {"position": [0, 0, 60.0], "linear_velocity": [0, 0, -300.0]}
        }
    }
    with pytest.raises(RbSimError, match=r"the body penetrates .* at t = 0\.19[78]"):
        contact_run(thrown, [1.0], tolerance=1e-8)


def standing(**more: Any) -> dict[str, Any]:
    """A box that comes down on its corners upon a box."""
    under = held({"type": "box", "size": [1.0, 1.0, 0.4]}, 0.2)
    falling = box([0.3, 0.2, 0.1], [0, 0, 0.2], angular_velocity=[1.0, 0.5, 2.0]) | more
    made = scene({"body": falling, "a": under}, touch(**OWN, mu=0.5, restitution=0.3))
    made["effects"]["weight"] = made["effects"]["weight"] | {"bodies": ["body"]}
    return made


def test_looks_change_no_bit_of_a_motion() -> None:
    rare = contact_run(standing(), [0.6], tolerance=1e-9)
    often = contact_run(standing(), np.linspace(0.0, 0.6, 601).tolist(), tolerance=1e-9)
    for field in ("position", "orientation", "linear_velocity", "angular_velocity"):
        a, b = (getattr(run.trajectory, field)["body"][-1] for run in (rare, often))
        assert_array_equal(a, b)
    assert rare.times("impact") == often.times("impact")


# Sides between the points with which a body touches: never in a support without a word.


@pytest.mark.parametrize("name", ACROSS)
def test_sinking_is_reported(name: str) -> None:
    with pytest.raises(
        RbSimError,
        match=r"the body penetrates the support of contact floor by .* at t = ",
    ):
        contact_run(ACROSS[name], np.linspace(0.0, 0.35, 36).tolist(), tolerance=1e-8)


STEPS = {"method": "time_stepping", "step": 1e-3, "tolerance": None}


@pytest.mark.parametrize(("yaw", "how"), [(0.2, STEPS), (3e-4, {"tolerance": 1e-8})])
def test_a_short_rod_in_a_wide_scene_is_judged_by_its_own_size(
    yaw: float, how: dict[str, Any]
) -> None:
    """It rests across a log on its two ends; its middle lies (l sin(yaw))^2 / 2 r deep, l: half its
    length: a small part of the distance to the other body in the scene."""
    r, across = 0.2, 0.04 * math.sin(yaw)
    depth = r - math.sqrt(r * r - across * across)
    short = {"type": "rod", "length": 0.08, "axis_B": [math.cos(yaw), math.sin(yaw), 0]}
    log = LOG | {"surface": LOG["surface"] | {"radius": r}}
    bodies = {"body": body(short, [0, 0, r - depth]), "far": box([1, 1, 1], [60.0, 0, 0])}
    made = scene(bodies, touch(**log, mu=0.5))
    made["effects"]["weight"] = made["effects"]["weight"] | {"bodies": ["body"]}
    with pytest.raises(RbSimError, match=f"the body penetrates .* by {depth:.2g} m"):
        contact_run(made, [0.1], **how)


def test_corners_and_ends_that_touch_are_no_sides() -> None:
    """A box that stands on a box, and a rod that lies along a log."""
    under = held({"type": "box", "size": [1.0, 1.0, 0.4]}, 0.2)
    standing = scene({"body": box([0.3, 0.2, 0.1], [0, 0, 0.05]), "a": under}, touch(**OWN, mu=0.5))
    standing["effects"]["weight"] = standing["effects"]["weight"] | {"bodies": ["body"]}
    along = ROD | {"axis_B": [1, 0, 0]}
    slides = body(along, [0, 0.5 * math.sin(0.1), 0.5 * math.cos(0.1)])
    for mapping in (standing, scene(slides, touch(**LOG))):
        found = contact_run(mapping, np.linspace(0.0, 0.2, 9).tolist(), tolerance=1e-8)
        assert found.trajectory.residual.max() <= 1e-10
