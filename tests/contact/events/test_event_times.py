# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every kind of event at its instant in closed form, to 1e-12 s.

The instants are located to the last digits of the time; what is left is the error of the state
there.  Where the motion up to the event is a polynomial in t that the method integrates exactly,
rk4 with one large step must do as well as a tight tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError
from rb_sim.mechanics.contact.contact_bodies import JAMMED
from tests.contact.scenes import G, ball, box, scene, touch
from tests.contact_runs import contact_run

EXACT = 1e-12
"""Error of an instant [s], relative to max(1 s, t)."""
TIGHT = {"tolerance": 1e-13}
COARSE = {"method": "rk4", "step": 0.4, "tolerance": None}
AFTER = 0.01
"""The runs go on for this long [s]."""


class Expected(NamedTuple):
    """A scene and the instants of some kinds of its events."""

    scene: dict[str, Any]
    instants: dict[str, list[float]]


def block(x: float = 0.0, **more: Any) -> dict[str, Any]:
    """A box of 1 kg on z = 0 that touches with the middle of its base and is kept upright."""
    return box([0.2, 0.2, 0.1], [x, 0, 0.05], **more)


def upright(start: dict[str, Any], contact: dict[str, Any], **effects: Any) -> dict[str, Any]:
    """The scene of such a block."""
    constraints = {
        "floor": contact | {"points": [[0, 0, -0.05]]},
        "tilt": {"type": "translation", "body": "body"},
    }
    return scene(start, constraints, **effects)


def ramp(force: list[float] | None = None, torque: list[float] | None = None) -> dict[str, Any]:
    """A load that grows from zero by (force, torque) per second."""
    table: dict[str, Any] = {"type": "wrench_table", "body": "body", "times": [0.0, 10.0]}
    for name, rate in (("forces", force), ("torques", torque)):
        if rate is not None:
            table[name] = [[0.0] * 3, [10.0 * x for x in rate]]
    return table


def quadrature(f: Callable[[np.ndarray], np.ndarray], a: float, b: float) -> float:
    """Integral of a smooth f from a to b to round-off (Gauss-Legendre, 60 nodes)."""
    x, w = np.polynomial.legendre.leggauss(60)
    return float(0.5 * (b - a) * (w @ f(0.5 * (a + b) + 0.5 * (b - a) * x)))


# motion that is a polynomial in t


def thrown_up() -> Expected:
    """z = h + v t - g t^2 / 2 lands without rebound."""
    h, v = 0.3, 2.0
    start = ball([0, 0, 0.1 + h], linear_velocity=[0.5, 0, v])
    return Expected(scene(start, touch()), {"closes": [(v + math.sqrt(v * v + 2.0 * G * h)) / G]})


def bounces() -> Expected:
    """Every impact from a height h: sqrt(2 h/g) (1 + 2 e + 2 e^2 + ...)."""
    h, e = 0.5, 0.7
    fall = math.sqrt(2.0 * h / G)
    instants, t = [], fall
    for i in range(5):
        instants.append(t)
        t += 2.0 * fall * e ** (i + 1)
    return Expected(scene(ball([0, 0, 0.1 + h]), touch(restitution=e)), {"impact": instants})


def zeno() -> Expected:
    """An infinity of bounces ends at sqrt(2 h/g) (1 + e)/(1 - e)."""
    h, e = 0.05, 0.4
    rest = math.sqrt(2.0 * h / G) * (1.0 + e) / (1.0 - e)
    return Expected(scene(ball([0, 0, 0.1 + h]), touch(restitution=e)), {"rests": [rest]})


def head_on() -> Expected:
    """Two balls, 0.8 m apart, approach at 2 m/s."""
    bodies = {"a": ball([0, 0, 0]), "b": ball([-1, 0, 0], linear_velocity=[2, 0, 0])}
    hit = touch("b", parent="a", surface={"type": "shape"}, restitution=1.0)
    return Expected(scene(bodies, {"hit": hit}, gravity=False), {"impact": [0.4]})


def slip_ends_in_rolling(r: float = 0.1) -> Expected:
    """2 v / (7 mu g), whatever the radius."""
    v, mu = 2.0, 0.15
    start = ball([0, 0, r], r, linear_velocity=[v, 0, 0])
    return Expected(scene(start, touch(mu=mu)), {"sticks": [2.0 * v / (7.0 * mu * G)]})


