# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Free body: m dV/dt = F, I dw/dt + w x I w = K about the centre of mass (LL 34, 36)."""

from __future__ import annotations

from typing import Any, NamedTuple

from rb_sim.catalogue.spec import (
    CENTRAL,
    CHANGING,
    BodyState,
    Changing,
    Inertial,
    Quaternion,
    Symmetric,
    Vec3,
)
from rb_sim.mechanics.system import STARTS, project
from rb_sim.mechanics.systems.many_bodies import WIDTH, MultiBody, state_of
from rb_sim.mechanics.systems.one_body import (
    Dynamics,
    body_system,
    quaternion_defect,
    total_wrench,
)
from rb_sim.numerics.vectors import (
    ZERO,
    conjugate,
    dot,
    gyroscopic,
    maximum,
    quaternion_product,
    quaternion_rate,
    rarely,
    rotate,
    scale,
    sqrt,
    sub,
    symmetric_times,
)

SMALL_DEFECT = 1e-13
"""| |q|^2 - 1 | up to which the quaternion is not normalised: that would only add rounding."""


class FreeBody(NamedTuple):
    """y = p_WC (3), q_WB (4), v_WC (3), w_WB_B (3)."""

    body: Inertial
    inverse_inertia: Symmetric
    effects: tuple


@body_system(FreeBody, configuration=7)
def free_dynamics(system, t, y):
    """Newton's equations for the centre of mass and Euler's about it."""
    B = state_of(y, 0)
    f, k = total_wrench(system.effects, t, system.body, B)
    a = scale(1.0 / system.body.mass, f)
    moment = sub(k, gyroscopic(system.body.inertia, B.w_WB_B))
    alpha = symmetric_times(system.inverse_inertia, moment)
    rates = B.v_WC + quaternion_rate(B.q_WB, B.w_WB_B) + a + alpha
    return Dynamics(rates, B, quaternion_defect(B.q_WB))


def unit_if_needed(q):
    """q normalised if | |q|^2 - 1 | exceeds SMALL_DEFECT."""
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    s = rarely(abs(square - 1.0) > SMALL_DEFECT, 1.0 / sqrt(square), 1.0)
    return (s * q[0], s * q[1], s * q[2], s * q[3])


@project.register(FreeBody)
def free_project(system, t, y):
    """y with the quaternion normalised."""
    return y[0:3] + unit_if_needed(y[3:7]) + y[7:13]


# Body without torque about its centre of mass: Euler's equations in principal axes (LL 36, 37), I1
# dw1/dt = (I2 - I3) w2 w3 and cyclically; C moves by m dV/dt = F.
#
# The angular velocity stays on its polhode, the intersection of two ellipsoids. Near the middle
# axis a deviation across the polhode of relative size e grows to e (w2/w1)^2 in a flip, and with it
# the error of the time of the next flip: after some flips rounding alone decides the phase. So
# after every step the angular velocity is projected onto its initial polhode. The remaining
# rounding error along the polhode does not grow.


LARGEST_TURN = 0.05
"""Relative change of a component of the angular velocity above which it is not rounding, and no
projection is made."""


class FreeRotor(NamedTuple):
    """y = p_WC (3), q_WP (4), v_WC (3), w_WP_P (3), P the principal axes."""

    body: Inertial
    q_BP: Quaternion
    """rotation from principal axes to body axes."""
    moments: Vec3
    """principal moments, in the order of P's axes [kg m^2]."""
    coupling: Vec3
    """(I2 - I3) / I1 and cyclically."""
    weights: Vec3
    """I / 2E of the initial angular velocity [s^2/rad^2]; zero at rest."""
    contrast: Vec3
    """1 - I / Ik, with k the principal axis closest to the polhode."""
    polhode: tuple[float, float]
    """sum weights w^2 = 1 and sum weights contrast w^2 = 1 - M^2 / (2 E Ik) at the start."""
    effects: tuple


def start_rotor(system: FreeRotor, y: tuple[float, ...]) -> FreeRotor:
    """The system with the polhode through the angular velocity in y.

    The second invariant is a difference that vanishes if the angular velocity is along the axis k;
    with k the axis of the smallest such difference it keeps its digits next to a separatrix, too.
    """
    moments, w = system.moments, y[10:13]
    twice_energy = dot(moments, (w[0] * w[0], w[1] * w[1], w[2] * w[2]))
    if not 1e-250 < twice_energy < 1e250:
        return system._replace(weights=ZERO, contrast=ZERO, polhode=(0.0, 0.0))
    weights = scale(1.0 / twice_energy, moments)
    contrasts: Any = [tuple((own - i) / own for i in moments) for own in moments]
    contrast = min(contrasts, key=lambda c: abs(polhode_of(weights, c, w)[1]))
    level, excess, _ = polhode_of(weights, contrast, w)
    return system._replace(weights=weights, contrast=contrast, polhode=(level, excess))


STARTS[FreeRotor] = start_rotor


def polhode_inputs(system: FreeRotor, t: float, onwards: bool) -> tuple[float, ...]:
    """The inputs of the law that depend on the initial spin."""
    return (*system.weights, *system.contrast, *system.polhode)


def with_polhode(system: FreeRotor, inputs: tuple) -> FreeRotor:
    """The system as a traced law takes it, from its inputs."""
    return system._replace(weights=inputs[0:3], contrast=inputs[3:6], polhode=inputs[6:8])


CHANGING[FreeRotor] = Changing(8, polhode_inputs, with_polhode)


def polhode_of(weights, contrast, w):
    """sum weights contrast^n w^2 for n = 0, 1, 2."""
    a, b, c = weights[0] * w[0] * w[0], weights[1] * w[1] * w[1], weights[2] * w[2] * w[2]
    u, v, x = contrast[0] * a, contrast[1] * b, contrast[2] * c
    return a + b + c, u + v + x, contrast[0] * u + contrast[1] * v + contrast[2] * x


