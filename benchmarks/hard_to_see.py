# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random scenes whose errors are hard to see, for benchmarks.silent_runs."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

Mapping = dict[str, Any]

WEIGHT: Mapping = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}


def scene(rng: random.Random, kind: str | None = None) -> tuple[str, Mapping]:
    """A scene of one of KINDS, by name or by lot, and its kind."""
    name = kind or rng.choice(list(KINDS))
    bodies, constraints, effects, duration = KINDS[name](rng)
    count = rng.choice((200, 200, 1000, 20, 5))
    options = {"duration": duration, "rate": count / duration}
    made = {"bodies": bodies, "constraints": constraints, "effects": effects, "simulation": options}
    return name, made


Parts = tuple[Mapping, Mapping, Mapping, float]


def log_uniform(rng: random.Random, low: float, high: float) -> float:
    return 10.0 ** rng.uniform(math.log10(low), math.log10(high))


def vector(rng: random.Random, size: float = 1.0) -> list[float]:
    return [rng.gauss(0.0, size) for _ in range(3)]


def body(mass: float = 1.0, size: float = 1.0, **more: Any) -> Mapping:
    moments = [mass * size**2 * share for share in (0.05, 0.08, 0.11)]
    return {"mass": mass, "inertia": moments, "position": [0.0, 0.0, 0.0]} | more


def spring(rng: random.Random) -> Parts:
    """One on a spring of any stiffness, for up to 100 s."""
    place = [rng.uniform(0.1, 2.0), 0.0, 0.0]
    law = {"type": "spring", "body": "p", "stiffness": log_uniform(rng, 1.0, 1e4)}
    return {"p": body(position=place)}, {}, {"s": law}, rng.choice((5.0, 20.0, 100.0))


def stiff_springs(rng: random.Random) -> Parts:
    """Three in a row on springs of very different stiffness, some damped, off their centres."""
    names = ("a", "b", "c")
    bodies = {
        name: body(log_uniform(rng, 0.01, 10.0), position=[1.0 + k, 0.0, 0.0])
        for k, name in enumerate(names)
    }
    bodies["c"]["linear_velocity"] = vector(rng)
    effects: Mapping = {"weight": WEIGHT}
    for k, name in enumerate(names):
        law: Mapping = {"type": "spring", "body": name, "stiffness": log_uniform(rng, 1.0, 1e6)}
        law |= {"damping": rng.choice((0.0, 0.1, 10.0)), "point_B": [0.0, 0.1, 0.0]}
        law |= {"parent": names[k - 1]} if k else {"point_A": [0.0, 0.0, 0.0]}
        effects[f"s{k}"] = law | {"rest_length": rng.choice((0.0, 0.9))}
    return bodies, {}, effects, rng.choice((0.5, 3.0))


def sines(rng: random.Random) -> Parts:
    """A force that oscillates, mostly much faster than the motion."""
    own = body(angular_velocity=vector(rng))
    load: Mapping = {"type": "wrench", "body": "p", "sine_force": vector(rng, 2e3), "frame": "body"}
    load["angular_frequency"] = log_uniform(rng, 10.0, 5e3)
    return {"p": own}, {}, {"w": load}, 2.0


def pulses(rng: random.Random) -> Parts:
    """Short pushes out of a table, long after each other, on a body that hangs or flies."""
    duration = rng.choice((2.0, 10.0))
    times, forces = [], []
    starts = sorted(rng.uniform(0.05, 0.9) * duration for _ in range(3))
    for k, start in enumerate(starts):
        end = duration if k == 2 else starts[k + 1]
        width = min(log_uniform(rng, 1e-5, 0.1), 0.5 * (end - start))
        times += [start, start + 0.5 * width, start + width]
        forces += [[0.0] * 3, vector(rng, 2.0 / width), [0.0] * 3]
    table = {"type": "wrench_table", "body": "p", "times": times, "forces": forces}
    table["point_B"] = vector(rng, 0.1)
    joint = {"type": "fixed_point", "body": "p", "point_B": [0.0, 0.0, 1.0]}
    constraints = rng.choice(({}, {"j": joint}))
    return (
        {"p": body()},
        constraints,
        {"t": table} | ({"w": WEIGHT} if constraints else {}),
        duration,
    )


