# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Three more scenes, of several bodies and of a rolling ellipsoid, and their minimal equations.

Each is given as a mapping for rb_sim and as equations derived apart from it: Lagrange's in angles
(double pendulum, four-bar linkage), Newton-Euler in world axes (rattleback).  In the planar scenes
a bar lies along (cos a, 0, -sin a) and is turned by a about +y.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

G = 9.81

Terms = Any


class Functions(NamedTuple):
    """Of the number type in use."""

    sin: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]


class More(NamedTuple):
    """One scene."""

    scene: dict[str, Any]
    start: Callable[[Any], list[Any]]
    """(number type) -> initial values of the equations."""
    rates: Callable[[Terms, Functions], list[Any]]
    poses: Callable[[Terms, Functions], list[list[Any]]]
    """x, y, z of the centre of mass and the quaternion of every body."""
    forces: Callable[[Terms, Terms, Functions], list[list[Any]]]
    """(values, their rates) -> force of every constraint on its body, by its name in `joints`."""
    joints: tuple[str, ...]
    planar: bool
    """forces across the plane of the motion are not compared: a loop does not determine them."""
    compact: bool = False
    """heyoka is to write loops, for its straight code takes minutes to compile."""


class Bar(NamedTuple):
    """A homogeneous bar."""

    mass: float
    length: float

    @property
    def moment(self) -> float:
        """About its centre, across it [kg m^2]."""
        return self.mass * self.length * self.length / 12.0

    def body(self, centre: Terms, angle: float, velocity: Terms, turn: float) -> dict[str, Any]:
        """As rb_sim takes it."""
        half = 0.5 * angle
        return {
            "mass": self.mass,
            "inertia": [0.5 * self.moment, self.moment, self.moment],
            "position": list(map(float, centre)),
            "orientation": [0.0, float(np.sin(half)), 0.0, float(np.cos(half))],
            "linear_velocity": list(map(float, velocity)),
            "angular_velocity": [0.0, float(turn), 0.0],
        }


def hinge(body: str, at: float, parent: str | None = None, there: Any = None) -> dict[str, Any]:
    """A hinge about y at x = `at` of the bar; there: x on the parent, or the place in the world."""
    joint: dict[str, Any] = {"type": "fixed_axis", "body": body, "point_B": [at, 0.0, 0.0]}
    joint |= {"axis_B": [0.0, 1.0, 0.0], "bearing_distance": 0.1}
    if parent is not None:
        return joint | {"parent": parent, "point_A": [there, 0.0, 0.0]}
    return joint | ({} if there is None else {"point_A": there})


def planar_pose(f: Functions, x: Any, z: Any, angle: Any) -> list[Any]:
    return [x, 0.0, z, 0.0, f.sin(0.5 * angle), 0.0, f.cos(0.5 * angle)]


def scene_of(bodies: dict[str, Any], joints: dict[str, Any], duration: float) -> dict[str, Any]:
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -G]}
    options = {"duration": duration, "rate": 20.0, "project_initial": True}
    return {
        "bodies": bodies,
        "constraints": joints,
        "effects": {"weight": weight},
        "simulation": options,
    }


UPPER, LOWER = Bar(1.0, 0.8), Bar(0.7, 0.6)
PENDULUM = (0.4, 2.1)
"""Angles at the start, at rest."""


def pendulum_rates(y: Terms, f: Functions) -> list[Any]:
    """A a1'' + B cos(d) a2'' = ..., B cos(d) a1'' + C a2'' = ..., d = a1 - a2 (Lagrange)."""
    one, two, w1, w2 = y
    c, s = f.cos(one - two), f.sin(one - two)
    a = UPPER.moment + UPPER.mass * UPPER.length**2 / 4.0 + LOWER.mass * UPPER.length**2
    b = LOWER.mass * UPPER.length * LOWER.length / 2.0
    d = LOWER.moment + LOWER.mass * LOWER.length**2 / 4.0
    # the height of the centre of a bar is -(length/2) sin(angle)
    first = G * UPPER.length * (0.5 * UPPER.mass + LOWER.mass) * f.cos(one) - b * s * (w2 * w2)
    second = 0.5 * G * LOWER.length * LOWER.mass * f.cos(two) + b * s * (w1 * w1)
    whole = a * d - (b * b) * (c * c)
    return [w1, w2, (d * first - b * c * second) / whole, (a * second - b * c * first) / whole]


