# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms of bodies at rest: a statics scene that matches one is measured against it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.equilibrium.equilibrium import Element
from rb_sim.equilibrium.statics_of_scene import at_rest
from rb_sim.scene.schema import Scene

# A scene as its closed forms read it: supports in the world, loads about the centres.


Array = NDArray[np.float64]


class ExactReactions(NamedTuple):
    """The exact answer of one scene."""

    name: str
    """what it is, and the source."""
    forces: dict[str, Array]
    """by the support on its body, world [N], (3,); those of least norm if there are many."""
    ranges: Mapping[str, tuple[float, float]] = {}
    """smallest and largest normal force [N], where the reactions are not unique."""


class Standing(NamedTuple):
    """Bodies at rest, n of them."""

    bodies: tuple[str, ...]
    elements: tuple[Element, ...]
    centres: Array
    """of mass, world [m], (n, 3)."""
    loads: Array
    """force [N] and torque about the centre of mass [N m], world, (n, 6)."""


def standing_of(scene: Scene) -> Standing:
    """Place the supports and sum up the loads."""
    system = at_rest(scene)
    return Standing(system.bodies, system.elements, system.centres, system.load_about_centres())


class Weight(NamedTuple):
    """A single body that nothing but a force through its centre of mass loads."""

    size: float
    """[N]."""
    up: Array
    """against it, (3,)."""
    centre: Array
    """[m], (3,)."""


def weight_of(standing: Standing) -> Weight | None:
    """The load of a scene of one body, if it is a mere weight."""
    if len(standing.bodies) != 1:
        return None
    force, torque = standing.loads[0, :3], standing.loads[0, 3:]
    size = float(np.linalg.norm(force))
    if size == 0.0 or torque.any():
        return None
    return Weight(size, -force / size, standing.centres[0])


def of_kind(standing: Standing, kind: str, smooth: bool = False) -> list[Element]:
    """The supports of a kind; smooth: with one unknown only."""
    return [e for e in standing.elements if e.kind == kind and not (smooth and e.size > 1)]


def line(element: Element) -> Array:
    """Unit normal of a contact, or direction of a string away from its body; (3,)."""
    assert element.direction is not None  # contacts, strings and rods have one
    return element.direction


def same(a: Any, b: Any, scale: float = 1.0) -> bool:
    """Whether two vectors or numbers are one, but for rounding at `scale`."""
    return float(np.abs(np.subtract(a, b)).max()) <= COMPUTED_ROUNDING * scale


def pointing(elements: Iterable[Element], direction: Array) -> Element | None:
    """The first support along a unit vector."""
    return next((e for e in elements if same(line(e), direction)), None)


# Two weightless rods AC and CB, hinged at the top C, their feet on a floor and tied by a string.
#
#     R_A = 3 F/4,    R_B = F/4,    T = (F/4) cot alpha;    the hinge: -(R_B + T) on CB
#
# The force F acts on the middle of AC; alpha: of both rods to the floor. Landau & Lifshitz, section
# 38, problem 4.


