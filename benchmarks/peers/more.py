# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""python -m benchmarks.peers.more [--scenes ...] [--methods ...] [--rounds N]: three more scenes.

A rolling ellipsoid, a double pendulum and a four-bar linkage (`more_scenes`): rb_sim beside
heyoka's compiled Taylor method on minimal equations.  The reference is heyoka's method in long
doubles on these equations, which share nothing with rb_sim's.  Printed are, for each decade of the
pose's error, the least CPU time per simulated second of both and their ratio, and how far rb_sim's
reactions are off at its tightest tolerance, relative to the largest.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple

import heyoka
import numpy as np

from benchmarks import machine
from benchmarks.peers.more_scenes import MORE, Functions, More
from benchmarks.peers.reference import pose_error
from benchmarks.peers.report import DECADES, cheapest
from benchmarks.peers.scenes import Array
from benchmarks.peers.turns import turn
from rb_sim import Simulation, load_scene

SYMBOLS = Functions(heyoka.sin, heyoka.cos, heyoka.sqrt)
LADDER = tuple(10.0 ** (-n) for n in range(2, 15))


class Truth(NamedTuple):
    """Along the run: poses (n, bodies, 7) and forces (n, joints, 3)."""

    poses: Array
    forces: Array


class Equations:
    """The minimal equations of a scene as heyoka takes them."""

    def __init__(self, more: More) -> None:
        self.more = more
        self.variables = heyoka.make_vars(*[f"y{i}" for i in range(len(more.start(float)))])
        rates = more.rates(self.variables, SYMBOLS)
        self.system = list(zip(self.variables, rates, strict=True))
        poses = more.poses(self.variables, SYMBOLS)
        forces = more.forces(self.variables, rates, SYMBOLS)
        self.bodies, self.joints = len(poses), len(forces)
        flat = [heyoka.expression(0.0) + x for row in (*poses, *forces) for x in row]
        self._pose = {
            kind: heyoka.cfunc(flat, vars=self.variables, fp_type=kind, compact_mode=True)
            for kind in (float, np.longdouble)
        }

    def integrator(self, tolerance: float, kind: Any = float) -> Any:
        start = np.array(self.more.start(kind), dtype=kind)
        compact = kind is not float or self.more.compact
        return heyoka.taylor_adaptive(
            self.system, start, tol=kind(tolerance), fp_type=kind, compact_mode=compact
        )

    def along(self, integrator: Any, times: Array, kind: Any = float) -> Truth:
        """The run at these times."""
        states = integrator.propagate_grid(np.array(times, dtype=kind))[-1]
        rows = np.array(self._pose[kind](np.ascontiguousarray(states.T)).T, dtype=float)
        poses = rows[:, : 7 * self.bodies].reshape(-1, self.bodies, 7)
        return Truth(poses, rows[:, 7 * self.bodies :].reshape(-1, self.joints, 3))


def worst(poses: Array, truth: Truth) -> float:
    """The largest pose error of any body at any time [rad, m]."""
    exact = truth.poses
    return max(
        float(pose_error(poses[:, i, :3], poses[:, i, 3:], exact[:, i, :3], exact[:, i, 3:]).max())
        for i in range(exact.shape[1])
    )


def sampled(more: More, method: str, tolerance: float, rate: float) -> tuple[Array, Array]:
    """rb_sim's poses, and the forces of the joints."""
    scene = load_scene(more.scene, method=method, tolerance=tolerance, rate=rate)
    block = Simulation(scene).run().block
    names = list(Simulation(scene).layout.reactions)
    forces = [block.reaction_force[:, names.index(joint)] for joint in more.joints]
    return np.concatenate([block.position, block.orientation], axis=2), np.stack(forces, axis=1)


def force_error(more: More, forces: Array, truth: Truth) -> float:
    """The largest over the run, relative to the largest force."""
    gap = forces - truth.forces
    if more.planar:
        gap = gap[:, :, [0, 2]]
    return float(np.abs(gap).max() / np.abs(truth.forces).max())


class Way:
    """One program with one tolerance: its error, and the least time seen [s per second]."""

    def __init__(self, knob: float, error: float, start: Callable[[], None], go: Callable[[], Any]):
        self.knob, self.error, self._start, self._go = knob, error, start, go
        self.cost = float("inf")

    def again(self, duration: float) -> None:
        """Time it once more."""
        self.cost = min(self.cost, turn(self._start, self._go) / duration)


def ours(more: More, method: str, tolerance: float, truth: Truth, rate: float) -> Way:
    poses, _ = sampled(more, method, tolerance, rate)
    simulation = Simulation(load_scene(more.scene, method=method, tolerance=tolerance))
    duration = more.scene["simulation"]["duration"]
    return Way(
        tolerance, worst(poses, truth), simulation.reset, lambda: simulation.advance(duration)
    )


def theirs(equations: Equations, tolerance: float, truth: Truth, times: Array) -> Way:
    integrator = equations.integrator(tolerance)
    error = worst(equations.along(integrator, times).poses, truth)

    def start() -> None:
        integrator.time = 0.0
        integrator.state[:] = equations.more.start(float)

    return Way(tolerance, error, start, lambda: integrator.propagate_until(times[-1]))


def measure(name: str, methods: list[str], rounds: int) -> str:
    """The table of one scene."""
    more = MORE[name]()
    duration, rate = more.scene["simulation"]["duration"], more.scene["simulation"]["rate"]
    times = np.arange(round(duration * rate) + 1) / rate
    equations = Equations(more)
    long = equations.integrator(1e-19, np.longdouble)
    truth = equations.along(long, times, np.longdouble)
    again = equations.along(equations.integrator(1e-17, np.longdouble), times, np.longdouble)
    ways = {f"rb_sim {m}": [ours(more, m, k, truth, rate) for k in LADDER] for m in methods}
    ways["heyoka"] = [theirs(equations, k, truth, times) for k in LADDER]
    for _ in range(rounds):
        for way in (way for column in ways.values() for way in column):
            way.again(duration)
    lines = [
        name,
        "error     " + "  ".join(f"{who:>16s}" for who in ways) + "  least rb_sim/heyoka",
    ]
    points = {who: [vars(way) for way in column] for who, column in ways.items()}
    for decade in DECADES:
        best = {who: cheapest(column, 10.0**-decade) for who, column in points.items()}
        cells = [f"{p['cost']:16.2e}" if p else f"{'-':>16s}" for p in best.values()]
        own = [p["cost"] for who, p in best.items() if p and who != "heyoka"]
        limit = best["heyoka"]
        ratio = f"{min(own) / limit['cost']:.2f}" if own and limit else "-"
        lines.append(f"1e-{decade:02d}     " + "  ".join(cells) + f"  {ratio}")
    reached = {who: min(p["error"] for p in column) for who, column in points.items()}
    lines.append("best error: " + ", ".join(f"{who} {e:.0e}" for who, e in reached.items()))
    lines.append(f"reference with another tolerance: {worst(again.poses, truth):.0e}")
    for method in methods:
        _, forces = sampled(more, method, 1e-13, rate)
        lines.append(f"reactions of {method} at 1e-13: {force_error(more, forces, truth):.0e}")
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.more", description=__doc__)
    parser.add_argument("--scenes", nargs="+", choices=list(MORE), default=list(MORE))
    parser.add_argument("--methods", nargs="+", default=["taylor", "dopri853"])
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    print(machine.line(machine.describe()), flush=True)
    with machine.alone():
        for name in options.scenes:
            print("\n" + measure(name, options.methods, options.rounds), flush=True)


if __name__ == "__main__":
    main()