def tip(f: Functions, angle: Any, w: Any, rate: Any, along: float) -> tuple[Any, Any, Any, Any]:
    """x, z and their second derivatives at `along` on a bar from its fixed end."""
    c, s = f.cos(angle), f.sin(angle)
    return (
        along * c,
        -along * s,
        -along * (s * rate + c * (w * w)),
        -along * (c * rate - s * (w * w)),
    )


def pendulum_poses(y: Terms, f: Functions) -> list[list[Any]]:
    x1, z1, _, _ = tip(f, y[0], 0.0, 0.0, 0.5 * UPPER.length)
    x2, z2, _, _ = tip(f, y[1], 0.0, 0.0, 0.5 * LOWER.length)
    return [planar_pose(f, x1, z1, y[0]), planar_pose(f, 2.0 * x1 + x2, 2.0 * z1 + z2, y[1])]


def pendulum_forces(y: Terms, r: Terms, f: Functions) -> list[list[Any]]:
    """m a = F + m g for the lower bar, then for both."""
    _, _, ax1, az1 = tip(f, y[0], y[2], r[2], 0.5 * UPPER.length)
    _, _, ax2, az2 = tip(f, y[1], y[3], r[3], 0.5 * LOWER.length)
    lower = [LOWER.mass * (2.0 * ax1 + ax2), 0.0, LOWER.mass * (2.0 * az1 + az2 + G)]
    upper = [UPPER.mass * ax1 + lower[0], 0.0, UPPER.mass * (az1 + G) + lower[2]]
    return [upper, lower]


def double_pendulum() -> More:
    one, two = PENDULUM
    c1 = np.array([np.cos(one), 0.0, -np.sin(one)])
    c2 = np.array([np.cos(two), 0.0, -np.sin(two)])
    at1, at2 = 0.5 * UPPER.length * c1, UPPER.length * c1 + 0.5 * LOWER.length * c2
    rest = [0.0, 0.0, 0.0]
    bodies = {"upper": UPPER.body(at1, one, rest, 0.0), "lower": LOWER.body(at2, two, rest, 0.0)}
    half = 0.5 * UPPER.length
    joints = {
        "shoulder": hinge("upper", -half, None, [0.0, 0.0, 0.0]),
        "elbow": hinge("lower", -0.5 * LOWER.length, "upper", half),
    }
    return More(
        scene_of(bodies, joints, 5.0),
        lambda number: [number(one), number(two), number(0.0), number(0.0)],
        pendulum_rates,
        pendulum_poses,
        pendulum_forces,
        ("shoulder", "elbow"),
        True,
    )


CRANK, COUPLER, ROCKER = Bar(0.6, 0.3), Bar(1.2, 0.8), Bar(1.0, 0.7)
GROUND, TURN = 0.9, -8.0
"""Distance of the fixed pivots [m], and the crank's rate at the start [rad/s]; its angle is 0.5."""


def closed(number: Any) -> tuple[Any, Any, Any]:
    """The angles of crank, coupler and rocker at the start, by the law of cosines."""
    first = number(0.5)
    x = number(GROUND) - number(CRANK.length) * np.cos(first)
    z = number(CRANK.length) * np.sin(first)  # from the crank's end to the far pivot
    square = x * x + z * z
    reach, turn = np.sqrt(square), np.arctan2(-z, x)
    a, b = number(COUPLER.length), number(ROCKER.length)
    inner = np.arccos((square + a * a - b * b) / (2 * a * reach))
    second = turn - inner
    end_x = -x + a * np.cos(second)
    end_z = -z - a * np.sin(second)
    return first, second, np.arctan2(-end_z, end_x)


