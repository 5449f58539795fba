# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contact problems of whole runs beside Clarabel: `python -m benchmarks.contact.problems`.

Every problem that random scenes, tosses and heaps ask is taken as it is solved: of time stepping
the friction problem of each step, of events those between velocities and impulses and between
accelerations and forces.  Told is what the laws leave of a solution, by formulas that are written
here alone; and how far its velocities are from those of the convex program that has them as its
solution once slips are known (Acary, Cadoux, Lemarechal, Malick 2011), which Clarabel solves.  A
problem in which a push pulls its own contact down (friction at accelerations) is no such program.
"""

from __future__ import annotations

import argparse
import math
import warnings
from typing import Any, NamedTuple

import numpy as np

from benchmarks.contact.random_scenes import random_scene
from benchmarks.contact.toss_scenes import toss
from benchmarks.heaps import scenes

Array = Any
HEAPS = (scenes.piled_balls, scenes.pyramid, scenes.balls_in_bin, scenes.dominoes)
SYMMETRIC = 1e-12
"""Part of the largest element by which the matrix of a convex program may be no symmetric one."""
DONE = ("Solved", "AlmostSolved")
SHARES = (50, 90, 99, 100)
"""Percentiles that are told."""


class Problem(NamedTuple):
    """w = A x + b of n lines, with their laws and what the program found."""

    kind: str
    A: Array
    b: Array
    holds: Array
    """lines with w = 0 and any x, (n,) of bool."""
    pushes: Array
    """lines with x >= least, w >= 0, one of them zero, (n,) of bool."""
    least: Array
    bounds: list[tuple[list[int], int, float]]
    """rows of friction, row of their normal force (-1: none), coefficient (inf: none slips with a
    normal force), or the bound without a normal force."""
    x: Array


def left_of(p: Problem) -> float:
    """What the laws leave of the solution: the natural map of each line or pair of lines, over the
    largest x or what would stop the largest velocity; each line in units of its own element."""
    own = np.maximum(np.abs(np.diag(p.A)), 1e-12 * np.abs(np.diag(p.A)).max())
    w, left = p.A @ p.x + p.b, np.zeros(len(p.x))
    left[p.holds] = (w / own)[p.holds]
    ahead = p.x - p.least - w / own
    left[p.pushes] = (p.x - p.least - np.maximum(ahead, 0.0))[p.pushes]
    for lines, push, coefficient in p.bounds:
        size = own[lines].max()
        free = p.x[lines] - w[lines] / size
        none = push >= 0 and p.x[push] == 0.0 and not p.holds[push]
        most = 0.0 if none else coefficient * (abs(p.x[push]) if push >= 0 else 1.0)
        length = float(np.linalg.norm(free))
        left[lines] = p.x[lines] - (free if length <= most else most / length * free)
    root = np.sqrt(own)
    scale = max(np.abs(root * p.x).max(), np.abs(p.b / root).max(), 1e-300)
    return float(np.abs(root * left).max() / scale)


def apart_from_clarabel(p: Problem) -> float | None:
    """Largest difference of A x, over the largest b, in units of each line's own element; None
    where the problem is no convex program, or Clarabel does not solve it."""
    import clarabel
    from scipy import sparse

    solver: Any = clarabel  # compiled, without types

    n, w = len(p.x), p.A @ p.x + p.b
    own = np.sqrt(np.maximum(np.diag(p.A), 1e-12 * np.abs(p.A).max()))
    even = np.abs(p.A - p.A.T).max() <= SYMMETRIC * np.abs(p.A).max()
    if not even or any(push < 0 or p.holds[push] or math.isinf(c) for _, push, c in p.bounds):
        return None
    A, b = p.A / np.outer(own, own), p.b / own
    linear, rows, least, cones = b.copy(), [], [], []
    bound_of = {push: [of for of in p.bounds if of[1] == push] for push in np.flatnonzero(p.pushes)}
    for push, own_bounds in bound_of.items():
        for lines, _, c in own_bounds:
            linear[push] += c * float(np.linalg.norm(w[lines])) / own[push]
            scale = np.zeros((1 + len(lines), n))
            scale[0, push] = -c / own[push]
            for j, line in enumerate(lines):
                scale[1 + j, line] = -1.0 / own[line]
            rows.append(scale)
            least.append(np.zeros(1 + len(lines)))
            cones.append(solver.SecondOrderConeT(1 + len(lines)))
        row = np.zeros((1, n))
        row[0, push] = -1.0 / own[push]
        rows.append(row)
        least.append(-p.least[[push]])
        cones.append(solver.NonnegativeConeT(1))
    settings = solver.DefaultSettings()
    settings.verbose = False
    size = float(np.abs(b).max()) or 1.0
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    if not rows:
        return None
    found = solver.DefaultSolver(
        sparse.csc_matrix(np.triu(A)), linear / size, sparse.csc_matrix(np.vstack(rows)),
        np.concatenate(least) / size, cones, settings,
    ).solve()  # fmt: skip
    if str(found.status) not in DONE:
        return None
    return float(np.abs(A @ (size * np.array(found.x)) - A @ (own * p.x)).max() / size)


def of_steps(mapping: dict[str, Any], steps: int) -> list[Problem]:
    """The friction problem of each of so many steps."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.gauss_seidel import is_plain
    from rb_sim.contact.problem import CONTACT_ROWS
    from rb_sim.contact.stepping.constraint_rows import graph_of
    from rb_sim.contact.stepping.step_workspace import ACTIVE
    from tests.contact.problems import dense

    simulation, out = Simulation(load_scene(mapping)), []
    for _ in range(steps):
        simulation.advance(mapping["simulation"]["step"])
        motion: Any = simulation._motion  # of time stepping
        work = motion._workspace
        n = int(work.notes[ACTIVE])
        graph = graph_of(motion._tables, work, n)
        x = work.x[: CONTACT_ROWS * n].reshape(n, CONTACT_ROWS)[:, :3]
        reported = np.linalg.norm(motion._memory[work.active[:n], :3], axis=1)
        # what has been moved apart after the step is in place of the problem
        there = np.allclose(np.linalg.norm(x, axis=1), reported, rtol=1e-12, atol=0.0)
        if n == 0 or not there or not is_plain(graph):
            continue
        W, q, mu, r = dense(graph, work.u, work.x[: CONTACT_ROWS * n])
        for i in range(n):  # what a support gives by its own
            W[3 * i, 3 * i] += graph.rules[i, 1]
        pushes = np.arange(3 * n) % 3 == 0
        slips = [([3 * i + 1, 3 * i + 2], 3 * i, float(mu[i])) for i in range(n)]
        none = np.zeros(3 * n)
        out.append(Problem("step", W, q, pushes & False, pushes, none, slips, r))
    return out