def upright(rng: random.Random) -> Parts:
    """A pendulum that begins next to its unstable equilibrium."""
    tilt = log_uniform(rng, 1e-4, 1.0)
    own = body(position=[math.sin(tilt), 0.0, math.cos(tilt)])
    own["orientation"] = {"axis": [0, 1, 0], "angle": tilt}
    joint = {"type": "fixed_point", "body": "p", "point_B": [0.0, 0.0, -1.0]}
    return {"p": own}, {"j": joint}, {"w": WEIGHT}, rng.choice((2.0, 10.0))


def top(rng: random.Random) -> Parts:
    """A heavy top, from slow to a thousand times faster than it precesses."""
    bodies, joints, effects, duration = upright(rng)
    bodies["p"]["angular_velocity"] = [0.0, 0.0, log_uniform(rng, 5.0, 1e3)]
    return bodies, joints, effects, duration


def tumbling(rng: random.Random) -> Parts:
    """A free body that spins about its middle axis, almost."""
    spin = [log_uniform(rng, 1e-6, 1.0), log_uniform(rng, 1.0, 100.0), 0.0]
    return {"p": body(angular_velocity=spin)}, {}, {}, rng.choice((1.0, 10.0))


def chain(rng: random.Random) -> Parts:
    """Two or three pendulums on each other, of masses and lengths far apart, thrown high."""
    count, bodies, joints, place = rng.choice((2, 3)), {}, {}, 0.0
    for k in range(count):
        length, name = log_uniform(rng, 0.03, 1.0), f"p{k}"
        bodies[name] = body(log_uniform(rng, 1e-3, 10.0), length, position=[place + length, 0, 0])
        joints[f"j{k}"] = {"type": "fixed_axis", "body": name, "axis_B": [0, 1, 0]}
        joints[f"j{k}"]["point_B"] = [-length, 0.0, 0.0]
        if k:
            joints[f"j{k}"]["parent"] = f"p{k - 1}"
        place += 2.0 * length
    bodies[name]["angular_velocity"] = [0.0, rng.gauss(0.0, 5.0), 0.0]
    return bodies, joints, {"w": WEIGHT}, rng.choice((1.0, 4.0))


def far_scales(rng: random.Random) -> Parts:
    """A small light body on a spring beside a large heavy one that spins or flies."""
    own, other = body(100.0, 3.0), body(1e-4, 1e-2, position=[5.0, 0.0, 0.0])
    own["angular_velocity"] = vector(rng, log_uniform(rng, 0.01, 1.0))
    other["linear_velocity"] = vector(rng, log_uniform(rng, 0.1, 30.0))
    law = {"type": "spring", "body": "b", "parent": "a", "point_A": [4.0, 0.0, 0.0]}
    law |= {"stiffness": log_uniform(rng, 1e-3, 10.0), "rest_length": 0.5}
    return {"a": own, "b": other}, {}, {"s": law}, rng.choice((1.0, 10.0))


def scaled(rng: random.Random) -> Parts:
    """A swing, or a tumbling body on a spring, of 1e-6 m to 1e6 m, in its own time."""
    size = log_uniform(rng, 1e-6, 1e6)
    period = math.sqrt(size / 9.81)
    own = body(log_uniform(rng, 1e-3, 1e3), size, position=[size, 0.0, 0.0])
    if rng.random() < 0.5:
        own["angular_velocity"] = vector(rng, 1.0 / period)
        law = {"type": "spring", "body": "p", "stiffness": own["mass"] * 10.0 / period**2}
        return {"p": own}, {}, {"s": law}, 10.0 * period
    own["angular_velocity"] = [0.0, rng.gauss(0.0, 1.0 / period), 0.0]
    joint = {"type": "fixed_point", "body": "p", "point_B": [-size, 0.0, 0.0]}
    return {"p": own}, {"j": joint}, {"w": WEIGHT}, 20.0 * period


