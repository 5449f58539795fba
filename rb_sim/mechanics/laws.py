# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Traced laws of a system in reduced coordinates, which loops call by address.

The kernels of a system run once on symbols; a kernel that returns its arguments unchanged (nothing
to project, no domain to leave) gives no law. `Variables` are coordinates in which the Taylor series
of a system is cheaper.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

from rb_sim.base.rounding import TWO_ULPS
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.effects.wrench import WorldWrenchRow
from rb_sim.catalogue.geometry.smooth_surfaces import RimSurface, SphereSurface
from rb_sim.catalogue.spec import BodyState
from rb_sim.compiler.graph.derivative import PlainColumns, compile_columns, jacobian
from rb_sim.compiler.graph.machine import Law, PlainLaw, compile_law
from rb_sim.compiler.graph.symbols import Graph, Symbol, operations, where
from rb_sim.compiler.graph.table_program import PlainProgram
from rb_sim.compiler.graph.taylor_code import SeriesLaws
from rb_sim.mechanics.inputs import Inputs, Place
from rb_sim.mechanics.system import CONFIGURATION, EVENT_DRIVEN, inside, project, sample
from rb_sim.mechanics.systems.fixed_point import FixedAxisBody
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.mechanics.systems.one_body import about, rate, total_wrench
from rb_sim.mechanics.systems.rolling_body import RollingBody
from rb_sim.mechanics.systems.translation import GuidedLaws, ways
from rb_sim.numerics.kernels import Step
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    cos,
    cross,
    dot,
    norm,
    quaternion_product,
    quaternion_unit,
    rotate,
    scale,
    sin,
    sub,
    symmetric_times,
    unrotate,
)

# Variables z instead of the coordinates y for steps along a Taylor series.
#
# The series comes from the graph of dz/dt as for any law; a system needs only that law and the maps
# between y and z. Worthwhile if it is 1.3 times cheaper (`python -m benchmarks.series`).


Numbers = Sequence[Any]

AT_REST = BodyState(ZERO, (0.0, 0.0, 0.0, 1.0), ZERO, ZERO)
"""State at the origin with world axes, for loads that do not depend on the state."""


class Variables(NamedTuple):
    """Variables z of a class of systems, as plain Python on numbers and symbols."""

    suits: Callable[[Any], bool]
    """whether the motion of this compiled system can be written in z."""
    count: int
    begin: Callable[[Any, Numbers], Numbers]
    """(system, y) -> z at the start of a step."""
    rates: Callable[[Any, Numbers], Numbers]
    """(system, z) -> dz/dt."""
    change: Callable[[Any, Numbers, Numbers, Numbers], Numbers]
    """(system, y and z at the start, change of z) -> change of y."""


# A body on a fixed axis under gravity: a pendulum, with its angular acceleration as a variable.
#
# With F the weight and m = n x rho in body axes, the angular acceleration is
#
#     S = (P cos phi - Q sin phi),   J P = m . F_0,   J Q = m . (n x F_0),
#
# with F_0 in the body axes of phi = 0. With C = dS/dphi the series needs two products and no sine:
#
#     phi' = w,   w' = S,   S' = C w,   C' = -S w.


def suits_pendulum(system):
    """True for a body on a fixed axis with no effect but gravity."""
    return isinstance(system, FixedAxisBody) and all(
        isinstance(row, GravityRow) for row in system.effects
    )


def begin_as_pendulum(system, y):
    """(phi, w, S, C) at the start of a step."""
    weight, _ = total_wrench(system.effects, 0.0, system.body, AT_REST)
    n, down = system.axis_B, unrotate(system.q_0, weight)
    arm = cross(n, system.rho)
    P, Q = system.inverse_J * dot(arm, down), system.inverse_J * dot(arm, cross(n, down))
    c, s = cos(y[0]), sin(y[0])
    return y[0], y[1], P * c - Q * s, -(P * s + Q * c)


def rates_of_pendulum(system, z):
    """dz/dt for z = (angle phi, rate w, angular acceleration S, its derivative C by the angle)."""
    _, w, S, C = z
    return w, S, C * w, -(S * w)