def ratios(y: Terms, f: Functions) -> tuple[Any, Any, Any, Any]:
    """Rates of coupler and rocker over the crank's, by the closed loop, and their derivatives by
    the crank's angle."""
    one, two, three = y[:3]
    a, b, c = CRANK.length, COUPLER.length, ROCKER.length
    below = f.sin(two - three)
    k2, k3 = a * f.sin(three - one) / (b * below), a * f.sin(two - one) / (c * below)
    apart = f.cos(two - three) * (k2 - k3)
    slope2 = (a * f.cos(three - one) * (k3 - 1.0) - b * k2 * apart) / (b * below)
    slope3 = (a * f.cos(two - one) * (k2 - 1.0) - c * k3 * apart) / (c * below)
    return k2, k3, slope2, slope3


def linkage_rates(y: Terms, f: Functions) -> list[Any]:
    """M w' + M'/2 w^2 + V' = 0 with M(crank) the moment of all and ' along the motion."""
    one, two, three, w = y
    k2, k3, slope2, slope3 = ratios(y, f)
    a, b = CRANK.length, 0.5 * COUPLER.length
    own = CRANK.moment + CRANK.mass * a * a / 4.0 + COUPLER.mass * a * a
    second = COUPLER.moment + COUPLER.mass * b * b
    third = ROCKER.moment + ROCKER.mass * ROCKER.length**2 / 4.0
    # the coupler's centre goes at a w across the crank and b k2 w across itself
    mixed, c, s = 2.0 * COUPLER.mass * a * b, f.cos(one - two), f.sin(one - two)
    moment = own + second * k2 * k2 + third * k3 * k3 + mixed * k2 * c
    change = 2.0 * (second * k2 * slope2 + third * k3 * slope3)
    change = change + mixed * (slope2 * c - k2 * s * (1.0 - k2))
    weight = (0.5 * CRANK.mass + COUPLER.mass) * a * f.cos(one)
    weight = weight + COUPLER.mass * b * k2 * f.cos(two)
    weight = weight + 0.5 * ROCKER.mass * ROCKER.length * k3 * f.cos(three)
    return [w, k2 * w, k3 * w, (G * weight - 0.5 * change * (w * w)) / moment]


def linkage_poses(y: Terms, f: Functions) -> list[list[Any]]:
    x1, z1, _, _ = tip(f, y[0], 0.0, 0.0, 0.5 * CRANK.length)
    x2, z2, _, _ = tip(f, y[1], 0.0, 0.0, 0.5 * COUPLER.length)
    x3, z3, _, _ = tip(f, y[2], 0.0, 0.0, 0.5 * ROCKER.length)
    return [
        planar_pose(f, x1, z1, y[0]),
        planar_pose(f, 2.0 * x1 + x2, 2.0 * z1 + z2, y[1]),
        planar_pose(f, GROUND + x3, z3, y[2]),
    ]


def linkage_forces(y: Terms, r: Terms, f: Functions) -> list[list[Any]]:
    """Moments about the pivots of coupler and rocker give the force between them; then the sums."""
    k2, k3, slope2, slope3 = ratios(y, f)
    square = y[3] * y[3]
    rates = [r[3], k2 * r[3] + slope2 * square, k3 * r[3] + slope3 * square]
    speeds = [y[3], k2 * y[3], k3 * y[3]]
    (_, _, ax1, az1), (x2, z2, ux, uz), (x3, z3, ax3, az3) = (
        tip(f, y[i], speeds[i], rates[i], 0.5 * bar.length)
        for i, bar in enumerate((CRANK, COUPLER, ROCKER))
    )
    ax2, az2 = 2.0 * ax1 + ux, 2.0 * az1 + uz
    # P: force on the coupler at its far end. About the other end, with (r x F)_y = z F_x - x F_z:
    # J a + m (z ax - x (az + g)) = 2 (z P_x - x P_z), and the rocker with -P about its pivot
    left2 = COUPLER.moment * rates[1] + COUPLER.mass * (z2 * ax2 - x2 * (az2 + G))
    left3 = ROCKER.moment * rates[2] + ROCKER.mass * (z3 * ax3 - x3 * (az3 + G))
    whole = 4.0 * (x2 * z3 - z2 * x3)
    px = (-2.0 * x3 * left2 - 2.0 * x2 * left3) / whole
    pz = (-2.0 * z3 * left2 - 2.0 * z2 * left3) / whole
    near = [COUPLER.mass * ax2 - px, 0.0, COUPLER.mass * (az2 + G) - pz]
    crank = [CRANK.mass * ax1 + near[0], 0.0, CRANK.mass * (az1 + G) + near[2]]
    rocker = [ROCKER.mass * ax3 + px, 0.0, ROCKER.mass * (az3 + G) + pz]
    return [crank, near, [px, 0.0, pz], rocker]