def far_away(rng: random.Random) -> Parts:
    """A double pendulum, or a spring, a million metres from the origin."""
    away = vector(rng, log_uniform(rng, 1e3, 1e6))
    place = [away[0] + 1.0, away[1], away[2]]
    if rng.random() < 0.5:
        law = {"type": "spring", "body": "p", "point_A": away, "rest_length": 0.4}
        law["stiffness"] = log_uniform(rng, 1.0, 1e4)
        return {"p": body(position=place)}, {}, {"s": law, "w": WEIGHT}, 3.0
    joint = {"type": "fixed_point", "body": "p", "point_B": [-1.0, 0.0, 0.0]}
    own = body(position=place, angular_velocity=vector(rng))
    return {"p": own}, {"j": joint}, {"w": WEIGHT}, 5.0


def small_swing(rng: random.Random) -> Parts:
    """A pendulum or a torsion spring that moves by a micrometre, or a nanometre."""
    rate = log_uniform(rng, 1e-9, 1e-3)
    own = body(position=[0.0, 0.0, -1.0], angular_velocity=[0.0, rate, 0.0])
    if rng.random() < 0.5:
        joint = {"type": "fixed_point", "body": "p", "point_B": [0.0, 0.0, 1.0]}
        return {"p": own}, {"j": joint}, {"w": WEIGHT}, 20.0
    joint = {"type": "fixed_axis", "body": "p", "axis_B": [0, 1, 0]}
    law = {"type": "torsion_spring", "body": "p", "axis_B": [0, 1, 0]}
    return {"p": own}, {"j": joint}, {"s": law | {"stiffness": log_uniform(rng, 0.1, 1e4)}}, 5.0


def slow_drift(rng: random.Random) -> Parts:
    """Drag that a sine works against: the mean goes slowly away under a fast oscillation."""
    own = body(linear_velocity=[log_uniform(rng, 1e-3, 0.1), 0.0, 0.0])
    load: Mapping = {
        "type": "wrench",
        "body": "p",
        "sine_force": [rng.uniform(1.0, 100.0), 0.0, 0.0],
    }
    load |= {"angular_frequency": log_uniform(rng, 10.0, 300.0), "force": [0.01, 0.0, 0.0]}
    drag = {"type": "quadratic_drag", "body": "p", "coefficient": log_uniform(rng, 0.01, 10.0)}
    return {"p": own}, {}, {"w": load, "d": drag}, rng.choice((5.0, 50.0))


def driven(rng: random.Random) -> Parts:
    """A hinge that is turned at a rate, with a pendulum on it."""
    arm = body(position=[0.0, 0.0, 0.0])
    bob = body(0.3, 0.3, position=[1.0, 0.0, -0.5], angular_velocity=vector(rng))
    hinge = {"type": "fixed_axis", "body": "arm", "axis_B": [0, 0, 1]}
    drive: Mapping = {"type": "velocity", "body": "arm", "angular": [0.0, 0.0, 1.0]}
    drive["rate"] = log_uniform(rng, 0.1, 30.0)
    ball = {"type": "fixed_point", "body": "bob", "parent": "arm", "point_B": [0.0, 0.0, 0.5]}
    joints = {"hinge": hinge, "drive": drive, "ball": ball}
    return {"arm": arm, "bob": bob}, joints, {"w": WEIGHT}, rng.choice((2.0, 10.0))


