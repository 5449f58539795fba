# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`python -m benchmarks.heaps`: heaps in rb_sim beside MuJoCo and Drake, in one run.

Each heap is stepped at 1 ms from its start for two seconds, in four parts. Printed are the CPU time
of a step in the first part (falling, settling) and the least of the others, the deepest overlap at
the ends of the parts, how far any body moved in the last half second, and of rb_sim how many steps
its solver left unsolved, and how far the law of a contact gave way. Then what effects cost a stack
of five, a cube of 216 balls that falls apart, and stacks of 2 to 10 boxes for `--stand` seconds at
three steps, which takes some ten minutes of CPU time: `--part` runs one of the four alone. The
tables are written to docs/heaps.md as they come; a part that is not run stays.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import machine
from benchmarks.heaps import scenes
from benchmarks.heaps.engines import ENGINES
from benchmarks.heaps.overlap import deepest

PAGE_PARTS = ("heaps", "effects", "dropped", "stacks")
"""Sections of the page, in their order."""
STEP, PARTS, PART = 1e-3, 4, 500
HEAPS: dict[str, Callable[[], dict[str, Any]]] = {
    "10 piled spheres": scenes.piled_balls,
    "stack of 5 boxes": lambda: scenes.stack(5),
    "stack of 10 boxes": lambda: scenes.stack(10),
    "pyramid of 15 boxes": scenes.pyramid,
    "30 spheres in a bin": scenes.balls_in_bin,
    "10 dominoes": scenes.dominoes,
}
STEPS = (1e-2, 1e-3, 1e-4)
PAGE = Path(__file__).parents[2] / "docs" / "heaps.md"
HEAD = """\
---
search: {exclude: true}
---

# Heaps compared with other programs

Every heap falls or stands under its weight, with a friction coefficient of 0.5. All engines take
the same step. MuJoCo and Drake run with their default solvers, whose contacts are compliant;
contacts of rb_sim are rigid.

Column `solver`: number of steps that are not solved, largest change of an impulse in the last sweep
of such a step, and largest violation of a contact law (a jammed moving heap may have no rigid
solution). Both are relative to the largest impulse of the step.
"""
WRITTEN = """
Written by `python -m benchmarks.heaps{arguments}`, all in one run. {machine}. {versions}.
"""
TABLE = """
## Two seconds at 1 ms
{written}
*First*, *later*: CPU time of a step [us] in the first half second, and the least of the three
other half seconds. *Overlap*: the deepest at the end of any half second. *Moved*: largest
displacement of a body in the last half second.

| heap | engine | first [us] | later [us] | overlap [m] | moved [m] | solver |
|---|---|---|---|---|---|---|
"""
EFFECTS = "\n## What effects cost"
EFFECT_ROWS: dict[str, dict[str, Any]] = {
    "weight alone": {},
    "a commanded wrench": {"push": {"type": "commanded_wrench", "body": "b4"}},
    "a spring": {
        "spring": {
            "type": "spring",
            "body": "b4",
            "point_A": [0.0, 0.0, 1.0],
            "stiffness": 1.0,
            "rest_length": 0.5,
        }
    },
    "drag of each box": {
        f"drag{i}": {"type": "linear_drag", "body": f"b{i}", "coefficient": 0.1} for i in range(5)
    },
}
COSTS = (
    EFFECTS
    + """
{written}
The stack of 5 boxes at 1 ms with one more effect, in turn with the weight alone: median of
{rounds} rounds of {count} steps, and its ratio to the weight alone.

| effects | CPU a step [us] | ratio |
|---|---|---|
"""
)
ROUNDS = 15
DROPPED = "\n## 216 balls dropped"
FALLS = (
    DROPPED
    + """
{written}
6 x 6 x 6 balls of 0.1 m and 10 kg fall by 1 m on a floor (the sizes of "666" of SimBenchmark);
every two of them may touch; 2 s at 1 ms. Mean CPU time of a step [ms] in each half second, and the
deepest overlap at the end of any of them.

| engine | 0 to 0.5 s | to 1 s | to 1.5 s | to 2 s | overlap [m] | solver |
|---|---|---|---|---|---|---|
"""
)
STACKS = "\n## Stacks for "
STANDS = (
    STACKS
    + """{stand:g} s
{written}
Largest change of a coordinate of a box from its start [m].

| boxes | step [s] | moved | unsolved steps | CPU a simulated second |
|---|---|---|---|---|
"""
)


def measured(engine: Any, mapping: dict[str, Any]) -> str:
    """The cells of one heap in one engine."""
    costs, before, worst = [], engine.poses(), 0.0
    for _ in range(PARTS):
        before, began = engine.poses(), time.process_time()
        engine.run(PART)
        costs.append(1e6 * (time.process_time() - began) / PART)
        worst = max(worst, deepest(mapping, *engine.poses()))
    moved = np.abs(engine.poses()[0] - before[0]).max()
    cells = [f"{costs[0]:.0f}", f"{min(costs[1:]):.0f}", f"{worst:.1e}", f"{moved:.1e}"]
    return " | ".join([*cells, engine.note()])


