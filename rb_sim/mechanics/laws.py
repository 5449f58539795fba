# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The laws of a system, traced: what loops call by address.

The kernels of the systems run once on symbols; where they only give back what they got (nothing
to project, no domain to leave), there is no law to call. `Variables` are those in which a system's
Taylor series is cheaper than in its coordinates.
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
from rb_sim.graph.derivative import PlainColumns, compile_columns, jacobian
from rb_sim.graph.machine import Law, PlainLaw, compile_law
from rb_sim.graph.symbols import Graph, Symbol, operations, where
from rb_sim.graph.table_program import PlainProgram
from rb_sim.graph.taylor_code import SeriesLaws
from rb_sim.mechanics.inputs import Inputs, Place
from rb_sim.mechanics.system import CONFIGURATION, EVENT_DRIVEN, inside, project, rate, sample
from rb_sim.mechanics.systems.fixed_point import FixedAxisBody
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.mechanics.systems.one_body import total_wrench
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

# Other variables z than the coordinates y for the steps along a Taylor series.
#
# The series comes from the graph of dz/dt as any other; what is written for a system is that law
# and the ways between y and z.  Worth it where it is 1.3 times cheaper (`python -m
# benchmarks.series`).


Numbers = Sequence[Any]

AT_REST = BodyState(ZERO, (0.0, 0.0, 0.0, 1.0), ZERO, ZERO)
"""At the origin, its axes those of the world: where loads do not depend on the state."""


class Variables(NamedTuple):
    """Plain Python on numbers and symbols, as every law."""

    suits: Callable[[Any], bool]
    """whether the motion of this compiled system can be written in them."""
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
#     S = (P cos phi - Q sin phi),   J P = m . F_0,   J Q = m . (n x F_0),
# F_0 in the body axes of phi = 0.  With C = dS/dphi the series needs two products and no sine:
#     phi' = w,   w' = S,   S' = C w,   C' = -S w.


def suits_pendulum(system):
    """Nothing but gravity acts."""
    return isinstance(system, FixedAxisBody) and all(
        isinstance(row, GravityRow) for row in system.effects
    )


def begin_as_pendulum(system, y):
    """phi, w, S and C."""
    weight, _ = total_wrench(system.effects, 0.0, system.body, AT_REST)
    n, down = system.axis_B, unrotate(system.q_0, weight)
    arm = cross(n, system.rho)
    P, Q = system.inverse_J * dot(arm, down), system.inverse_J * dot(arm, cross(n, down))
    c, s = cos(y[0]), sin(y[0])
    return y[0], y[1], P * c - Q * s, -(P * s + Q * c)


def rates_of_pendulum(system, z):
    """dz/dt of (angle, rate, angular acceleration S, its derivative by the angle C)."""
    _, w, S, C = z
    return w, S, C * w, -(S * w)


def change_of_pendulum(system, y, z, dz):
    """Change of (angle, rate): they are variables themselves."""
    return dz[:2]


AS_PENDULUM = Variables(suits_pendulum, 4, begin_as_pendulum, rates_of_pendulum, change_of_pendulum)


# A disk that rolls on its edge on a level plane under gravity, in angles (Routh; LL 38).
#
# With e the level direction in the disk's plane, u up its slope from the contact to the centre and
# k its axis (e x u = k), tilt theta between k and the normal n, c and s its cosine and sine, and w
# = w1 e + w2 u + w3 k: (A + m a^2) w1' = w2 (A own - (C + m a^2) w3) - m g a c,   A w2' = w1 (C w3
# - A own), (C + m a^2) w3' = m a^2 w1 w2,   theta' = w1, where (e, u, k) itself turns by w1 e + w2
# u + own k, that is by turn = w2/s about n; own = c turn. The disk spins in it by w3 - own about k,
# and its centre goes by a (w1 k - w3 e), level by -a (w3 e + s w1 n x e).  As c' = -s w1, its level
# way a (X e + (Z + c) n x e) in (e, n x e) as they turn has X' = own - w3 + turn Z,   Z' = -turn X,
# which needs no sine and cosine of the heading; c' = -s w1 and s' = c w1 need none of the tilt.


def suits_disk(system):
    """A body of revolution about the disk's axis, its centre at C, under gravity along n."""
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
    """(C about the axis, A across it)."""
    axis, inertia = system.surface.axis_B, system.body.inertia
    moment = dot(axis, symmetric_times(inertia, axis))
    return moment, 0.5 * (inertia[0] + inertia[1] + inertia[2] - moment)


