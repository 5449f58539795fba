# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction laws: traction in slipping and the limit of the traction in sticking.

`traction` gives the tangential force as N per_normal + direct for a slip velocity s (of the body
relative to the support, in the tangent plane). A law with a corner at s = 0 is continued straight
through it along `ahead`, the direction of slip at the start of the step, so that the equations stay
smooth until the event "slip vanishes" is located (Hairer, Norsett, Wanner I, II.6).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rb_sim.catalogue.spec import Vec3
from rb_sim.numerics.kernels import branching, dispatch
from rb_sim.numerics.vectors import add, dot, norm, scale, sqrt, sub, where


class Smooth(NamedTuple):
    """Frictionless."""

    static: float = 0.0


class Coulomb(NamedTuple):
    """|T| <= static N while sticking, T = -kinetic N s/|s| while slipping."""

    static: float
    kinetic: float


class Viscous(NamedTuple):
    """T = -c s."""

    coefficient: float
    """c [N s/m]."""
    static: float = 0.0


class ViscousPerNormal(NamedTuple):
    """T = -c N s."""

    coefficient: float
    """c [s/m]."""
    static: float = 0.0


class Regularised(NamedTuple):
    """T = -mu N s / sqrt(s^2 + v^2): Coulomb's law, smoothed for slips below the speed v."""

    coefficient: float
    speed: float
    """v [m/s]."""
    static: float = 0.0


class Rough(NamedTuple):
    """Perfectly rough: never slips (LL 38)."""

    static: float = math.inf


Friction = Smooth | Coulomb | Viscous | ViscousPerNormal | Regularised | Rough
BOUNDED = (Smooth, Coulomb, Rough)
"""Laws whose |T| / N does not depend on the slip speed: 0, `kinetic`, or as large as sticking
needs."""
ZERO3: Vec3 = (0.0, 0.0, 0.0)


@branching
def straight_on(s, ahead, least):
    """s/|s|, with its sign changed if it points against `ahead`; `ahead` if |s| <= least.

    least: slip below which s is only rounding.
    """
    size = norm(s)
    if size <= least:
        return ahead
    return scale(-1.0 / size if dot(s, ahead) < 0.0 else 1.0 / size, s)


@branching
def rounded_at(s, least):
    """s / (s^8 + least^8)^(1/8): s/|s| for |s| >> least, smooth through s = 0."""
    size = norm(s) / least
    if size > 1e3:
        return scale(1.0 / (least * size), s)
    square = size * size
    fourth = square * square
    return scale(1.0 / (least * sqrt(sqrt(sqrt(1.0 + fourth * fourth)))), s)


@branching
def straight_or_rounded(s, ahead, least):
    """As straight_on, or as rounded_at if `ahead` is zero: the contact creeps then."""
    if dot(ahead, ahead) == 0.0:
        return rounded_at(s, least)
    return straight_on(s, ahead, least)


@dispatch
def traction(law, s, ahead, least, compliant):
    """(T / N, traction that does not depend on N [N]), both on the body, world axes.

    s: slip velocity [m/s]; ahead: its direction at the start of the step; least: slip that is only
    rounding [m/s]; compliant: whether the support is compliant.
    """


@traction.register(Smooth, Rough)
def no_traction(law, s, ahead, least, compliant):
    """Zero: no friction, or a rough contact, which never slips."""
    return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


@traction.register(Coulomb)
def coulomb_traction(law, s, ahead, least, compliant):
    """-kinetic s/|s| per unit of normal force; smoothed by `straight_or_rounded` if compliant."""
    way = straight_or_rounded(s, ahead, least) if compliant else straight_on(s, ahead, least)
    return scale(-law.kinetic, way), (0.0, 0.0, 0.0)


@traction.register(Viscous)
def viscous_traction(law, s, ahead, least, compliant):
    """-coefficient s, independent of the normal force."""
    return (0.0, 0.0, 0.0), scale(-law.coefficient, s)


@traction.register(ViscousPerNormal)
def viscous_per_normal_traction(law, s, ahead, least, compliant):
    """-coefficient s per unit of normal force."""
    return scale(-law.coefficient, s), (0.0, 0.0, 0.0)


@traction.register(Regularised)
def regularised_traction(law, s, ahead, least, compliant):
    """-mu s / sqrt(s^2 + v^2) per unit of normal force."""
    rounded = sqrt(dot(s, s) + law.speed * law.speed)
    return scale(-law.coefficient / rounded, s), (0.0, 0.0, 0.0)


def is_whole(law: Any) -> bool:
    """Whether a law has all that the methods need: the limit in sticking and a traction."""
    return hasattr(law, "static") and type(law) in traction.kernels


SLOW: Vec3 = (2.0**-30, 0.0, 0.0)
"""Slip at the onset of slipping [m/s]."""


def at_begin_of_slip(law: Friction) -> float:
    """|T| / N at the onset of slip of a sticking contact; 0 for a law that does not stick."""
    if not 0.0 < law.static < math.inf:
        return float(law.static)
    return norm(traction(law, SLOW, (1.0, 0.0, 0.0), 0.0, False)[0])


def drags(law: Friction) -> bool:
    """Whether the traction stays finite as N vanishes."""
    ahead = (1.0, 0.0, 0.0)
    return norm(traction(law, ahead, ahead, 0.0, False)[1]) > 0.0


class Resistance(NamedTuple):
    """Rolling and spinning resistance: torques of at most arm N against the relative rotation."""

    rolling: float
    """arm of the torque about axes in the tangent plane [m]."""
    spinning: float
    """arm of the torque about the normal [m]."""


class NoResistance(NamedTuple):
    """No rolling or spinning resistance."""


@dispatch
def resisting(law, turn, normal, modes, ahead, spin_sign, least):
    """Resisting torque on the body per unit of normal force, world axes [m].

    turn: relative angular velocity; modes: (rolling, spinning) as in the table of contacts, 1 for
    sliding; ahead, spin_sign: directions at the start of the step; least: angular velocity that is
    only rounding [rad/s].
    """


@resisting.register(NoResistance)
def no_resistance(law, turn, normal, modes, ahead, spin_sign, least):
    """Zero torque."""
    return (0.0, 0.0, 0.0)


@resisting.register(Resistance)
def resistance_torque(law, turn, normal, modes, ahead, spin_sign, least):
    """Torque against rolling (normal to n) and against spinning (along n), for each that slides.

    Its size per unit of normal force is the arm [m] of each.
    """
    about = dot(turn, normal)
    d = straight_on(sub(turn, scale(about, normal)), ahead, least)
    rolls, spins = (modes[0] > 0.5) & (modes[0] < 1.5), (modes[1] > 0.5) & (modes[1] < 1.5)
    across = where(rolls, scale(-law.rolling, d), (0.0, 0.0, 0.0))
    return add(across, where(spins, scale(-law.spinning * spin_sign, normal), (0.0, 0.0, 0.0)))