def sliding_block_stops() -> Expected:
    """v / (mu_k g)."""
    v, mu = 2.0, 0.25
    start = block(linear_velocity=[v, 0, 0])
    return Expected(upright(start, touch(mu=0.4, kinetic=mu)), {"sticks": [v / (mu * G)]})


def block_on_its_edge_stops() -> Expected:
    """What keeps it upright is a joint, so the lever of the friction does not matter: alone, it
    would jam at this mu."""
    v, mu = 2.0, 1.5
    mapping = upright(block(linear_velocity=[v, 0, 0]), touch(mu=mu))
    mapping["constraints"]["floor"]["points"] = [[0.03, 0, -0.05]]
    return Expected(mapping, {"sticks": [v / (mu * G)]})


def thrown_up_an_incline() -> Expected:
    """Slides up until v / (g (sin + mu cos)), and down again: tan above mu."""
    tilt, mu, v = 0.5, 0.2, 2.5
    normal = [math.sin(tilt), 0.0, math.cos(tilt)]
    start = ball([0.1 * n for n in normal])
    start["linear_velocity"] = [-v * math.cos(tilt), 0.0, v * math.sin(tilt)]
    constraints = {
        "floor": touch(
            mu=mu, surface={"type": "plane", "normal": normal}, points=[[-0.1 * n for n in normal]]
        ),
        "tilt": {"type": "translation", "body": "body"},
    }
    stop = v / (G * (math.sin(tilt) + mu * math.cos(tilt)))
    return Expected(scene(start, constraints), {"reverses": [stop]})


def pulled_until_it_slips() -> Expected:
    """A pull of c t reaches mu_s m g."""
    c, mu = 5.0, 0.6
    mapping = upright(block(), touch(mu=mu, kinetic=0.4), pull=ramp([c, 0, 0]))
    return Expected(mapping, {"slips": [mu * G / c]})


def lifted_until_it_slips() -> Expected:
    """A steady pull F and a lift of c t: F = mu (m g - c t)."""
    c, mu, pull = 4.0, 0.6, 2.0
    steady = {"type": "wrench", "body": "body", "force": [pull, 0, 0]}
    mapping = upright(block(), touch(mu=mu), pull=steady, lift=ramp([0, 0, c]))
    return Expected(mapping, {"slips": [(G - pull / mu) / c]})


def lifted_off() -> Expected:
    """A lift of c t reaches m g."""
    c = 7.0
    return Expected(upright(block(), touch(), lift=ramp([0, 0, c])), {"opens": [G / c]})


def rolling_ball_stops(r: float = 0.1) -> Expected:
    """a = -arm g / (r (1 + 2/5)); here arm / r is 3 %."""
    arm, v = 0.03 * r, 0.2
    start = ball([0, 0, r], r, linear_velocity=[v, 0, 0], angular_velocity=[0, v / r, 0])
    stop = v * r * 1.4 / (arm * G)
    mapping = scene(start, touch(mu=0.4, rolling_resistance=arm))
    return Expected(mapping, {"stops rolling": [stop]})


def pulled_until_it_rolls() -> Expected:
    """A pull of c t at the centre, r above the floor, against arm m g."""
    c, arm = 2.0, 0.01
    mapping = scene(ball([0, 0, 0.1]), touch(mu=0.8, rolling_resistance=arm), pull=ramp([c, 0, 0]))
    return Expected(mapping, {"rolls": [arm * G / (c * 0.1)]})


def spinning_ball_stops() -> Expected:
    """I w / (arm m g)."""
    arm, w = 0.002, 3.0
    start = ball([0, 0, 0.1], angular_velocity=[0, 0, w])
    stop = 0.4 * 0.01 * w / (arm * G)
    mapping = scene(start, touch(mu=0.4, spinning_resistance=arm))
    return Expected(mapping, {"stops spinning": [stop]})


def twisted_until_it_spins() -> Expected:
    """A torque of c t about the normal reaches arm m g."""
    c, arm = 0.05, 0.003
    mapping = scene(
        ball([0, 0, 0.1]), touch(mu=0.4, spinning_resistance=arm), twist=ramp(None, [0, 0, c])
    )
    return Expected(mapping, {"spins": [arm * G / c]})