def linkage(rng: random.Random) -> Parts:
    """A crank, a rocker and a coupler between them, of any lengths."""
    bodies, joints = {}, {}
    for name, x, length in (("crank", 0.0, rng.uniform(0.2, 0.6)), ("rocker", 2.0, 1.0)):
        bodies[name] = body(1.0, length, position=[x + 0.5 * length, 0.0, 0.2])
        bodies[name]["orientation"] = {"axis": [0, 1, 0], "angle": rng.uniform(-2.0, -1.0)}
        joints[name] = {"type": "fixed_axis", "body": name, "axis_B": [0, 1, 0]}
        joints[name]["point_B"] = [-0.5 * length, 0.0, 0.0]
        joints[name]["point_A"] = [x, 0.0, 0.0]
    link = {"type": "distance", "body": "rocker", "parent": "crank", "point_B": [0.5, 0.0, 0.0]}
    joints["coupler"] = link | {"point_A": [0.1, 0.0, 0.0]}
    bodies["crank"]["angular_velocity"] = [0.0, rng.uniform(-20.0, 20.0), 0.0]
    return bodies, joints, {"w": WEIGHT}, 2.0


def on_slope(rng: random.Random) -> Parts:
    """A box on a slope that it hardly leaves or hardly goes down, or on which it rests."""
    angle, factor = rng.uniform(0.1, 0.6), rng.choice((0.5, 0.9, 0.999, 1.001, 1.2))
    c, s = math.cos(angle), math.sin(angle)
    speed = rng.choice((0.0, log_uniform(rng, 1e-5, 1.0)))
    own: Mapping = {"mass": 1.0, "shape": {"type": "box", "size": [0.3, 0.2, 0.2]}}
    own |= {"orientation": {"axis": [0, 1, 0], "angle": angle}, "position": [0.1 * s, 0.0, 0.1 * c]}
    own["linear_velocity"] = [speed * c, 0.0, -speed * s]
    friction = {"type": "coulomb", "static": factor * math.tan(angle)}
    touch = {"type": "contact", "body": "p", "surface": {"type": "plane", "normal": [s, 0.0, c]}}
    return {"p": own}, {"c": touch | {"friction": friction}}, {"w": WEIGHT}, 1.0


def rolling_ball(rng: random.Random) -> Parts:
    """A ball with friction on a floor, a slope or a turntable: slides, then rolls."""
    own: Mapping = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
    own["position"] = [0.3, 0.0, rng.choice((0.1, 0.1, 0.5))]
    own["linear_velocity"] = [*vector(rng)[:2], 0.0]
    own["angular_velocity"] = vector(rng, log_uniform(rng, 0.01, 30.0))
    touch: Mapping = {"type": "contact", "body": "p", "restitution": rng.choice((0.0, 0.7))}
    touch["friction"] = {"type": "coulomb", "static": log_uniform(rng, 0.01, 0.5)}
    if rng.random() < 0.5:
        touch["motion"] = {"type": "turntable", "rate": rng.uniform(-5.0, 5.0)}
    return {"p": own}, {"c": touch}, {"w": WEIGHT}, rng.choice((1.0, 5.0))


def stick_slip(rng: random.Random) -> Parts:
    """A box on a belt, held by a spring: sticks and slips in turn."""
    own: Mapping = {"mass": 1.0, "shape": {"type": "box", "size": [0.3, 0.2, 0.2]}}
    own["position"] = [0.0, 0.0, 0.1]
    touch: Mapping = {"type": "contact", "body": "p"}
    touch["friction"] = {"type": "coulomb", "static": 0.5, "kinetic": rng.uniform(0.2, 0.5)}
    touch["motion"] = {"type": "shaken", "direction": [1.0, 0.0, 0.0]}
    touch["motion"] |= {"amplitude": log_uniform(rng, 0.01, 0.3), "frequency": rng.uniform(0.3, 5)}
    law: Mapping = {"type": "spring", "body": "p", "point_A": [0.0, 0.0, 0.1]}
    law["stiffness"] = log_uniform(rng, 1.0, 300.0)
    return {"p": own}, {"c": touch}, {"w": WEIGHT, "s": law}, 3.0


KINDS: dict[str, Callable[[random.Random], Parts]] = {
    kind.__name__: kind
    for kind in (
        spring, stiff_springs, sines, pulses, upright, top, tumbling, chain, far_scales, scaled,
        far_away, small_swing, slow_drift, driven, linkage, on_slope, rolling_ball, stick_slip,
    )
}  # fmt: skip
"""By name."""