def on_polhode(system, w):
    """The angular velocity after one Newton step onto the polhode, each component by its own
    factor.

    The step w_i (1 + alpha contrast_i + beta) is the shortest in the metric of the energy; small
    components keep their relative precision.
    """
    s0, s1, s2 = polhode_of(system.weights, system.contrast, w)
    spread = s0 * s2 - s1 * s1
    none = spread <= 1e-290
    level, excess = system.polhode[0] - s0, system.polhode[1] - s1
    half = 0.5 / rarely(none, 1.0, spread)
    alpha, beta = half * (s0 * excess - s1 * level), half * (s2 * level - s1 * excess)
    e = system.contrast
    a, b, c = alpha * e[0] + beta, alpha * e[1] + beta, alpha * e[2] + beta
    large = maximum(maximum(abs(a), abs(b)), abs(c)) >= LARGEST_TURN
    left_alone = none | large
    return (
        rarely(left_alone, w[0], w[0] + a * w[0]),
        rarely(left_alone, w[1], w[1] + b * w[1]),
        rarely(left_alone, w[2], w[2] + c * w[2]),
    )


@body_system(FreeRotor, configuration=7)
def rotor_dynamics(system, t, y):
    """Newton's equations, and Euler's without torque in principal axes P, which the state leaves
    for body axes."""
    P, k = state_of(y, 0), system.coupling
    f, _ = total_wrench(system.effects, t, system.body, P)
    a, w = scale(1.0 / system.body.mass, f), P.w_WB_B
    alpha = (k[0] * (w[1] * w[2]), k[1] * (w[2] * w[0]), k[2] * (w[0] * w[1]))
    rates = P.v_WC + quaternion_rate(P.q_WB, w) + a + alpha
    q_WB = quaternion_product(P.q_WB, conjugate(system.q_BP))
    B = P._replace(q_WB=q_WB, w_WB_B=rotate(system.q_BP, w))
    return Dynamics(rates, B, quaternion_defect(P.q_WB))


@project.register(FreeRotor)
def rotor_project(system, t, y):
    """y with the quaternion normalised and the angular velocity projected onto its polhode."""
    return y[0:3] + unit_if_needed(y[3:7]) + y[7:10] + on_polhode(system, y[10:13])


def free_rotor(
    body: Inertial, moments: Vec3, q_BP: Quaternion, B: BodyState, effects: tuple[Any, ...]
) -> tuple[FreeRotor, tuple[float, ...]]:
    """The system and its coordinates from the body's principal axes and its initial state."""
    one, two, three = moments
    coupling = ((two - three) / one, (three - one) / two, (one - two) / three)
    system = FreeRotor(body, q_BP, moments, coupling, ZERO, ZERO, (0.0, 0.0), effects)
    w_P = rotate(conjugate(q_BP), B.w_WB_B)
    y = B.p_WC + quaternion_product(B.q_WB, q_BP) + B.v_WC + w_P
    return start_rotor(system, y), y


# Angular velocity of torque-free bodies among others: projected onto its initial polhode.
#
# In maximal coordinates, too, a torque-free body then keeps its energy and angular momentum as
# exactly as alone (see FreeRotor for why that matters near the middle axis).


class FreeSpin(NamedTuple):
    """The polhode of one of several bodies; fields as in FreeRotor."""

    body: int
    """index of the body."""
    q_BP: Quaternion
    moments: Vec3
    weights: Vec3 = ZERO
    contrast: Vec3 = ZERO
    polhode: tuple[float, float] = (0.0, 0.0)


CHANGING[FreeSpin] = Changing(8, polhode_inputs, with_polhode)


def untouched(system: MultiBody) -> list[int]:
    """Bodies without joints and without torque."""
    held = {i for c in system.constraints for i in (c.body, c.parent)}
    for effect in system.effects:
        if type(effect.row) not in CENTRAL or effect.parent >= 0:
            held |= {effect.body, effect.parent}
    return [i for i in range(system.bodies.shape[0]) if i not in held]


def with_spins(system: MultiBody, bodies: list[Inertial], principal: Any, y: Any) -> MultiBody:
    """The system with the polhodes of its torque-free bodies through the angular velocities in y.

    principal: function that returns the principal moments of an inertia and the quaternion from
    principal to body axes.
    """
    spins = []
    for i in untouched(system):
        moments, q_BP = principal(bodies[i].inertia)
        spins.append(FreeSpin(i, q_BP, moments))
    return start_spins(system._replace(spins=tuple(spins)), y)


def start_spins(system: MultiBody, y: Any) -> MultiBody:
    """The system with the polhodes through the angular velocities in y."""
    started = []
    for spin in system.spins:
        own = [float(x) for x in y[WIDTH * spin.body : WIDTH * (spin.body + 1)]]
        own[10:13] = rotate(conjugate(spin.q_BP), tuple(own[10:13]))
        started.append(start_rotor(spin, tuple(own)))  # type: ignore[arg-type]
    return system._replace(spins=tuple(started))


STARTS[MultiBody] = start_spins


def project_spins(system: MultiBody, y: list[Any]) -> None:
    """Project the angular velocities onto their polhodes, in place; only the change is rotated to
    body axes."""
    for spin in system.spins:
        first = WIDTH * spin.body + 10
        w_P = rotate(conjugate(spin.q_BP), tuple(y[first : first + 3]))
        change = rotate(spin.q_BP, sub(on_polhode(spin, w_P), w_P))
        for j in range(3):
            y[first + j] = y[first + j] + change[j]