def change_of_pendulum(system, y, z, dz):
    """Change of (angle, rate): the first two variables."""
    return dz[:2]


AS_PENDULUM = Variables(suits_pendulum, 4, begin_as_pendulum, rates_of_pendulum, change_of_pendulum)


# A disk that rolls on its edge on a level plane under gravity, in angles (Routh; LL 38). e: level
# direction in the disk's plane, u: up its slope from the contact to the centre, k: its axis (e x u
# = k), theta: tilt between k and the normal n, c and s its cosine and sine, w = w1 e + w2 u + w3 k.
#
# Then (A + m a^2) w1' = w2 (A own - (C + m a^2) w3) - m g a c, A w2' = w1 (C w3 - A own), (C + m
# a^2) w3' = m a^2 w1 w2, theta' = w1, where (e, u, k) itself turns by w1 e + w2 u + own k, that is
# by turn = w2/s about n; own = c turn. The disk spins in it by w3 - own about k, and its centre
# moves at a (w1 k - w3 e), horizontally at -a (w3 e + s w1 n x e). As c' = -s w1, its horizontal
# displacement a (X e + (Z + c) n x e), in (e, n x e) as they turn, has X' = own - w3 + turn Z, Z' =
# -turn X, without sine and cosine of the heading; c' = -s w1 and s' = c w1 avoid those of the tilt.


def suits_disk(system):
    """True for a body of revolution about the disk's axis with C at the centre and gravity along
    n."""
    if not isinstance(system, RollingBody) or not isinstance(system.surface, RimSurface):
        return False
    axis, inertia = system.surface.axis_B, system.body.inertia
    moment, across = moments(system)
    # of revolution: I = across 1 + (moment - across) k k^T
    lacking = [
        value - (across * same + (moment - across) * axis[i] * axis[j])
        for value, (i, j, same) in zip(
            inertia,
            ((0, 0, 1), (1, 1, 1), (2, 2, 1), (0, 1, 0), (0, 2, 0), (1, 2, 0)),
            strict=True,
        )
    ]
    level = all(
        isinstance(row, GravityRow) and norm(cross(row.acceleration_W, system.normal)) == 0.0
        for row in system.effects
    )
    even = max(map(abs, lacking)) <= TWO_ULPS * max(moment, across)
    return tuple(system.surface.centre_C) == ZERO and even and level


def moments(system):
    """(moment of inertia C about the axis, A about a diameter) [kg m^2]."""
    axis, inertia = system.surface.axis_B, system.body.inertia
    moment = dot(axis, symmetric_times(inertia, axis))
    return moment, 0.5 * (inertia[0] + inertia[1] + inertia[2] - moment)


def slope_frame(system, q):
    """(e and u in body axes, cosine c and sine s of the tilt)."""
    k, gamma = system.surface.axis_B, unrotate(q, system.normal)
    c = dot(gamma, k)
    up = sub(gamma, scale(c, k))
    s = norm(up)
    u = scale(1.0 / s, up)
    return cross(u, k), u, c, s


def begin_in_angles(system, y):
    """(c, s, angles of tilt, turn about n and spin about k since the start, w1, w2, w3, X, Z)."""
    e, u, c, s = slope_frame(system, y[3:7])
    w = y[7:10]
    spin = dot(w, e), dot(w, u), dot(w, system.surface.axis_B)
    return c, s, 0.0, 0.0, 0.0, *spin, 0.0, -c


def rates_of_angles(system, z):
    """dz/dt of the variables of `begin_in_angles`."""
    c, s, _, _, _, w1, w2, w3, ahead, across = z
    moment, side = moments(system)
    a = system.surface.radius
    rolled = system.body.mass * a * a
    force, _ = total_wrench(system.effects, 0.0, system.body, AT_REST)
    fall = a * dot(force, system.normal) / (side + rolled)
    keep, response = side / (side + rolled), (moment + rolled) / (side + rolled)
    swing, gain = moment / side, rolled / (moment + rolled)
    turn = w2 / s
    own = c * turn
    return (
        -(s * w1),
        c * w1,
        w1,
        turn,
        w3 - own,
        w2 * (keep * own - response * w3) + fall * c,
        w1 * (swing * w3 - own),
        gain * (w1 * w2),
        own - w3 + turn * across,
        -(turn * ahead),
    )