def hinged_rods(standing: Standing) -> ExactReactions | None:
    """Forces of the floor on both feet, of the string and of the hinge, or None."""
    feet, strings = of_kind(standing, "contact", smooth=True), of_kind(standing, "string")
    hinges = [e for e in standing.elements if e.kind == "hinge" and e.size == 3]
    if (len(standing.bodies), len(standing.elements)) != (2, 4):
        return None
    if (len(feet), len(strings), len(hinges)) != (2, 1, 1):
        return None
    loaded = [i for i, load in enumerate(standing.loads) if load.any()]
    if len(loaded) != 1:
        return None
    load, centre = standing.loads[loaded[0]], standing.centres[loaded[0]]
    name = standing.bodies[loaded[0]]
    a, b = sorted(feet, key=lambda foot: foot.body != name)
    (string,), (hinge,) = strings, hinges
    pair = {a.body, b.body}
    if len(pair) != 2 or {string.body, string.parent} != pair or {hinge.body, hinge.parent} != pair:
        return None
    size = float(np.linalg.norm(load[:3]))
    A, B, C = a.anchor_W, b.anchor_W, hinge.anchor_W
    ends = {a.body: A, b.body: B}
    tied = same(string.anchor_W, ends[string.body])
    tied = tied and same(string.parent_anchor_W, ends[string.parent or ""])
    middle = same(np.cross(0.5 * (A + C) - centre, load[:3]), load[3:], size)
    if size == 0.0 or a.parent is not None or b.parent is not None or not (tied and middle):
        return None
    up, across = -load[:3] / size, 0.5 * (B - A)
    height, half = float((C - A) @ up), float(np.linalg.norm(across))
    upright = same(C - 0.5 * (A + B), height * up) and same(across @ up, 0.0)
    if height <= 0.0 or half == 0.0 or not (upright and same(line(a), up) and same(line(b), up)):
        return None
    tension = 0.25 * size * half / height
    pull = -tension * across / half  # on CB, towards A
    on_b = -(0.25 * size * up + pull)
    forces = {
        a.name: 0.75 * size * up,
        b.name: 0.25 * size * up,
        string.name: pull if string.body == b.body else -pull,
        hinge.name: on_b if hinge.body == b.body else -on_b,
    }
    return ExactReactions("two hinged rods; LL section 38, problem 4", forces)


# Ladder of weight P on a rough floor against a wall; D, H: its foot to its top, d to its centre.
#
#     N_wall = (P d - f D)/H,    N_floor = P - f,    friction at the foot N_wall
#
# f is the friction upwards at the wall: none on a smooth one; on a rough one anything that both
# coefficients allow, |f| <= mu_w N_wall and N_wall <= mu_f N_floor. In the plane of the ladder.


def ladder(standing: Standing) -> ExactReactions | None:
    """Forces of floor and wall, of least norm, with the ranges where they are many; or None."""
    weight, contacts = weight_of(standing), of_kind(standing, "contact")
    if weight is None or (len(contacts), len(standing.elements)) != (2, 2):
        return None
    P, up = weight.size, weight.up
    floor = pointing(contacts, up)
    if floor is None or floor.size == 1:
        return None
    wall = contacts[1 - contacts.index(floor)]
    into, rise = line(wall), wall.anchor_W - floor.anchor_W
    D, H = -float(rise @ into), float(rise @ up)
    arm = weight.centre - floor.anchor_W
    d, level = -float(arm @ into), float(arm @ up)
    length = math.hypot(D, H)
    plane = same(rise, H * up - D * into, length) and same(arm, level * up - d * into, length)
    if not plane or not same(into @ up, 0.0) or H <= 0.0 or not 0.0 < d <= D:
        return None
    low, high = frictions(P, d, D, H, floor.friction, wall.friction)
    if not low <= high:
        return None  # slips

    def pressed(f: float) -> float:
        return (P * d - f * D) / H

    ratio = D / H
    least = (2.0 * ratio * P * d / H + P) / (2.0 * (ratio * ratio + 1.0))
    f = min(max(least, low), high)
    forces = {
        floor.name: (P - f) * up - pressed(f) * into,
        wall.name: pressed(f) * into + f * up,
    }
    if wall.size == 1:
        return ExactReactions("ladder against a smooth wall", forces)
    spans = {floor.name: (P - high, P - low), wall.name: (pressed(high), pressed(low))}
    return ExactReactions("ladder on a rough floor against a rough wall", forces, spans)


def frictions(
    P: float, d: float, D: float, H: float, floor: float, wall: float
) -> tuple[float, float]:
    """Smallest and largest friction upwards at the wall [N]; the first is larger where it slips.

    floor, wall: coefficients. Where these are so large that the ladder jams: nan.
    """
    high = wall * P * d / (H + wall * D)
    if wall == 0.0:
        return (0.0, 0.0) if d <= floor * H else (0.0, -np.inf)
    if floor * H >= D or wall * D >= H:
        return np.nan, np.nan
    slips = P * (d - floor * H) / (D - floor * H)
    return max(slips, -wall * P * d / (H - wall * D)), high


