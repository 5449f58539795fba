# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Error and CPU time of one engine on one scene, over its methods and their ladders.

`python -m benchmarks.peers.measure SCENE ENGINE BUDGET` is the process that `in_child` starts: an
engine that crashes or never returns then loses only what it had not yet reported. It prints one
JSON object per line.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import NamedTuple

import numpy as np

from benchmarks.peers.engine import Run, Way
from benchmarks.peers.reference import Reference, pose_error
from benchmarks.peers.scenes import Scene, load

ENOUGH = 0.3
"""CPU time after which a point is not repeated further [s]."""

REPEATS = (3, 30)
"""Fewest and most timed runs of a point."""

SLOWEST = 2.0
"""A way ends when one of its runs takes longer than this [s, CPU time]."""

ROUND_OFF = 1e-9
"""Below this error a way ends once finer knobs make it worse twice."""


class Point(NamedTuple):
    """One method with one step or tolerance."""

    method: str
    knob: float
    error: float
    """largest over the run of max(rotation [rad], distance of the centre of mass [m])."""
    cost: float
    """CPU seconds per simulated second, stepping only, least of the runs."""
    runs: int


GRACE = 120.0
"""Wall-clock time that a child has beside its budget, for start and compilation [s]."""

PATIENCE = 5.0
"""Wall-clock time per CPU time of the budget after which a child counts as hung."""


def in_child(scene: str, engine: str, budget: float) -> tuple[list[Point], list[str]]:
    """All points of an engine on a scene, measured in a process of its own; and notes."""
    command = [sys.executable, "-m", "benchmarks.peers.measure", scene, engine, str(budget)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    limit = PATIENCE * budget + GRACE
    timer = threading.Timer(limit, child.kill)
    timer.start()
    points: list[Point] = []
    notes: list[str] = []
    trying = "the start"
    begin = time.monotonic()
    for row in map(json.loads, child.stdout or ()):
        if "point" in row:
            points.append(Point(*row["point"]))
        elif "note" in row:
            notes.append(row["note"])
        else:
            trying = row["trying"]
    timer.cancel()
    if child.wait() != 0:
        late = time.monotonic() - begin >= limit
        ended = f"stopped after {limit:.0f} s" if late else f"crashed (exit {child.returncode})"
        notes.append(f"{trying}: {ended}")
    return points, notes


def measure(
    scene: Scene,
    reference: Reference,
    engine: ModuleType,
    budget: float,
    report: Callable[[str, object], None],
) -> None:
    """Measure all ways within `budget` [s, CPU time of this process].

    report: called with "trying" and a text, "point" and a Point, "note" and a text.
    The ladders of all methods advance together, coarse to fine, so a short budget cuts the finest.
    """
    ladders = [_Ladder(way) for way in engine.ways(scene)]
    for ladder in ladders:
        # what an engine compiles once per method is not charged to the budget
        report("trying", f"building {ladder.way.method}")
        with contextlib.suppress(Exception), silent():
            engine.build(scene, ladder.way.method, ladder.knob)
    end = time.process_time() + budget
    while any(ladder.open for ladder in ladders):
        for ladder in [ladder for ladder in ladders if ladder.open]:
            method, knob = ladder.way.method, ladder.knob
            begin = time.process_time()
            if begin + ladder.expected > end:
                report("note", f"{method}: not run from {knob:.0e}")
                ladder.open = False
                continue
            report("trying", f"{method} {knob:.0e}")
            try:
                with silent():
                    run = engine.build(scene, method, knob)
                    point = _point(scene, reference, run, method, knob)
            except Exception as problem:  # an engine may fail in any way of its own
                first = str(problem).strip().splitlines() or [type(problem).__name__]
                report("note", f"{method} {knob:.0e}: {first[0][:100]}")
                ladder.failed(time.process_time() - begin)
                continue
            report("point", point)
            ladder.measured(point, scene.duration, time.process_time() - begin)


class _Ladder:
    """Where a way stands on its ladder, and whether it goes on."""

    def __init__(self, way: Way) -> None:
        self.way, self._index, self.open = way, 0, bool(way.knobs)
        self.expected, self._best, self._worse, self._failures = 0.0, math.inf, 0, 0

    @property
    def knob(self) -> float:
        """Step or tolerance to be tried."""
        return self.way.knobs[self._index]

    def failed(self, spent: float) -> None:
        """The engine gave an error: coarse knobs may, but not many."""
        self._failures += 1
        self._finer(spent, end=self._failures > 4)

    def measured(self, point: Point, duration: float, spent: float) -> None:
        """Go to the finer knob, unless runs are slow by now or round-off has taken over."""
        self._worse = self._worse + 1 if point.error > 2.0 * self._best else 0
        self._best = min(self._best, point.error)
        rounding = self._best < ROUND_OFF and self._worse > 1
        self._finer(spent, end=rounding or point.cost * duration > SLOWEST)

    def _finer(self, spent: float, end: bool) -> None:
        self._index += 1
        if end or self._index == len(self.way.knobs):
            self.open = False
            return
        coarser, finer = self.way.knobs[self._index - 1 : self._index + 1]
        # a step costs as its inverse; a decade of tolerance seldom doubles the cost
        self.expected = spent * min(coarser / finer, 2.5)


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Drop what the engines print, also from compiled code: some warn at every step."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for descriptor, original in zip(kept, (1, 2), strict=True):
                os.dup2(descriptor, original)
                os.close(descriptor)


def _point(scene: Scene, reference: Reference, run: Run, method: str, knob: float) -> Point:
    samples = run.samples(scene.times)
    error = _error(reference, samples.t, samples.position, samples.quaternion)
    cost, count = _least(run.start, lambda: run.advance(scene.duration))
    # the timed run is not sampled: its end must be as right as the sampled run
    position, quaternion = run.pose()
    end = _error(reference, np.array([scene.duration]), position[None], quaternion[None])
    return Point(method, knob, max(error, end), cost / scene.duration, count)


def _error(reference: Reference, t, position, quaternion) -> float:
    with np.errstate(all="ignore"):
        return float(np.max(pose_error(position, quaternion, *reference.pose(t))))


def _least(start: Callable[[], None], go: Callable[[], None]) -> tuple[float, int]:
    """Least CPU time of several runs [s], and how many there were."""
    least, spent, count = math.inf, 0.0, 0
    while count < REPEATS[0] or (count < REPEATS[1] and spent < ENOUGH):
        start()
        begin = time.process_time()
        go()
        took = time.process_time() - begin
        least, spent, count = min(least, took), spent + took, count + 1
        if spent > SLOWEST:
            break
    return least, count


def main() -> None:
    """Measure one engine on one scene and report in lines of JSON."""
    name, engine, budget = sys.argv[1:]
    scene = load(name)
    with silent():
        adapter = importlib.import_module(f"benchmarks.peers.engine_{engine}")

    def report(kind: str, value: object) -> None:
        print(json.dumps({kind: value}), flush=True)

    measure(scene, Reference(scene), adapter, float(budget), report)


if __name__ == "__main__":
    main()