def change_from_angles(system, y, z, dz):
    """Change of y, from the angles by which the disk has tilted, turned and spun."""
    q, w, n = y[3:7], y[7:10], system.normal
    e, u, _, _ = slope_frame(system, q)
    e_W, k_B, a = rotate(q, e), system.surface.axis_B, system.surface.radius
    dc, _, tilted, headed, spun, dw1, dw2, dw3, ahead, dZ = dz
    world = quaternion_product(about(n, headed), about(e_W, tilted))
    turned = quaternion_product(world, quaternion_product(q, about(k_B, spun)))
    dq = (turned[0] - q[0], turned[1] - q[1], turned[2] - q[2], turned[3] - q[3])
    ce, se = cos(spun), sin(spun)
    w1, w2, w3 = z[5] + dw1, z[6] + dw2, z[7] + dw3
    flat = add(scale(ce * w1 + se * w2, e), scale(ce * w2 - se * w1, u))
    dw = sub(add(flat, scale(w3, k_B)), w)
    ch, sh, across = cos(headed), sin(headed), dZ + dc
    along, aside = ch * ahead - sh * across, sh * ahead + ch * across
    level = add(scale(a * along, e_W), scale(a * aside, cross(n, e_W)))
    half = 0.5 * tilted
    rise = 2.0 * a * sin(half) * (z[0] * cos(half) - z[1] * sin(half))
    return add(level, scale(rise, n)) + dq + dw


IN_ANGLES = Variables(suits_disk, 10, begin_in_angles, rates_of_angles, change_from_angles)


# A homogeneous sphere that rolls under a constant force at its centre and a constant torque, in
# world axes.
#
# LL 38, problem 1: about the contact point (I + m a^2) dw/dt = K + a n x F normal to n and I
# dw_n/dt = K_n along n, so w = w_0 + alpha t in world axes, q' = (1/2) w q, and the centre moves at
# w x a n.


def suits_sphere(system):
    """True for a homogeneous sphere with loads that are constant in world axes."""
    if not isinstance(system, RollingBody) or not isinstance(system.surface, SphereSurface):
        return False
    inertia = system.body.inertia
    round_inertia = inertia[0] == inertia[1] == inertia[2] and not any(inertia[3:])
    steady = all(
        isinstance(row, GravityRow) or (isinstance(row, WorldWrenchRow) and row.r_B == ZERO)
        for row in system.effects
    )
    return tuple(system.surface.centre_C) == ZERO and round_inertia and steady


def gain(system):
    """(angular acceleration alpha, radius times normal), world axes; loads with body axes = world
    axes."""
    force, torque = total_wrench(system.effects, 0.0, system.body, AT_REST)
    n, inertia, arm = system.normal, system.body.inertia[0], system.surface.radius
    up = scale(arm, n)
    along = scale(dot(torque, n), n)
    across = sub(add(torque, cross(up, force)), along)
    inertia_P = inertia + system.body.mass * arm * arm
    return add(scale(1.0 / inertia_P, across), scale(1.0 / inertia, along)), up


def begin_in_world_axes(system, y):
    """(quaternion, w in world axes, displacement of the centre since the start)."""
    return (*y[3:7], *rotate(y[3:7], y[7:10]), 0.0, 0.0, 0.0)


def rates_in_world_axes(system, z):
    """dz/dt of the quaternion, the angular velocity in world axes and the displacement of the
    centre."""
    alpha, up = gain(system)
    w = z[4:7]
    turn = quaternion_product((*scale(0.5, w), 0.0), z[:4])
    return (*turn, *alpha, *cross(w, up))


def change_from_world_axes(system, y, z, dz):
    """Change of y; the angular velocity is rotated to the body's axes."""
    turned = quaternion_unit(tuple(a + b for a, b in zip(y[3:7], dz[:4], strict=True)))
    w = add(z[4:7], dz[4:7])
    return (*dz[7:], *dz[:4], *sub(unrotate(turned, w), y[7:10]))


