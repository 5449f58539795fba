"""Error and CPU time of one engine on one scene, over its methods and their ladders."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import NamedTuple

import numpy as np

from benchmarks.peers.engine import Run, Way
from benchmarks.peers.reference import Reference, pose_error
from benchmarks.peers.scenes import Scene

ENOUGH = 0.3
"""CPU time after which a point is not repeated further [s]."""

REPEATS = (3, 30)
"""Fewest and most timed runs of a point."""

SLOWEST = 4.0
"""A way ends when one of its runs takes longer than this [s]."""

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


def measure(
    scene: Scene, reference: Reference, engine: ModuleType, budget: float
) -> tuple[list[Point], list[str]]:
    """All points within `budget` [s, wall clock], and notes on what failed or was cut.

    The ladders of all methods advance together, coarse to fine, so a short budget cuts the finest.
    """
    points: list[Point] = []
    notes: list[str] = []
    ladders = [_Ladder(way) for way in engine.ways(scene)]
    for ladder in ladders:
        # what an engine compiles once per method is not charged to the budget
        with contextlib.suppress(Exception), silent():
            engine.build(scene, ladder.way.method, ladder.knob)
    end = time.monotonic() + budget
    while any(ladder.open for ladder in ladders):
        for ladder in ladders:
            if not ladder.open:
                continue
            if time.monotonic() + ladder.expected > end:
                notes.append(f"{ladder.way.method}: cut by the budget at {ladder.knob:.0e}")
                ladder.open = False
                continue
            begin = time.monotonic()
            method, knob = ladder.way.method, ladder.knob
            try:
                with silent():
                    point = _point(
                        scene, reference, engine.build(scene, method, knob), method, knob
                    )
            except Exception as problem:  # an engine may fail in any way of its own
                first = str(problem).strip().splitlines() or [type(problem).__name__]
                notes.append(f"{method} {knob:.0e}: {first[0][:100]}")
                ladder.next(math.inf, math.inf, time.monotonic() - begin)
                continue
            points.append(point)
            slow = point.cost * scene.duration > SLOWEST
            ladder.next(point.error, math.inf if slow else 0.0, time.monotonic() - begin)
    return points, notes


class _Ladder:
    """Where a way stands on its ladder, and whether it goes on."""

    def __init__(self, way: Way) -> None:
        self.way, self._index, self.open = way, 0, bool(way.knobs)
        self.expected, self._best, self._worse, self._failed = 0.0, math.inf, 0, 0

    @property
    def knob(self) -> float:
        return self.way.knobs[self._index]

    def next(self, error: float, slow: float, spent: float) -> None:
        """Go to the finer knob, or end."""
        self._worse = self._worse + 1 if error > 2.0 * self._best else 0
        self._failed = self._failed + 1 if slow and error == math.inf else 0
        self._best = min(self._best, error)
        self._index += 1
        done = self._index == len(self.way.knobs) or (slow and error < math.inf)
        if done or self._failed > 4 or (self._best < ROUND_OFF and self._worse > 1):
            self.open = False
            return
        coarser, finer = self.way.knobs[self._index - 1 : self._index + 1]
        # a step costs as its inverse; a tolerance at most doubles the cost
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