# motion that is none, but of which the event knows only the time


def shaken(direction: list[float], amplitude: float, frequency: float) -> dict[str, Any]:
    return {
        "type": "shaken", "direction": direction, "amplitude": amplitude, "frequency": frequency
    }  # fmt: skip


def slips_on_a_shaken_table() -> Expected:
    """A w^2 sin(w t) = mu g: the block rides until the table pulls too hard."""
    amplitude, frequency, mu = 0.1, 1.0, 0.3
    w = 2.0 * math.pi * frequency
    start = block(linear_velocity=[amplitude * w, 0, 0])
    contact = touch(mu=mu, motion=shaken([1, 0, 0], amplitude, frequency))
    t = math.asin(mu * G / (amplitude * w * w)) / w
    return Expected(upright(start, contact), {"slips": [t]})


def leaves_a_shaken_table() -> Expected:
    """A w^2 sin(w t) = g: the table falls away."""
    amplitude, frequency = 0.4, 1.0
    w = 2.0 * math.pi * frequency
    start = block(linear_velocity=[0, 0, amplitude * w])
    contact = touch(motion=shaken([0, 0, 1], amplitude, frequency))
    t = math.asin(G / (amplitude * w * w)) / w
    return Expected(upright(start, contact), {"opens": [t]})


def slips_under_a_harmonic_pull() -> Expected:
    """Nothing moves until 1.02 mu m g sin(w t) reaches mu m g, for a fifteenth of a period only."""
    mu, w = 0.5, 5.0
    pull = {"type": "wrench", "body": "body", "sine_force": [1.02 * mu * G, 0, 0]}
    mapping = upright(block(), touch(mu=mu), pull=pull | {"angular_frequency": w})
    return Expected(mapping, {"slips": [math.asin(1.0 / 1.02) / w]})


def leaves_under_a_harmonic_lift() -> Expected:
    """1.02 m g sin(w t) reaches m g."""
    w = 5.0
    lift = {"type": "wrench", "body": "body", "sine_force": [0, 0, 1.02 * G]}
    mapping = upright(block(), touch(), lift=lift | {"angular_frequency": w})
    return Expected(mapping, {"opens": [math.asin(1.0 / 1.02) / w]})


# motion that has to be integrated


def off_a_sphere(rolls: bool) -> Expected:
    """Radius R, ball r, l = R + r: th'^2 = w^2 + 2 k (g/l) (cos th0 - cos th), where k = 1 if it
    slides and 5/7 if it rolls; it leaves where g cos th = l th'^2."""
    R, r, start, w = 1.0, 0.1, 0.1, 0.3
    length, k = R + r, 5.0 / 7.0 if rolls else 1.0
    fast = 2.0 * k * G / length
    leaves = math.acos((fast * math.cos(start) + w * w) / (G / length + fast))
    t = quadrature(
        lambda th: 1.0 / np.sqrt(w * w + fast * (math.cos(start) - np.cos(th))), start, leaves
    )
    speed = length * w
    solid = ball(
        [length * math.sin(start), 0, length * math.cos(start)],
        r,
        linear_velocity=[speed * math.cos(start), 0, -speed * math.sin(start)],
        angular_velocity=[0, speed / r if rolls else 0.0, 0],
    )
    surface = {"type": "sphere", "center": [0, 0, 0], "radius": R}
    friction = {"friction": {"type": "rough"}} if rolls else {}
    return Expected(scene(solid, touch(surface=surface) | friction), {"opens": [t]})


def swings(x: float, mu: float, k: float = 100.0, **contact: Any) -> dict[str, Any]:
    """The block on a spring, x away from where it is loose."""
    spring = {"type": "spring", "body": "body", "stiffness": k, "rest_length": 0.0}
    pull = spring | {"point_A": [x, 0.0, 0.05]}
    return upright(block(), touch(mu=mu, **contact), spring=pull)


def spring_driven_reversal(**contact: Any) -> Expected:
    """Each half swing takes pi / sqrt(k/m), whatever the friction, and is 2 mu m g / k shorter; the
    second ends where the spring holds no more than mu m g."""
    half = math.pi / 10.0
    return Expected(swings(0.045, 0.1, **contact), {"reverses": [half], "sticks": [2.0 * half]})