# Rod of weight P, its end B on a horizontal plane and A on a vertical one, held by two strings.
#
#     R_B = P,    T_B = (P/2) cot alpha,    R_A = T_B sin beta,    T_A = T_B cos beta
#
# alpha: of the rod to the floor; beta: of its vertical plane to the wall. The string at B lies on
# the floor below the rod, that at A along the wall. Landau & Lifshitz, section 38, problem 3.


def rod_on_two_planes(standing: Standing) -> ExactReactions | None:
    """Forces of both planes and both strings, or None."""
    weight = weight_of(standing)
    contacts, strings = of_kind(standing, "contact", smooth=True), of_kind(standing, "string")
    if weight is None or (len(contacts), len(strings), len(standing.elements)) != (2, 2, 4):
        return None
    up = weight.up
    floor = pointing(contacts, up)
    if floor is None:
        return None
    wall = contacts[1 - contacts.index(floor)]
    rod = wall.anchor_W - floor.anchor_W
    if not same(floor.anchor_W + 0.5 * rod, weight.centre) or not same(line(wall) @ up, 0.0):
        return None
    height = float(rod @ up)
    below = rod - height * up
    width = float(np.linalg.norm(below))
    if width == 0.0 or height <= 0.0:
        return None
    sine = -float(below @ line(wall)) / width
    along = -below / width - sine * line(wall)
    cosine = float(np.linalg.norm(along))
    at_foot = pointing(strings, below / width)
    at_wall = pointing(strings, along / cosine) if cosine > 0.0 else None
    if at_foot is None or at_wall is None or sine < 0.0:
        return None
    if not same(at_foot.anchor_W, floor.anchor_W) or not same(at_wall.anchor_W, wall.anchor_W):
        return None
    pull = 0.5 * weight.size * width / height
    forces = {
        floor.name: weight.size * up,
        at_foot.name: pull * line(at_foot),
        wall.name: pull * sine * line(wall),
        at_wall.name: pull * cosine * line(at_wall),
    }
    return ExactReactions("rod on two planes; LL section 38, problem 3", forces)


# Rod of weight P and length l over the edge C of a wall of height h, its foot B on a string.
#
#     R_C = P l sin(2 alpha)/(4 h),    R_B = P - R_C sin alpha,    T = R_C cos alpha
#
# alpha: from the vertical. Landau & Lifshitz, section 38, problem 2.


def rod_over_edge(standing: Standing) -> ExactReactions | None:
    """Forces of the edge, the floor and the string, or None."""
    weight = weight_of(standing)
    contacts, strings = of_kind(standing, "contact", smooth=True), of_kind(standing, "string")
    if weight is None or (len(contacts), len(strings), len(standing.elements)) != (2, 1, 3):
        return None
    up, (string,) = weight.up, strings
    floor = pointing(contacts, up)
    if floor is None or not same(floor.anchor_W, string.anchor_W):
        return None
    edge = contacts[1 - contacts.index(floor)]
    half = weight.centre - floor.anchor_W
    length, to_edge = 2.0 * float(np.linalg.norm(half)), edge.anchor_W - floor.anchor_W
    rod, height = half / (0.5 * length), float(to_edge @ up)
    lean = rod - (rod @ up) * up
    sine, cosine = float(np.linalg.norm(lean)), float(rod @ up)
    if min(sine, cosine, height) <= 0.0 or not same(to_edge, (to_edge @ rod) * rod, length):
        return None
    ahead = lean / sine
    if not same(line(string), ahead) or not same(line(edge), sine * up - cosine * ahead):
        return None
    at_edge = weight.size * length * 2.0 * sine * cosine / (4.0 * height)
    if weight.size < at_edge * sine:
        return None  # tips over the edge
    forces = {
        edge.name: at_edge * line(edge),
        floor.name: (weight.size - at_edge * sine) * up,
        string.name: at_edge * cosine * ahead,
    }
    return ExactReactions("rod over an edge; LL section 38, problem 2", forces)


# Sphere at rest on a rough plane under a force F at its centre and a torque K, radius a.
#
#     R_n = -F_n,    R_t = 5 (K x n)/(7 a) - 2 F_t/7        (Landau & Lifshitz, section 38, problem
#     1)
#
# This is the reaction of the rolling sphere; it rests where K = a F x n, and then R = -F.