def fallen(engine: Any, mapping: dict[str, Any]) -> str:
    """The cells of the dropped balls in one engine."""
    cells, worst = [], 0.0
    for _ in range(PARTS):
        began = time.process_time()
        engine.run(PART)
        cells.append(f"{1e3 * (time.process_time() - began) / PART:.2f}")
        worst = max(worst, deepest(mapping, *engine.poses()))
    return " | ".join([*cells, f"{worst:.1e}", engine.note()])


def costs_of_effects() -> dict[str, float]:
    """CPU microseconds of a step of the stack with the effects of each row."""
    engines = {}
    for name, more in EFFECT_ROWS.items():
        mapping = scenes.stack(5)
        mapping["effects"] |= more
        engines[name] = ENGINES["rb_sim"](mapping, STEP)
        engines[name].run(PART)
    found: dict[str, list[float]] = {name: [] for name in engines}
    for _ in range(ROUNDS):
        for name, engine in engines.items():
            began = time.process_time()
            engine.run(PART)
            found[name].append(1e6 * (time.process_time() - began) / PART)
    return {name: float(np.median(costs)) for name, costs in found.items()}


def stood(count: int, step: float, stand: float) -> str:
    """The cells of one stack."""
    engine = ENGINES["rb_sim"](scenes.stack(count), step)
    before, began = engine.poses(), time.process_time()
    engine.run(round(stand / step))
    cost = (time.process_time() - began) / stand
    moved = max(np.abs(a - b).max() for a, b in zip(engine.poses(), before, strict=True))
    return f"{count} | {step:g} | {moved:.1e} | {engine.simulation.unsolved_steps[0]} | {cost:.1e}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.heaps")
    parser.add_argument("--part", choices=PAGE_PARTS, help="left out: all")
    parser.add_argument("--heaps", nargs="*", default=list(HEAPS), choices=list(HEAPS))
    parser.add_argument("--engines", nargs="*", default=list(ENGINES), choices=list(ENGINES))
    parser.add_argument("--stand", type=float, default=100.0, help="s, of each stack")
    parser.add_argument("--steps", nargs="*", type=float, default=STEPS, help="s, of the stacks")
    parser.add_argument("--out", type=Path, default=PAGE)
    options = parser.parse_args()
    here = machine.describe(["numpy", "llvmlite", "mujoco", "drake"])
    versions = ", ".join(f"{name} {version}" for name, version in here["versions"].items())
    written = WRITTEN.format(
        arguments=asked(options), machine=machine.line(here), versions=versions
    )
    before = options.out.read_text() if options.out.exists() else ""
    first, heading, stacks = before.partition(STACKS)
    heaps, name, dropped = first.partition(DROPPED)
    heaps, title, effects = heaps.partition(EFFECTS)
    texts = heaps, title + effects, name + dropped, heading + stacks
    kept = dict(zip(PAGE_PARTS, texts, strict=True))
    asked_for = PAGE_PARTS if options.part is None else (options.part,)
    at = PAGE_PARTS.index(asked_for[0])
    above = "".join(kept[part] for part in PAGE_PARTS[:at])
    below = "".join(kept[part] for part in PAGE_PARTS[at + len(asked_for) :])
    lines: list[str] = []

    def tell(text: str) -> None:
        print(text, end="", flush=True)
        lines.append(text)
        options.out.write_text(above + "".join(lines) + below)

    if "heaps" in asked_for:
        tell(HEAD + TABLE.format(written=written))
        tell_heaps(options.heaps, options.engines, tell)
    if "effects" in asked_for:
        tell(COSTS.format(written=written, rounds=ROUNDS, count=PART))
        costs = costs_of_effects()
        for label, cost in costs.items():
            tell(f"| {label} | {cost:.1f} | {cost / costs['weight alone']:.2f} |\n")
    if "dropped" in asked_for:
        tell(FALLS.format(written=written))
        for label in options.engines:
            mapping = scenes.dropped_balls()
            tell(f"| {label} | {fallen(ENGINES[label](mapping, STEP), mapping)} |\n")
    if "stacks" in asked_for:
        tell(STANDS.format(stand=options.stand, written=written))
        for step in options.steps:
            for count in range(2, 11):
                tell(f"| {stood(count, step, options.stand)} |\n")


def asked(options: argparse.Namespace) -> str:
    """The options of this run, as they were given."""
    part = f" --part {options.part}" if options.part else ""
    if options.engines != list(ENGINES):
        part += f" --engines {' '.join(options.engines)}"
    steps = "" if tuple(options.steps) == STEPS else f" --steps {' '.join(map(str, options.steps))}"
    return part + steps + ("" if options.stand == 100.0 else f" --stand {options.stand:g}")


def tell_heaps(names: list[str], engines: list[str], tell: Callable[[str], None]) -> None:
    """One line for each heap and engine."""
    for name in names:
        for label in engines:
            make = ENGINES[label]
            mapping = HEAPS[name]()
            tell(f"| {name} | {label} | {measured(make(mapping, STEP), mapping)} |\n")


if __name__ == "__main__":
    main()
