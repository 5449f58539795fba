# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Nanoseconds per step inside a compiled block, beside a plain RK4 written by hand.

    python -m benchmarks.steps [--rounds N] [--json FILE]

Every round measures each pair once, so that all share the machine's state; given are the least and
the median over the rounds, and the ratio of the medians to the hand-written heavy top.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import machine
from benchmarks.peers import scenes
from rb_sim import Simulation, load_scene
from rb_sim.compiler.program import Entry

SCENES = {
    "free body": "gazebo_boxes",
    "fixed point": "heavy_top",
    "fixed axis": "pendulum",
    "rolling sphere": "rolling_sphere",
    "rolling disk": "rolling_disk",
}
METHODS = ("euler", "rk4", "dopri853", "gauss6")
STEP = 1e-4
COUNT = 10_000
BY_HAND = "heavy top by hand"

Floats = tuple[float, float, float, float, float, float, float]


def top_rates(y: Floats, k: Floats) -> Floats:
    """Quaternion and spin of the symmetric heavy top about its fixed point.

    k: (I2-I3)/I1, (I3-I1)/I2, (I1-I2)/I3, m g l/I1, m g l/I3 about the fixed point, 0, 0.
    """
    x, y_, z, s, a, b, c = y
    return (
        0.5 * (s * a + y_ * c - z * b),
        0.5 * (s * b + z * a - x * c),
        0.5 * (s * c + x * b - y_ * a),
        -0.5 * (x * a + y_ * b + z * c),
        k[0] * (b * c) + k[3] * (1.0 - 2.0 * (x * x + y_ * y_)),
        k[1] * (c * a),
        k[2] * (a * b) - 2.0 * k[4] * (x * z - y_ * s),
    )


def ahead(y: Floats, h: float, r: Floats) -> Floats:
    """y + h r."""
    return (
        y[0] + h * r[0],
        y[1] + h * r[1],
        y[2] + h * r[2],
        y[3] + h * r[3],
        y[4] + h * r[4],
        y[5] + h * r[5],
        y[6] + h * r[6],
    )


@Entry
def top_by_hand(y: Floats, k: Floats, h: float, count: int) -> Floats:
    """`count` steps of the classical RK4, and the quaternion made unit after each."""
    for _ in range(count):
        r1 = top_rates(y, k)
        r2 = top_rates(ahead(y, 0.5 * h, r1), k)
        r3 = top_rates(ahead(y, 0.5 * h, r2), k)
        r4 = top_rates(ahead(y, h, r3), k)
        y = ahead(ahead(ahead(ahead(y, h / 6, r1), h / 3, r2), h / 3, r3), h / 6, r4)
        unit = (y[0] * y[0] + y[1] * y[1] + y[2] * y[2] + y[3] * y[3]) ** -0.5
        y = (y[0] * unit, y[1] * unit, y[2] * unit, y[3] * unit, y[4], y[5], y[6])
    return y


def hand_written() -> Callable[[], None]:
    """COUNT steps of top_by_hand, compiled."""
    scene = scenes.load("heavy_top")
    m, length, g = scene.mass, float(scene.center[1]), float(scene.gravity[2])
    i1, i2, i3 = (float(i) for i in scene.inertia)
    i1, i3 = i1 + m * length**2, i3 + m * length**2
    pull = m * g * length
    k = ((i2 - i3) / i1, (i3 - i1) / i2, (i1 - i2) / i3, pull / i1, pull / i3, 0.0, 0.0)
    start = (*scene.quaternion.tolist(), *scene.spin.tolist())
    top_by_hand(start, k, STEP, 1)

    def go() -> None:
        top_by_hand(start, k, STEP, COUNT)

    return go


def of_scene(name: str, method: str) -> Callable[[], None]:
    """COUNT fixed steps of one `advance`, compiled."""
    scene = load_scene(scenes.CONFIG / f"{name}.yaml", method=method, step=STEP)
    simulation = Simulation(scene)
    simulation.advance(STEP)

    def go() -> None:
        simulation.reset()
        simulation.advance(COUNT * STEP)

    go()
    if not COUNT <= simulation.steps <= COUNT + 1:
        raise AssertionError(f"{name}: {simulation.steps} steps where {COUNT} were meant")
    return go


def measure(cases: dict[str, Callable[[], None]], rounds: int) -> dict[str, dict[str, float]]:
    """Least and median CPU time per step [ns], and the ratio of medians to BY_HAND."""
    taken: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(rounds):
        for name, go in cases.items():
            begin = time.process_time()
            go()
            taken[name].append((time.process_time() - begin) / COUNT * 1e9)
    base = statistics.median(taken[BY_HAND])
    return {
        name: {
            "least": min(values),
            "median": statistics.median(values),
            "ratio": statistics.median(values) / base,
        }
        for name, values in taken.items()
    }


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.steps")
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with machine.alone():
        cases = {BY_HAND: hand_written()}
        for label, name in SCENES.items():
            for method in METHODS:
                cases[f"{label}, {method}"] = of_scene(name, method)
        about: dict[str, Any] = machine.describe(["numpy", "llvmlite", "rb_sim"])
        table = measure(cases, options.rounds)
    print(machine.line(about))
    print(f"{'case':28s} {'least ns':>9s} {'median ns':>9s} {'ratio':>7s}")
    for name, row in table.items():
        print(f"{name:28s} {row['least']:9.0f} {row['median']:9.0f} {row['ratio']:7.2f}")
    if options.json:
        text = json.dumps({"machine": about, "steps": table}, indent=1)
        options.json.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