def sphere_on_plane(standing: Standing) -> ExactReactions | None:
    """The reaction of the plane, or None."""
    if len(standing.bodies) != 1 or len(standing.elements) != 1:
        return None
    (floor,) = standing.elements
    if floor.kind != "contact" or not np.isinf(floor.friction):
        return None
    n, arm = line(floor), standing.centres[0] - floor.anchor_W
    radius, force, torque = float(arm @ n), standing.loads[0, :3], standing.loads[0, 3:]
    if not same(arm, radius * n, radius) or not force @ n < 0.0:
        return None
    if not same(torque, radius * np.cross(force, n), radius * float(np.linalg.norm(force))):
        return None  # it rolls or spins
    across = force - (force @ n) * n
    reaction = -(force @ n) * n + 5.0 / (7.0 * radius) * np.cross(torque, n) - 2.0 / 7.0 * across
    name = "sphere on a rough plane; LL section 38, problem 1"
    return ExactReactions(name, {floor.name: reaction})


# Table on four smooth legs at (+-a, +-b), a load P over (x, y).
#
#     N = (P/4) (1 +- x/a +- y/b) + s (+1, -1, +1, -1)
#
# s = 0 is the least norm, and what equally stiff legs give; |s| ends where a leg lifts.


def table(standing: Standing) -> ExactReactions | None:
    """Forces of the floor on the legs, of least norm, and their ranges; or None."""
    legs = of_kind(standing, "contact", smooth=True)
    if len(standing.bodies) != 1 or len(legs) != 4 or len(standing.elements) != 4:
        return None
    up, feet = line(legs[0]), np.array([leg.anchor_W for leg in legs])
    force, torque = standing.loads[0, :3], standing.loads[0, 3:]
    size = float(-force @ up)
    flat = all(same(line(leg), up) for leg in legs) and same(force, -size * up, size)
    centre = feet.mean(axis=0)
    arms = feet - centre
    reach = float(np.linalg.norm(arms, axis=1).max())
    if not flat or size <= 0.0 or not same(arms @ up, 0.0, reach):
        return None
    opposite = [i for i in (1, 2, 3) if same(arms[i], -arms[0], reach)]
    if len(opposite) != 1:
        return None
    first, second = (i for i in (1, 2, 3) if i != opposite[0])
    a, b = 0.5 * (arms[0] - arms[first]), 0.5 * (arms[0] - arms[second])
    if not same(a @ b, 0.0, reach * reach):
        return None
    moment = torque + np.cross(standing.centres[0] - centre, force)
    at = np.cross(moment, up) / size  # where the load meets the floor
    if not same(moment @ up, 0.0, size * reach):
        return None
    normals = 0.25 * size * (1.0 + (arms @ a) * (at @ a) / (a @ a) ** 2)
    normals = normals + 0.25 * size * (arms @ b) * (at @ b) / (b @ b) ** 2
    if normals.min() < 0.0:
        return None  # a leg lifts
    signs = np.array([1.0 if i in (0, opposite[0]) else -1.0 for i in range(4)])
    down, rise = float(normals[signs > 0].min()), float(normals[signs < 0].min())
    spans = {
        leg.name: (N - (down if sign > 0 else rise), N + (rise if sign > 0 else down))
        for leg, N, sign in zip(legs, normals.tolist(), signs, strict=True)
    }
    forces = {leg.name: N * up for leg, N in zip(legs, normals, strict=True)}
    return ExactReactions("table on four legs", forces, spans)


# Closed forms of bodies at rest: one file each; a statics scene that matches one is measured.


STATICS_FORMS = (sphere_on_plane, rod_over_edge, rod_on_two_planes, hinged_rods, ladder, table)


def exact_reactions(scene: Scene) -> ExactReactions | None:
    """The exact reactions of a statics scene, or None where none are known."""
    standing = standing_of(scene)
    found = (form(standing) for form in STATICS_FORMS)
    return next((exact for exact in found if exact is not None), None)