def stick_slip() -> Expected:
    """A spring drags the block in jerks: in slip its stretch beyond mu_k m g/k is
    d cos(w t) + (v/w) sin(w t), and it sticks again where that has the rate v."""
    k, v, static, kinetic = 100.0, 0.05, 0.3, 0.2
    spring = {"type": "spring", "body": "body", "stiffness": k, "rest_length": 0.0}
    mapping = upright(
        block(),
        touch(mu=static, kinetic=kinetic),
        spring=spring | {"point_A": [0, 0, 0.05]},
        drive=ramp([k * v, 0, 0]),
    )
    w, d = math.sqrt(k), (static - kinetic) * G / k
    slip_time, stick_time = 2.0 * (math.pi - math.atan(w * d / v)) / w, 2.0 * d / v
    first = static * G / (k * v)
    stick = first + slip_time
    return Expected(mapping, {"slips": [first, stick + stick_time], "sticks": [stick]})


def compliant() -> Expected:
    """Dropped from h on a spring: leaves after (2/w) (pi - atan(v w/g)) when it is loose."""
    k, h = 1e4, 0.05
    w, fall = math.sqrt(k), math.sqrt(2.0 * h / G)
    inside = 2.0 * (math.pi - math.atan(G * fall * w / G)) / w
    mapping = scene(ball([0, 0, 0.1 + h]), touch(compliance={"stiffness": k}))
    return Expected(mapping, {"closes": [fall], "opens": [fall + inside]})


def damped_compliant() -> Expected:
    """Without weight, from the surface at v: depth = (v/w) exp(-a t) sin(w t), with the damper's
    pull it lets go where k depth + c rate = 0: tan(w t) = -c w / (k - a c)."""
    k, c, v = 1e4, 50.0, 1.0
    a = 0.5 * c
    w = math.sqrt(k - a * a)
    t = (math.pi - math.atan2(c * w, k - a * c)) / w
    start = ball([0, 0, 0.1], linear_velocity=[0, 0, -v])
    contact = touch(compliance={"stiffness": k, "damping": c})
    return Expected(scene(start, contact, gravity=False), {"opens": [t]})


POLYNOMIAL: dict[str, Callable[[], Expected]] = {
    f.__name__: f
    for f in (
        thrown_up, bounces, zeno, head_on, slip_ends_in_rolling, sliding_block_stops,
        block_on_its_edge_stops, thrown_up_an_incline, pulled_until_it_slips,
        lifted_until_it_slips, lifted_off, rolling_ball_stops, pulled_until_it_rolls,
        spinning_ball_stops, twisted_until_it_spins, slips_on_a_shaken_table,
        leaves_a_shaken_table, slips_under_a_harmonic_pull, leaves_under_a_harmonic_lift,
    )
}  # fmt: skip
SMOOTH: dict[str, Callable[[], Expected]] = {
    "slides_off_a_sphere": lambda: off_a_sphere(False),
    "rolls_off_a_sphere": lambda: off_a_sphere(True),
    "spring_driven_reversal": spring_driven_reversal,
    "bilateral_reversal": lambda: spring_driven_reversal(mode="bilateral"),
    "stick_slip": stick_slip,
    "compliant": compliant,
    "damped_compliant": damped_compliant,
}
LARGE = 1000.0
"""Radius of a ball that turns so little that rk4 is exact: it is so for polynomials only, which the
components of a quaternion are not [m]."""
COARSELY = POLYNOMIAL | {
    "slip_ends_in_rolling": lambda: slip_ends_in_rolling(LARGE),
    "rolling_ball_stops": lambda: rolling_ball_stops(LARGE),
}


def check(expected: Expected, **options: Any) -> None:
    end = max(instants[-1] for instants in expected.instants.values()) + AFTER
    found = contact_run(expected.scene, [0.0, end], **options)
    for kind, exact in expected.instants.items():
        instants = [t for t in found.times(kind) if t > 0.0]
        for t, t_exact in zip(instants, exact, strict=True):
            assert abs(t - t_exact) <= EXACT * max(1.0, t_exact), (kind, t, t - t_exact)