def of_events(mapping: dict[str, Any]) -> list[Problem]:
    """All problems at the events of a run."""
    from rb_sim import Simulation, load_scene
    from rb_sim.base.errors import RbSimError
    from rb_sim.contact import assembly, impacts, modes
    from rb_sim.contact.events import event_motion
    from rb_sim.numerics.complementarity import CONTRADICTION, EQUALITY, UNILATERAL, solve

    out: list[Problem] = []
    kinds = {modes: "accelerations", impacts: "impact", assembly: "short step"}
    kept, tasks = assembly.solve_in, event_motion.Tasks

    def keeper(kind: str) -> Any:
        def solve_in(work: Any, n: int, m: int, A: Array, b: Array, terms: Array, x: Array) -> int:
            rules, least, limits = work.rules[:n].copy(), work.least[:n].copy(), work.limits[:m]
            bounds = work.bounds[:m].copy()
            left = solve(A, b, terms, rules, least, bounds, limits.copy(), x)
            if math.isnan(left):
                return assembly.NOT_FINITE
            if left > CONTRADICTION:
                return assembly.UNSOLVED
            of = [
                ([int(k) for k in line[:2] if k >= 0], int(line[2]), float(c))
                for line, c in zip(bounds, limits, strict=True)
            ]
            laws = rules == EQUALITY, rules == UNILATERAL, least
            if n > 0:  # else nothing rests on anything
                out.append(Problem(kind, A.copy(), b.copy(), *laws, of, x.copy()))
            return assembly.SOLVED

        return solve_in

    try:
        for module, kind in kinds.items():
            module.solve_in = keeper(kind)  # type: ignore[attr-defined]
        event_motion.Tasks = lambda system, packed, work: tasks(system, None, work)  # type: ignore
        Simulation(load_scene(mapping)).run()
    except RbSimError:  # what is refused has been asked until then
        pass
    finally:
        event_motion.Tasks = tasks  # type: ignore[misc]
        for module in kinds:
            module.solve_in = kept  # type: ignore[attr-defined]
    return out


def problems(seed: int, count: int) -> list[Problem]:
    """So many problems: heaps, then scenes of both kinds by turns."""
    out: list[Problem] = []
    for heap in HEAPS:
        out += of_steps(heap(), min(400, count // 8))
    for number in range(count):
        if len(out) >= count:
            break
        mapping = random_scene(seed, number).mapping
        own = mapping["simulation"]
        if own.get("method") == "time_stepping":
            out += of_steps(mapping, round(own["duration"] / own["step"]))
        else:
            out += of_events(mapping)
        out += of_events(toss(seed, number).mapping)
    return out[:count]


def row(of: list[float]) -> str:
    """Percentiles."""
    return " | ".join(f"{value:.1e}" for value in np.percentile(of, SHARES)) if of else "| | |"


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=5000)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    found = problems(options.seed, options.count)
    shares = " | ".join(f"{share} %" for share in SHARES)
    print(f"| problems | | number | {shares} |\n|---|---|---|{'---|' * len(SHARES)}")
    for kind in dict.fromkeys(p.kind for p in found):
        own = [p for p in found if p.kind == kind]
        print(f"| {kind} | left of the laws | {len(own)} | {row([left_of(p) for p in own])} |")
        beside = [apart for p in own if (apart := apart_from_clarabel(p)) is not None]
        print(f"| {kind} | beside Clarabel | {len(beside)} | {row(beside)} |", flush=True)


if __name__ == "__main__":
    main()