IN_WORLD_AXES = Variables(
    suits_sphere, 10, begin_in_world_axes, rates_in_world_axes, change_from_world_axes
)


# Variables in which the Taylor series of a system is much cheaper than in its coordinates.


KNOWN: tuple[Variables, ...] = (IN_ANGLES, IN_WORLD_AXES, AS_PENDULUM)


def variables_of(system: Any) -> Variables | None:
    """Variables with a cheaper series for this compiled system, or None."""
    return next((known for known in KNOWN if known.suits(system)), None)


CompiledLaws = Law | PlainLaw | PlainColumns | PlainProgram


def reference(law: CompiledLaws | None) -> Any:
    """Argument of a loop for a law: its address, or the Python function; 0 without a law."""
    if law is None:
        return 0
    return law.address if isinstance(law, Law) else law


def domain_law(within: Any) -> CompiledLaws | None:
    """Law of one number, 1 inside the domain and 0 outside; None for an unbounded domain."""
    return None if within is True else compile_law([where(within, 1.0, 0.0)])


BY_ENTRIES = 400
"""Most operations of dy/dt for which the Jacobian is one law; for longer ones it is evaluated by
columns, as its code would be many times as long."""

WHOLE = 4600
"""Most operations of a whole step as one law, which saves calls and loops between its stages."""


class ReducedLaws(GuidedLaws):
    """The laws of one body in reduced coordinates.

    system: with its constants. n: number of coordinates. width: numbers of a sample. varied: places
    of constants that are inputs.
    """

    def __init__(self, system: Any, n: int, width: int, varied: Sequence[Place] = ()) -> None:
        self.system, self.n, self.width = system, n, width
        self.inputs = Inputs(varied)
        self._whole: dict[tuple[Step, bool], CompiledLaws | None] = {}

    @property
    def velocities(self) -> list[float]:
        """1 for each coordinate that is a velocity, else 0."""
        first = CONFIGURATION[type(self.system)]
        return [0.0 if i < first else 1.0 for i in range(self.n)]

    def traced(self, kernel: Callable[..., Sequence[Any]]) -> list[Any]:
        """The outputs of kernel(system, t, y) on symbols of a new graph."""
        graph = Graph()
        system = self.inputs.symbolic(self.system, graph)
        return list(kernel(system, graph.input("t"), graph.vector("y", self.n)))

    @cached_property
    def rate(self) -> CompiledLaws | None:
        """dy/dt."""
        return compile_law(self.traced(rate))

    @cached_property
    def jacobian(self) -> CompiledLaws:
        """d(dy/dt)/dy by rows, n n numbers."""
        if self._rate_operations > BY_ENTRIES:
            return compile_columns(self.traced(rate), self.n)
        return compile_law(self.traced(lambda system, t, y: dense(list(rate(system, t, y)), y)))

    @cached_property
    def series(self) -> SeriesLaws:
        """The Taylor series of y, or of `variables`."""
        own = self.variables
        return SeriesLaws(self.traced(rate) if own is None else own.rates)

    @cached_property
    def variables(self) -> VariableLaws | None:
        """Variables with a cheaper series than y; None without them, or if constants are inputs."""
        known = None if self.inputs.varied else variables_of(self.system)
        return None if known is None else VariableLaws(self, known)

    @cached_property
    def project(self) -> CompiledLaws | None:
        """Projection of y onto the manifold; None if it changes nothing."""
        outputs = self.traced(project)
        if all(is_coordinate(x, i) for i, x in enumerate(outputs)):
            return None
        return compile_law(outputs)

    def whole(self, step: Step, estimated: bool = True) -> CompiledLaws | None:
        """A step of this method as one law; None if it would be too long.

        y is a row of `integrate.loop`: coordinates and carry; the last input is the length of the
        step. estimated: with the error estimate; fixed steps omit it, a third of the cost of
        dopri853.
        """
        key = step, estimated
        if key not in self._whole:
            self._whole[key] = self._whole_step(step, estimated)
        return self._whole[key]

    def _whole_step(self, step: Step, estimated: bool) -> CompiledLaws | None:
        if step.traced is None or self._rate_operations * step.stages > WHOLE:
            return None
        graph = Graph()
        system, n = self.inputs.symbolic(self.system, graph), self.n
        t, y, carry = graph.input("t"), graph.vector("y", n), graph.vector("y", n, n)
        h = graph.input("p", len(self.inputs.values(self.system, 0.0)))
        dy, error = step.traced(lambda t, y: rate(system, t, y), t, y, h, self.velocities)
        change = [a + b for a, b in zip(dy, carry, strict=True)]
        moved = tuple(a + b for a, b in zip(y, change, strict=True))
        rest = [c - (b - a) for a, b, c in zip(y, moved, change, strict=True)]
        projected = project(system, t + h, moved)
        outputs = [*projected, *rest, sum(projected[1:], projected[0])]
        outputs += [error] if estimated else []
        return compile_law(outputs) if operations(outputs) <= WHOLE else None

    @cached_property
    def _rate_operations(self) -> int:
        return operations(self.traced(rate))

    @cached_property
    def inside(self) -> CompiledLaws | None:
        """One number, 0 once the state has left the system's domain; None for an unbounded
        domain."""
        (output,) = self.traced(lambda system, t, y: [inside(system, y)])
        return domain_law(output)

    @cached_property
    def carried(self) -> int:
        """Number of inputs, before the length of the step, that `choice` returns."""
        return len(self.inputs.values(self.system, 0.0)) if self.inputs.kept(self.system) else 0

    @cached_property
    def choice(self) -> CompiledLaws | None:
        """The inputs of the next step, for laws that carry numbers from step to step; else None."""
        if not self.carried:
            return None

        def kernel(system: Any, t: Any, y: Any) -> list[Any]:
            out: list[Any] = [0.0] * self.width
            sample(system, t, y, out)  # a sample begins with the state of the body
            return self.inputs.next(self.system, y[0].graph, lambda body: state_of(out, body))

        return compile_law(self.traced(kernel))

    @cached_property
    def along(self) -> CompiledLaws | None:
        """The parameter of each spline and its rate; None without splines."""
        return (
            compile_law(self.traced(lambda system, t, y: ways(system, y))) if self.splines else None
        )

    @cached_property
    def sample(self) -> CompiledLaws | None:
        """The sample: all quantities reported at one instant."""

        def outputs(system: Any, t: Any, y: Any) -> list[Any]:
            out: list[Any] = [0.0] * self.width
            sample(system, t, y, out)
            return out

        return compile_law(self.traced(outputs))


