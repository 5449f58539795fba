# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Translation: the body does not rotate; free, or with a point on a guide c(s).

m dv/dt = F . tau gives s'' |c'|^2 + s'^2 c' . c'' = c' . F / m; the reaction is the force m a - F
and the torque that prevents rotation.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

from rb_sim.catalogue.constraints.rows import CurveRow, material_point
from rb_sim.catalogue.curves import (
    CircleCurve,
    LineCurve,
    Pieces,
    SplineCurve,
    curve_nearest,
    curve_point,
)
from rb_sim.catalogue.spec import BodyState, Inertial, Quaternion, Vec3
from rb_sim.compiler.graph.machine import Law, PlainLaw, compile_law
from rb_sim.compiler.graph.symbols import Graph, call, minimum
from rb_sim.mechanics.system import inside
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.mechanics.systems.one_body import Dynamics, Held, body_system, total_wrench
from rb_sim.numerics.kernels import dispatch
from rb_sim.numerics.vectors import ZERO, add, dot, rotate, scale, sub

# Guides along splines: position of a motion among their pieces, and steps that must end at breaks.
#
# A law along a spline is smooth on each piece only, and no method keeps its order across a break.


def splines_of(system: Any) -> list[Pieces]:
    """The splines that guide a body, in the order of `ways`."""
    if isinstance(system, GuidedBody):
        return [system.curve.pieces] if isinstance(system.curve, SplineCurve) else []
    return [placed.row.curve.pieces for placed in _guided(system)]


def ways(system: Any, y: Sequence[Any]) -> list[Any]:
    """The parameter of each spline and its rate, in turn."""
    if isinstance(system, GuidedBody):
        return list(y)
    found: list[Any] = []
    for placed in _guided(system):
        p, v, _ = material_point(state_of(y, placed.body), placed.row.r_B)
        s = curve_nearest(placed.row.curve, p)
        slope = curve_point(placed.row.curve, s)[1]
        found += [s, dot(v, slope) / dot(slope, slope)]
    return found


def on_guides(system: Any, y: Sequence[Any]) -> Any:
    """False once a body in maximal coordinates has left its spline."""
    within: Any = True
    for placed, s in zip(_guided(system), ways(system, y)[::2], strict=True):
        within = on_curve(placed.row.curve, s) & within
    return within


def share_law(splines: Sequence[Pieces]) -> Law | PlainLaw | None:
    """Law of the fraction of a step up to the end of the first piece; None without splines.

    y is as `integrate.loop` passes it to SHARE.
    """
    if not splines:
        return None
    graph, share = Graph(), 1.0
    h, tolerance, *ends = graph.vector("y", 2 + 4 * len(splines))
    for k, pieces in enumerate(splines):
        before, after = ends[2 * k : 2 * k + 2], ends[2 * (k + len(splines)) :][:2]
        share = minimum(share, call(pieces.share, *before, *after, h, tolerance)[0])
    return compile_law([share])


class GuidedLaws:
    """Base of all laws: those about splines."""

    system: Any

    @cached_property
    def splines(self) -> int:
        """Number of splines that guide a body."""
        return len(splines_of(self.system))

    @cached_property
    def share(self) -> Law | PlainLaw | None:
        """Fraction of a step after which a piece of a spline ends."""
        return share_law(splines_of(self.system))


def _guided(system: Any) -> list[Any]:
    """The placed rows of splines of a system in maximal coordinates."""
    return [
        placed
        for placed in getattr(system, "constraints", ())
        if isinstance(placed.row, CurveRow) and isinstance(placed.row.curve, SplineCurve)
    ]


class TranslatingBody(NamedTuple):
    """y = p_WC (3), v_WC (3)."""

    body: Inertial
    q_0: Quaternion
    r_B: Vec3
    """point about which the reaction torque is taken, from C, body axes [m]."""
    effects: tuple


class GuidedBody(NamedTuple):
    """y = s, ds/dt along the guide."""

    body: Inertial
    q_0: Quaternion
    r_B: Vec3
    """guided point, from C, body axes [m]."""
    curve: tuple
    effects: tuple


def held_upright(system, B, a, f, k):
    """The Held of a body that does not turn, about r_B; a: acceleration of C."""
    return Held(a, ZERO, f, k, add(B.p_WC, rotate(B.q_WB, system.r_B)))


@body_system(TranslatingBody, configuration=3)
def translating_dynamics(system, t, y):
    """Newton's equation."""
    B = BodyState((y[0], y[1], y[2]), system.q_0, (y[3], y[4], y[5]), ZERO)
    f, k = total_wrench(system.effects, t, system.body, B)
    a = scale(1.0 / system.body.mass, f)
    return Dynamics(B.v_WC + a, B, 0.0, held_upright(system, B, a, f, k))


@body_system(GuidedBody, configuration=1)
def guided_dynamics(system, t, y):
    """Newton's equation along the guide."""
    c, slope, bend = curve_point(system.curve, y[0])
    p = sub(c, rotate(system.q_0, system.r_B))
    B = BodyState(p, system.q_0, scale(y[1], slope), ZERO)
    f, k = total_wrench(system.effects, t, system.body, B)
    along = dot(slope, f) / system.body.mass - y[1] * y[1] * dot(slope, bend)
    s_dd = along / dot(slope, slope)
    a = add(scale(s_dd, slope), scale(y[1] * y[1], bend))
    return Dynamics((y[1], s_dd), B, 0.0, held_upright(system, B, a, f, k))


@inside.register(GuidedBody)
def guided_inside(system, y):
    """False beyond the ends of an open guide."""
    return on_curve(system.curve, y[0])


@dispatch
def on_curve(curve, s):
    """False beyond the ends of an open curve."""


@on_curve.register(LineCurve, CircleCurve)
def endless(curve, s):
    """True: lines and circles have no ends."""
    return True


@on_curve.register(SplineCurve)
def between_ends(curve, s):
    """Whether s lies on the spline, ends included; everywhere if it is closed."""
    first, last = float(curve.pieces.breaks[0]), float(curve.pieces.breaks[-1])
    return curve.pieces.period > 0.0 or ((s >= first) & (s <= last))