@pytest.mark.parametrize("name", [*POLYNOMIAL, *SMOOTH])
def test_tight(name: str) -> None:
    check((POLYNOMIAL | SMOOTH)[name](), **TIGHT)


@pytest.mark.parametrize("name", COARSELY)
def test_large_steps_where_they_are_exact(name: str) -> None:
    check(COARSELY[name](), **COARSE)


@pytest.mark.parametrize(("radius", "fast"), [(0.05, 3e-6), (0.6, 1e-5)])
def test_every_bounce_until_the_ball_rests(radius: float, fast: float) -> None:
    """Some 60 impacts, the last at 3e-6 or 1e-5 m/s: 1e-17 m of height would be 3e-12 s there.  It
    is a difference of coordinates whose last digit is 7e-18 m, and 1.1e-16 m of the larger ball:
    those that summation keeps count."""
    h, e = 1.0, 0.8
    fall = math.sqrt(2.0 * h / G)
    mapping = scene(ball([0.0, 0.0, radius + h], radius), touch(restitution=e))
    found = contact_run(mapping, [0.0, 4.1]).times("impact")
    assert G * fall * e ** (len(found) - 1) < 1.5 * fast
    exact = [fall * (1.0 + 2.0 * e * (1.0 - e**k) / (1.0 - e)) for k in range(len(found))]
    assert np.abs(np.array(found) - exact).max() <= EXACT


@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
def test_location_is_exact_whatever_the_error_of_the_state(tolerance: float) -> None:
    """At the instant found, N = m (g cos - v^2 / l) of the state that was computed is round-off."""
    mapping = off_a_sphere(False).scene
    (t,) = contact_run(mapping, [1.0], tolerance=tolerance).times("opens")
    r = contact_run(mapping, [t], tolerance=tolerance).trajectory
    p, v = r.position["body"][0], r.linear_velocity["body"][0]
    length = float(np.linalg.norm(p))
    assert abs(G * p[2] / length - v @ v / length) <= 1e-13 * G


def dragged_rod(mu: float) -> tuple[dict[str, Any], float]:
    """(scene, instant) of a rod of 1 m, hinged 0.5 m above a table that moves away below its end
    and drags it against its slope: where h is its height and x its reach, N is proportional to
    1 / (1 - mu h/x), and the rod jams where that falls to JAMMED."""
    h, fall, frequency = 0.5, 0.3, 0.25
    x, w = math.sqrt(1.0 - h * h), 2.0 * math.pi * frequency
    spin = fall * w / x
    rod = {
        "mass": 1.0,
        "inertia": [0.1, 0.1, 0.1],
        "position": [0.5 * x, 0.0, 0.5 * h],
        "linear_velocity": [-0.5 * spin * h, 0.0, -0.5 * spin * x],
        "angular_velocity": [0.0, spin, 0.0],
    }
    table = shaken([-0.8, 0.0, -0.6], fall / 0.6, frequency)
    hinge = {"point_B": [-0.5 * x, 0.0, 0.5 * h], "axis_B": [0.0, 1.0, 0.0]}
    constraints = {
        "hinge": {"type": "fixed_axis", "body": "body"} | hinge,
        "floor": touch(mu=mu, points=[[0.5 * x, 0.0, -0.5 * h]], motion=table),
    }
    steep = (1.0 - JAMMED) / mu
    jams = steep / math.hypot(1.0, steep)
    return scene(rod, constraints), math.asin((jams - h) / fall) / w


@pytest.mark.parametrize("mu", [0.9, 1.2])
def test_jams(mu: float) -> None:
    """The hinge decides when: of a free rod the same point would jam elsewhere.  No impact frees
    what is wedged."""
    mapping, exact = dragged_rod(mu)
    text, t = _jam(mapping)
    assert "Painleve's paradox" in text
    assert "no impact stops the slip" in text
    assert abs(t - exact) <= EXACT


def _jam(mapping: dict[str, Any]) -> tuple[str, float]:
    """What a run that ends in an error says, and where it stands."""
    simulation = Simulation(load_scene(mapping | {"simulation": {"duration": 1.0} | TIGHT}))
    try:
        simulation.advance(1.0)
    except SimulationError as error:
        return str(error), simulation._motion._grid.t1
    return "", simulation.time