def four_bar() -> More:
    angles = closed(float)
    functions = Functions(np.sin, np.cos, np.sqrt)
    k2, k3, _, _ = ratios(angles, functions)
    turns = [TURN, float(k2 * TURN), float(k3 * TURN)]
    poses = linkage_poses([*angles, TURN], functions)

    def end(angle: float, turn: float, length: float) -> np.ndarray:
        """Velocity of the end of a bar from the other."""
        return turn * length * np.array([-np.sin(angle), 0.0, -np.cos(angle)])

    bars = {"crank": CRANK, "coupler": COUPLER, "rocker": ROCKER}
    half = [end(a, w, 0.5 * b.length) for a, w, b in zip(angles, turns, bars.values(), strict=True)]
    speeds = [half[0], 2.0 * half[0] + half[1], half[2]]
    bodies = {
        name: bar.body(pose[:3], float(a), v, w)
        for (name, bar), pose, a, v, w in zip(
            bars.items(), poses, angles, speeds, turns, strict=True
        )
    }
    joints = {
        "main": hinge("crank", -0.5 * CRANK.length, None, [0.0, 0.0, 0.0]),
        "near": hinge("coupler", -0.5 * COUPLER.length, "crank", 0.5 * CRANK.length),
        "far": hinge("coupler", 0.5 * COUPLER.length, "rocker", 0.5 * ROCKER.length),
        "side": hinge("rocker", -0.5 * ROCKER.length, None, [GROUND, 0.0, 0.0]),
    }
    return More(
        scene_of(bodies, joints, 4.0),
        lambda number: [*closed(number), number(TURN)],
        linkage_rates,
        linkage_poses,
        linkage_forces,
        ("main", "near", "far", "side"),
        True,
    )


STONE_MASS = 1.0
STONE = np.array([[2.0e-3, -2.0e-4, 0.0], [-2.0e-4, 1.6e-2, 0.0], [0.0, 0.0, 1.7e-2]])
AXES, ABOVE = (0.2, 0.03, 0.02), 0.01
"""Half axes of the ellipsoid, and its centre above the centre of mass, body axes."""


def matrix(q: Terms) -> list[list[Any]]:
    x, y, z, s = q
    return [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * s), 2.0 * (x * z + y * s)],
        [2.0 * (x * y + z * s), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * s)],
        [2.0 * (x * z - y * s), 2.0 * (y * z + x * s), 1.0 - 2.0 * (x * x + y * y)],
    ]