class VariableLaws:
    """Laws of variables z with a cheaper series: z at the start, dz/dt, and the change of y from y,
    z and the change of z."""

    def __init__(self, laws: ReducedLaws, known: Variables) -> None:
        graph, n, m = Graph(), laws.n, known.count
        system = laws.inputs.symbolic(laws.system, graph)
        y, z, dz = (graph.vector("y", *at) for at in ((n, 0), (m, n), (m, n + m)))
        self.rates = list(known.rates(system, graph.vector("y", m)))
        self.rate = compile_law(self.rates)
        self.begin = compile_law(list(known.begin(system, y)))
        self.end = compile_law(list(known.change(system, y, z, dz)))


def dense(outputs: Sequence[Any], y: Sequence[Any]) -> list[Any]:
    """The Jacobian of the outputs with respect to y, row by row, zeros included."""
    sparse = jacobian(outputs, y)
    full: list[Any] = [0.0] * (len(outputs) * len(y))
    for i, j, value in zip(sparse.rows, sparse.columns, sparse.values, strict=True):
        full[i * len(y) + j] = value
    return full


def is_coordinate(x: Any, i: int) -> bool:
    """Whether x is the symbol of coordinate i, unchanged."""
    return isinstance(x, Symbol) and x.op == "y" and x.operands[0] == i


def traceable(system: Any) -> bool:
    """False for systems with events, which have their own laws (EVENT_DRIVEN)."""
    return type(system) not in EVENT_DRIVEN
