# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every shape on every support that a parent carries, which turns: momenta, power, reactions.

The supports' middles and the shapes' centres lie beside both centres of mass.  A point, an edge, a
face or both points of a rim touch: as many points of contact as are named are closed at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.surfaces import MAKERS
from tests.balance import Balance, assert_balanced, balance_at, random_motion, two_bodies
from tests.interpreted import interpreted
from tests.moving import difference, unit

BESIDE = {"center_B": [0.02, 0.01, 0.03]}
AXIS = {"axis_B": [0.0, 0.6, 0.8]}
SHAPES: dict[str, dict[str, Any]] = {
    "sphere": {"type": "sphere", "radius": 0.3} | BESIDE,
    "ellipsoid": {"type": "ellipsoid", "semi_axes": [0.3, 0.2, 0.25]} | BESIDE,
    "disk": {"type": "disk", "radius": 0.3} | BESIDE | AXIS,
    "cylinder": {"type": "cylinder", "radius": 0.2, "length": 0.5} | BESIDE | AXIS,
    "box": {"type": "box", "size": [0.3, 0.4, 0.5]} | BESIDE,
    "rod": {"type": "rod", "length": 0.6} | BESIDE | AXIS,
}
LISTED = "listed points"
CLOUD = [[0.3, 0.1, 0.0], [-0.2, 0.25, 0.1], [0.0, -0.3, 0.1], [0.1, 0.0, 0.35], [0.0, 0.1, -0.3]]
MIDDLE, ALONG = [0.1, 0.2, 0.3], [0.6, 0.0, 0.8]
SUPPORTS: dict[str, dict[str, Any]] = {
    "plane": {"type": "plane", "point": [0.1, -0.2, 0.3], "normal": [0.48, -0.6, 0.64]},
    "ball": {"type": "sphere", "center": MIDDLE, "radius": 0.5},
    "bowl": {"type": "sphere", "center": MIDDLE, "radius": 2.0, "side": "inside"},
    "log": {"type": "cylinder", "point": MIDDLE, "axis": ALONG, "radius": 0.5, "side": "outside"},
    "pipe": {"type": "cylinder", "point": MIDDLE, "axis": ALONG, "radius": 2.0},
}
SOLIDS: dict[str, dict[str, Any]] = {
    "own ball": {"type": "sphere", "radius": 0.5} | BESIDE,
    "own box": {"type": "box", "size": [0.6, 0.8, 1.0]} | BESIDE,
    "own drum": {"type": "cylinder", "radius": 0.5, "length": 1.2} | BESIDE | AXIS,
}
CANNOT = {
    ("cylinder", "log"), ("ellipsoid", "own box"), ("ellipsoid", "own drum"), ("disk", "own box"),
    ("disk", "own drum"), ("cylinder", "own box"), ("cylinder", "own drum"),
}  # fmt: skip
"""Pairs that are refused."""
HOLLOW = ("bowl", "pipe")
SEVERAL: dict[tuple[str, str], tuple[tuple[int, ...], ...]] = {
    ("cylinder", "plane"): ((0, 1), (0, 3, 5)),
    ("box", "plane"): ((0, 1), (0, 1, 2)),
    ("rod", "plane"): ((0, 1),),
    ("cylinder", "bowl"): ((0, 1),),
    ("box", "bowl"): ((0, 1), (0, 1, 2)),
    ("rod", "bowl"): ((0, 1),),
    ("disk", "pipe"): ((0, 1),),
    ("cylinder", "pipe"): ((0, 1), (0, 2)),
    ("box", "pipe"): ((0, 1), (0, 1, 2)),
    ("rod", "pipe"): ((0, 1),),
    ("disk", "log"): ((0, 1),),
    ("rod", "log"): ((0, 1),),
    ("box", "own box"): ((0, 1),),
    (LISTED, "bowl"): ((0, 1, 2),),
}
"""Points that touch at once: edges, faces, both rims, both points of one rim, an end that lies."""
FRICTION = {"friction": {"type": "coulomb", "static": 0.5, "kinetic": 0.3}}
RESISTS = {"rolling_resistance": 0.01, "spinning_resistance": 0.02}
SLIDES, STICKS, NONE = 1.0, 2.0, 0.0
STARTS = 20
"""Places from which the points are brought to touch; two of a rim may have to be looked for."""
TOUCHES = 1e-10
"""Gap of points that touch [m]."""


class Meeting(NamedTuple):
    """What touches what, and with which of its points."""

    shape: str
    support: str
    points: tuple[int, ...] = (0,)


MEETINGS = [
    Meeting(shape, support, points)
    for shape, support in itertools.product((*SHAPES, LISTED), (*SUPPORTS, *SOLIDS))
    if (shape, support) not in CANNOT
    for points in ((0,), *SEVERAL.get((shape, support), ()))
]


def test_every_shape_is_here() -> None:
    assert set(SHAPES) == set(MAKERS)


def scene_of(meeting: Meeting, **law: Any) -> dict[str, Any]:
    surface = SUPPORTS.get(meeting.support, {"type": "shape"})
    parent = {"shape": SOLIDS[meeting.support]} if meeting.support in SOLIDS else {}
    far = [0.0, 0.0, 0.4] if meeting.support in HOLLOW else [2.0, 2.5, 3.0]
    place = {"position": (np.array([0.3, 0.8, -0.4]) + far).tolist()}
    own = {"type": "contact", "surface": surface} | law
    own |= {"points": CLOUD} if meeting.shape == LISTED else {}
    return two_bodies(own, a=parent, body={"shape": SHAPES.get(meeting.shape)} | place)