def times(a: Any, b: Any) -> list[list[Any]]:
    return [[sum_of(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def sum_of(terms: Any) -> Any:
    total = None
    for term in terms:
        total = term if total is None else total + term
    return total


def vector(a: Any, v: Terms) -> list[Any]:
    return [sum_of(a[i][k] * v[k] for k in range(3)) for i in range(3)]


def across(a: Terms, b: Terms) -> list[Any]:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def plus(*terms: Terms) -> list[Any]:
    return [sum_of(parts) for parts in zip(*terms, strict=True)]


def minus(a: Terms) -> list[Any]:
    return [-x for x in a]


def in_world(r: Any, body: Any) -> list[list[Any]]:
    """R B R^T."""
    turned = [[r[j][i] for j in range(3)] for i in range(3)]
    return times(times(r, body), turned)


def stone_arm(q: Terms, w: Terms, f: Functions) -> tuple[list[Any], list[Any]]:
    """From C to the contact and its rate, world axes: -S n / sqrt(n S n) + R c, S = R D R^T."""
    r = matrix(q)
    squares = [[AXES[i] ** 2 if i == j else 0.0 for j in range(3)] for i in range(3)]
    s = in_world(r, squares)
    column = [s[i][2] for i in range(3)]
    centre = vector(r, [0.0, 0.0, ABOVE])
    # S' n = w x (S n) - S (w x n), n = z
    turned = vector(s, [w[1], -w[0], 0.0 * w[0]])
    rate = plus(across(w, column), minus(turned))
    root = f.sqrt(column[2])
    slope = 0.5 * rate[2] / (column[2] * root)
    arm = [-x / root for x in column]
    arm_rate = [-x / root + y * slope for x, y in zip(rate, column, strict=True)]
    return plus(arm, centre), plus(arm_rate, across(w, centre))


def solve(a: Any, b: Terms) -> list[Any]:
    """Cramer's rule."""
    c = [across(a[1], a[2]), across(a[2], a[0]), across(a[0], a[1])]
    det = sum_of(a[0][k] * c[0][k] for k in range(3))
    return [sum_of(c[i][k] * b[i] for i in range(3)) / det for k in range(3)]


def stone_turning(y: Terms, f: Functions) -> tuple[list[Any], list[Any]]:
    """(w', acceleration of C): m a = F + m g, I w' + w x I w = arm x F, a + (w x arm)' = 0."""
    q, w = y[3:7], y[7:10]
    arm, arm_rate = stone_arm(q, w, f)
    inertia = in_world(matrix(q), STONE.tolist())
    square = sum_of(x * x for x in arm)
    about = [
        [
            inertia[i][j] + STONE_MASS * ((square if i == j else 0.0 * square) - arm[i] * arm[j])
            for j in range(3)
        ]
        for i in range(3)
    ]
    carried = across(w, arm_rate)
    push = [STONE_MASS * -x for x in carried]
    push[2] = push[2] + STONE_MASS * G
    right = plus(across(arm, push), minus(across(w, vector(inertia, w))))
    turning = solve(about, right)
    return turning, minus(plus(across(turning, arm), carried))


def stone_rates(y: Terms, f: Functions) -> list[Any]:
    """Of the centre of mass, the quaternion (q' = (w, 0) q / 2) and w in world axes."""
    x, b, z, s = y[3:7]
    p, q, r = y[7:10]
    arm, _ = stone_arm(y[3:7], y[7:10], f)
    turn = [
        0.5 * (p * s + q * z - r * b),
        0.5 * (q * s + r * x - p * z),
        0.5 * (r * s + p * b - q * x),
        -0.5 * (p * x + q * b + r * z),
    ]
    return [*minus(across(y[7:10], arm)), *turn, *stone_turning(y, f)[0]]


def stone_poses(y: Terms, f: Functions) -> list[list[Any]]:
    return [list(y[:7])]


def stone_forces(y: Terms, r: Terms, f: Functions) -> list[list[Any]]:
    _, a = stone_turning(y, f)
    return [[STONE_MASS * a[0], STONE_MASS * a[1], STONE_MASS * (a[2] + G)]]


def rattleback() -> More:
    half = 0.5 * 0.03
    plain = Functions(np.sin, np.cos, np.sqrt)

    def start(number: Any) -> list[Any]:
        q = [number(0.0), np.sin(number(half)), number(0.0), np.cos(number(half))]
        w = [number(0.0), number(0.0), number(-3.0)]
        arm, _ = stone_arm(q, w, plain)
        return [number(0.0), number(0.0), -arm[2], *q, *w]

    first = start(float)
    spin = [sum_of(matrix(first[3:7])[k][i] * first[7 + k] for k in range(3)) for i in range(3)]
    body = {
        "mass": STONE_MASS,
        "inertia": STONE.tolist(),
        "shape": {"type": "ellipsoid", "semi_axes": list(AXES), "center_B": [0.0, 0.0, ABOVE]},
        "position": list(map(float, first[:3])),
        "orientation": list(map(float, first[3:7])),
        "angular_velocity": list(map(float, spin)),
        "linear_velocity": list(map(float, stone_rates(first, plain)[:3])),
    }
    joints = {"floor": {"type": "rolling", "body": "stone"}}
    return More(
        scene_of({"stone": body}, joints, 4.0),
        start,
        stone_rates,
        stone_poses,
        stone_forces,
        ("floor",),
        False,
        True,
    )


MORE: dict[str, Callable[[], More]] = {
    "rattleback": rattleback,
    "double_pendulum": double_pendulum,
    "four_bar": four_bar,
}