def slope_frame(system, q):
    """(e, u in body axes, c, s)."""
    k, gamma = system.surface.axis_B, unrotate(q, system.normal)
    c = dot(gamma, k)
    up = sub(gamma, scale(c, k))
    s = norm(up)
    u = scale(1.0 / s, up)
    return cross(u, k), u, c, s


def begin_in_angles(system, y):
    """c, s, what has been tilted, turned about n and spun about k, w1, w2, w3, X and Z."""
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
    keep, push = side / (side + rolled), (moment + rolled) / (side + rolled)
    swing, gain = moment / side, rolled / (moment + rolled)
    turn = w2 / s
    own = c * turn
    return (
        -(s * w1),
        c * w1,
        w1,
        turn,
        w3 - own,
        w2 * (keep * own - push * w3) + fall * c,
        w1 * (swing * w3 - own),
        gain * (w1 * w2),
        own - w3 + turn * across,
        -(turn * ahead),
    )


def turn_about(axis, angle):
    """The quaternion of a turn by an angle [rad] about a unit vector."""
    return scale(sin(0.5 * angle), axis) + (cos(0.5 * angle),)


def change_from_angles(system, y, z, dz):
    """Change of y, from the angles that the disk has been tilted, turned and spun."""
    q, w, n = y[3:7], y[7:10], system.normal
    e, u, _, _ = slope_frame(system, q)
    e_W, k_B, a = rotate(q, e), system.surface.axis_B, system.surface.radius
    dc, _, tilted, headed, spun, dw1, dw2, dw3, ahead, dZ = dz
    world = quaternion_product(turn_about(n, headed), turn_about(e_W, tilted))
    turned = quaternion_product(world, quaternion_product(q, turn_about(k_B, spun)))
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


# A homogeneous sphere that rolls under a constant force at its centre and torque, in world axes.
#
# LL 38, problem 1: about the contact (I + m a^2) dw/dt = K + a n x F across the normal n and
# I dw_n/dt = K_n along it, so w = w_0 + alpha t in world axes, q' = (1/2) w q, and the centre goes
# by w x a n.


def suits_sphere(system):
    """Centre of mass at the centre, equal moments, and loads that are constant in the world."""
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
    """(alpha, normal times radius), world axes; body axes at rest are those of the world."""
    force, torque = total_wrench(system.effects, 0.0, system.body, AT_REST)
    n, inertia, arm = system.normal, system.body.inertia[0], system.surface.radius
    up = scale(arm, n)
    along = scale(dot(torque, n), n)
    across = sub(add(torque, cross(up, force)), along)
    inertia_P = inertia + system.body.mass * arm * arm
    return add(scale(1.0 / inertia_P, across), scale(1.0 / inertia, along)), up


def begin_in_world_axes(system, y):
    """The quaternion, w in world axes, and the way of the centre since the start."""
    return (*y[3:7], *rotate(y[3:7], y[7:10]), 0.0, 0.0, 0.0)


def rates_in_world_axes(system, z):
    """dz/dt of the quaternion, the spin in world axes and the way of the centre."""
    alpha, up = gain(system)
    w = z[4:7]
    turn = quaternion_product((*scale(0.5, w), 0.0), z[:4])
    return (*turn, *alpha, *cross(w, up))


def change_from_world_axes(system, y, z, dz):
    """Change of y; the spin is turned into the body's axes."""
    turned = quaternion_unit(tuple(a + b for a, b in zip(y[3:7], dz[:4], strict=True)))
    w = add(z[4:7], dz[4:7])
    return (*dz[7:], *dz[:4], *sub(unrotate(turned, w), y[7:10]))


IN_WORLD_AXES = Variables(
    suits_sphere, 10, begin_in_world_axes, rates_in_world_axes, change_from_world_axes
)


# Variables in which a system's Taylor series is much cheaper than in its coordinates: one line
# each.


KNOWN: tuple[Variables, ...] = (IN_ANGLES, IN_WORLD_AXES, AS_PENDULUM)


def variables_of(system: Any) -> Variables | None:
    """Such variables for this compiled system, or None."""
    return next((known for known in KNOWN if known.suits(system)), None)


CompiledLaws = Law | PlainLaw | PlainColumns | PlainProgram


def reference(law: CompiledLaws | None) -> Any:
    """A loop calls this: the address, or the Python function; 0 where there is no law."""
    if law is None:
        return 0
    return law.address if isinstance(law, Law) else law


def domain_law(within: Any) -> CompiledLaws | None:
    """One number, 0 once `within` is false; None where it never is."""
    return None if within is True else compile_law([where(within, 1.0, 0.0)])


