# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""python -m benchmarks.peers.limit [--scenes ...] [--methods ...] [--rounds N]: beside heyoka.

rb_sim's adaptive methods and heyoka's compiled Taylor method on hand-written equations, in one
process and in turns, so that what else the machine does meets both.  For each decade of error:
the CPU time per simulated second of the cheapest way of each (the least of its turns), and
rb_sim's over heyoka's.
"""

from __future__ import annotations

import argparse

from benchmarks import machine
from benchmarks.peers import engine_heyoka, engine_rb_sim, scenes
from benchmarks.peers.engine import Run
from benchmarks.peers.measure import Point, silent
from benchmarks.peers.reference import Reference, pose_error
from benchmarks.peers.report import DECADES, cheapest
from benchmarks.peers.turns import turn

LADDER = tuple(10.0 ** (-0.25 * n) for n in range(4, 63))
"""Tolerances."""


class _Way:
    """A built run, its error, and the least time seen."""

    def __init__(self, scene: scenes.Scene, reference: Reference, method: str, knob: float) -> None:
        adapter = engine_heyoka if method.startswith("Taylor/") else engine_rb_sim
        self._scene, self.run = scene, adapter.build(scene, method, knob)
        samples = self.run.samples(scene.times)
        exact = reference.pose(samples.t)
        error = float(pose_error(samples.position, samples.quaternion, *exact).max())
        self.point = Point(method, knob, error, self._timed(self.run), 1)

    def again(self) -> None:
        """Time it once more."""
        cost = min(self.point.cost, self._timed(self.run))
        self.point = self.point._replace(cost=cost, runs=self.point.runs + 1)

    def _timed(self, run: Run) -> float:
        duration = self._scene.duration
        return turn(run.start, lambda: run.advance(duration)) / duration


def measure(name: str, methods: list[str], rounds: int) -> dict[str, list[dict[str, object]]]:
    """The points of rb_sim and of heyoka."""
    scene = scenes.load(name)
    reference = Reference(scene)
    made: dict[str, list[_Way]] = {"rb_sim": [], "heyoka": []}
    theirs = [way.method for way in engine_heyoka.ways(scene)]
    for who, ways in (("rb_sim", [f"{m}/tolerance" for m in methods]), ("heyoka", theirs)):
        for method in ways:
            for knob in LADDER:
                with silent():
                    made[who].append(_Way(scene, reference, method, knob))
    for _ in range(rounds):
        for way in [*made["rb_sim"], *made["heyoka"]]:
            way.again()
    return {who: [way.point._asdict() for way in ways] for who, ways in made.items()}


def table(name: str, points: dict[str, list[dict[str, object]]]) -> str:
    """One line per decade."""
    lines = [f"{name}", "error     rb_sim   heyoka  ratio  by"]
    for decade in DECADES:
        own, limit = (cheapest(points[who], 10.0**-decade) for who in ("rb_sim", "heyoka"))
        cells = [f"{p['cost']:.2e}" if p else "       -" for p in (own, limit)]
        ratio = f"{own['cost'] / limit['cost']:5.2f}" if own and limit else "    -"
        by = f"{own['method']} {own['knob']:.0e}" if own else ""
        against = f"{limit['method']} {limit['knob']:.0e}" if limit else ""
        lines.append(f"1e-{decade:02d}  {cells[0]} {cells[1]}  {ratio}  {by} | {against}")
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.limit", description=__doc__)
    parser.add_argument("--scenes", nargs="+", choices=scenes.NAMES, default=scenes.NAMES)
    parser.add_argument("--methods", nargs="+", default=["taylor"])
    parser.add_argument("--rounds", type=int, default=10)
    options = parser.parse_args()
    print(machine.line(machine.describe()), flush=True)
    for name in options.scenes:
        print("\n" + table(name, measure(name, options.methods, options.rounds)), flush=True)


if __name__ == "__main__":
    main()