def met(compiled: Any, meeting: Meeting, rng: np.random.Generator) -> np.ndarray:
    """Random places and attitudes; the body shifted and turned until the points touch."""
    from rb_sim.mechanics.contact.accelerations import contact_accelerations
    from rb_sim.mechanics.contact.contact_bodies import GAP

    system, y = compiled.system, compiled.y.copy()
    y[0:3], y[3:7] = rng.normal(size=3), unit(rng, 4)
    middle = y[0:3] + Rotation.from_quat(y[3:7]).apply(MIDDLE)

    def gaps(x: np.ndarray) -> np.ndarray:
        turned = Rotation.from_rotvec(x[3:]) * Rotation.from_quat(start[16:20])
        y[13:16], y[16:20] = start[13:16] + x[:3], turned.as_quat()
        contact_accelerations(system, 0.0, y)
        return system.contact_table[list(meeting.points), GAP].copy()

    for _ in range(STARTS):
        y[13:16] = middle + np.array(unit(rng)) * (1.0 if meeting.support in HOLLOW else 1.5)
        y[16:20] = unit(rng, 4)
        start = y.copy()
        if np.abs(gaps(root(gaps))).max() <= TOUCHES:
            return y
    raise AssertionError(f"{meeting}: its points do not come to touch")


def root(gaps: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The shift and turn, shape (6,), at which Newton's method ends: of least change each time."""
    x, h = np.zeros(6), 1e-7
    for _ in range(60):
        gap = gaps(x)
        if np.abs(gap).max() <= TOUCHES:
            break
        slopes = np.stack([(gaps(x + h * e) - gap) / h for e in np.eye(6)], axis=1)
        change = np.linalg.lstsq(slopes, gap, rcond=None)[0]
        x = x - change / max(1.0, float(np.linalg.norm(change)))
    return x


class Found(NamedTuple):
    """What a meeting shows at one instant."""

    balance: Balance
    pushes: np.ndarray
    """normal forces of the points [N]."""
    leaving: float
    """largest acceleration of what holds: of the gaps, of the slips too where they stick."""


def found_of(meeting: Meeting, mode: float, seed: int) -> Found:
    from rb_sim import load_scene
    from rb_sim.contact.events.search import begin_step
    from rb_sim.mechanics.contact.contact_bodies import CLOSED, NORMAL_FORCE, ROLL, SLIDE, SPIN
    from rb_sim.mechanics.contact.motion_kernels import contact_rate
    from rb_sim.scene.compile import compile_scene

    law = FRICTION | (RESISTS if mode == SLIDES else {})
    compiled = compile_scene(load_scene(scene_of(meeting, **law)))
    system, rng = compiled.system, np.random.default_rng(seed)
    points, touch = list(meeting.points), system.contact_table
    touch[:, CLOSED] = 0.0
    y = met(compiled, meeting, rng)
    touch[points, CLOSED] = 1.0
    touch[points, SLIDE] = mode
    for column in (ROLL, SPIN):
        touch[points, column] = SLIDES if mode == SLIDES else NONE
    y = random_motion(system, y, rng, False)
    begin_step(system, 0.0, y, np.zeros_like(y))
    slope = np.zeros_like(y)
    contact_rate(system, 0.0, y, slope)
    pushes = touch[points, NORMAL_FORCE].copy()
    held = held_velocities(system, points, mode, y)
    leaving = np.abs(difference(lambda t: held(y + t * slope))).max()
    return Found(balance_at(compiled, y), pushes, float(leaving))


def held_velocities(system: Any, points: list[int], mode: float, y: np.ndarray) -> Any:
    """A function of a state near y: what stays zero there."""
    from rb_sim.mechanics.contact.accelerations import contact_accelerations
    from rb_sim.mechanics.contact.contact_bodies import GAP_RATE, SLIP

    columns = [GAP_RATE, *(range(SLIP, SLIP + 3) if mode == STICKS else ())]

    def held(state: np.ndarray) -> np.ndarray:
        contact_accelerations(system, 0.0, state)
        return system.contact_table[np.ix_(points, columns)].copy()

    assert np.abs(held(y)).max() <= 1e-11
    return held


def name_of(meeting: Meeting) -> str:
    return f"{meeting.shape} {meeting.support} {meeting.points}"


def check(number: int, mode: float) -> Found:
    """Momenta stay, dE/dt is the power reported, each body moves by what is reported, and what
    holds goes on holding."""
    found = interpreted(found_of, MEETINGS[number], mode, number)
    assert_balanced(found.balance)
    assert found.balance.unexplained <= 1e-10 * found.balance.size
    assert found.leaving <= 1e-8 * found.balance.size
    return found


@pytest.mark.parametrize("number", range(len(MEETINGS)), ids=[name_of(m) for m in MEETINGS])
def test_sliding_balances(number: int) -> None:
    """A push takes energy."""
    found = check(number, SLIDES)
    assert found.balance.energy_rate < 0.0 or not (found.pushes > 0.0).all()


STUCK = [i for i, meeting in enumerate(MEETINGS) if len(meeting.points) > 1]


@pytest.mark.parametrize("number", STUCK, ids=[name_of(MEETINGS[i]) for i in STUCK])
def test_sticking_balances(number: int) -> None:
    """Several points at rest on the support take none."""
    found = check(number, STICKS)
    assert abs(found.balance.power) <= 1e-10 * found.balance.size