BY_ENTRIES = 400
"""Operations of dy/dt up to which its Jacobian is one law; of longer ones, whose code would be many
times as long, it is found by columns."""

WHOLE = 4600
"""Operations up to which a whole step is one law: it saves the calls and the loops between."""


class ReducedLaws(GuidedLaws):
    """The laws of one body in reduced coordinates.

    system: with its constants. n: coordinates. width: numbers of a sample. varied: places of
    constants that are inputs.
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
        """The Taylor series of y, or of the variables."""
        own = self.variables
        return SeriesLaws(self.traced(rate) if own is None else own.rates)

    @cached_property
    def variables(self) -> VariableLaws | None:
        """Variables that have a cheaper series than y, as those of every system of a family."""
        known = None if self.inputs.varied else variables_of(self.system)
        return None if known is None else VariableLaws(self, known)

    @cached_property
    def project(self) -> CompiledLaws | None:
        """y brought back to where it belongs."""
        outputs = self.traced(project)
        if all(is_coordinate(x, i) for i, x in enumerate(outputs)):
            return None
        return compile_law(outputs)

    def whole(self, step: Step, estimated: bool = True) -> CompiledLaws | None:
        """A step of this method as one law; None where it would be long.

        y is a row of `integrate.loop`: coordinates and carry; the last input is the step's length.
        estimated: the error is wanted; fixed steps go without, which is a third of dopri853.
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
        settled = project(system, t + h, moved)
        outputs = [*settled, *rest, sum(settled[1:], settled[0])]
        outputs += [error] if estimated else []
        return compile_law(outputs) if operations(outputs) <= WHOLE else None

    @cached_property
    def _rate_operations(self) -> int:
        return operations(self.traced(rate))

    @cached_property
    def inside(self) -> CompiledLaws | None:
        """One number, 0 once the state has left the system's domain."""
        (output,) = self.traced(lambda system, t, y: [inside(system, y)])
        return domain_law(output)

    @cached_property
    def carried(self) -> int:
        """How many of the inputs, the last but that of the step's length, `choice` gives."""
        return len(self.inputs.values(self.system, 0.0)) if self.inputs.kept(self.system) else 0

    @cached_property
    def choice(self) -> CompiledLaws | None:
        """The inputs of the next step, where laws keep something from step to step."""
        if not self.carried:
            return None

        def kernel(system: Any, t: Any, y: Any) -> list[Any]:
            out: list[Any] = [0.0] * self.width
            sample(system, t, y, out)  # which begins with the state of the body
            return self.inputs.next(self.system, y[0].graph, lambda body: state_of(out, body))

        return compile_law(self.traced(kernel))

    @cached_property
    def along(self) -> CompiledLaws | None:
        """The parameter of each spline and its rate."""
        return (
            compile_law(self.traced(lambda system, t, y: ways(system, y))) if self.splines else None
        )

    @cached_property
    def sample(self) -> CompiledLaws | None:
        """Everything that is reported at one instant."""

        def outputs(system: Any, t: Any, y: Any) -> list[Any]:
            out: list[Any] = [0.0] * self.width
            sample(system, t, y, out)
            return out

        return compile_law(self.traced(outputs))


class VariableLaws:
    """The laws of variables z in which the series is cheaper: z at the start, dz/dt, and the change
    of y from y, z and the change of z."""

    def __init__(self, laws: ReducedLaws, known: Variables) -> None:
        graph, n, m = Graph(), laws.n, known.count
        system = laws.inputs.symbolic(laws.system, graph)
        y, z, dz = (graph.vector("y", *at) for at in ((n, 0), (m, n), (m, n + m)))
        self.rates = list(known.rates(system, graph.vector("y", m)))
        self.rate = compile_law(self.rates)
        self.begin = compile_law(list(known.begin(system, y)))
        self.end = compile_law(list(known.change(system, y, z, dz)))


def dense(outputs: Sequence[Any], y: Sequence[Any]) -> list[Any]:
    """The Jacobian of the outputs by y, row by row."""
    sparse = jacobian(outputs, y)
    full: list[Any] = [0.0] * (len(outputs) * len(y))
    for i, j, value in zip(sparse.rows, sparse.columns, sparse.values, strict=True):
        full[i * len(y) + j] = value
    return full


def is_coordinate(x: Any, i: int) -> bool:
    """Whether x is the symbol of coordinate i, unchanged."""
    return isinstance(x, Symbol) and x.op == "y" and x.operands[0] == i


def traceable(system: Any) -> bool:
    """False for what events cut into pieces, which has laws of its own (contact.system.laws)."""
    return type(system) not in EVENT_DRIVEN
