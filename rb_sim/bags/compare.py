# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Comparison of two motions: differences, time of divergence, and growth rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rb_sim.bags.alignment import (
    FEW,
    TOGETHER,
    Clocks,
    Interpolated,
    angle_between,
    clocks_for,
    moved,
    overlap,
    wanted_at_ends,
)
from rb_sim.bags.tracks import UNITS, Track, Tracks, Wrenches, floors
from rb_sim.base.errors import RbSimError

# Detects a motion that is not in metres: it is a scaled copy of the other one.


ENLARGEMENTS = {100.0: "cm", 1000.0: "mm"}
NEAR = 0.5
"""Maximum RMS residual, relative to the larger motion, after scaling the smaller one as fits best,
by a factor within a power of two of a unit's: two models of one machine differ by less."""


def unit_note(a: np.ndarray, b: np.ndarray, names: tuple[str, str] = ("A", "B")) -> str:
    """A line if positions b are 100 or 1000 times positions a (or the reverse), about their means;
    else "". Shapes (n, 3); names: those of a and b in the line."""
    both = [(name, x - x.mean(axis=0)) for name, x in zip(names, (a, b), strict=True)]
    for (one, small), (two, large) in (both, both[::-1]):
        square = np.vdot(small, small)
        best = np.vdot(small, large) / square if square > 0.0 else 0.0
        for factor, unit in ENLARGEMENTS.items():
            near = NEAR < best / factor < 1.0 / NEAR
            if near and np.linalg.norm(large - best * small) < NEAR * np.linalg.norm(large):
                times = f"about {factor:.0f} times those of {one}"
                return f"the positions of {two} are {times}: is {two} in {unit}?"
    return ""


DIVERGED = 1e-3
"""Relative difference that counts as divergence without a bound, if above rounding (`floors`)."""
CALENDAR = 1e6
"""[s]: start times beyond it count from an epoch."""
SUSPECT = 0.1
"""Fraction of a difference that interpolation may cause before a note says so."""
SURELY = 1.5
"""Safety factor on the interpolation error, which is a third too low at 2 rad per sample."""
GROWING = 10
"""Minimum number of samples for a growth rate."""


@dataclass
class Differences:
    """Differences between A and B at the times of A."""

    clocks: Clocks
    """the offset and drift applied."""
    align: str
    """how they were found: one of ALIGN."""
    t: dict[str, np.ndarray]
    """times of each body or reaction [s], on A's clock."""
    series: dict[str, dict[str, np.ndarray]]
    """by body or reaction, by quantity as in UNITS: magnitude of the difference at each time."""
    scales: dict[str, dict[str, float]]
    """largest magnitude of the quantity in A."""
    floors: dict[str, float]
    """by quantity: differences below are rounding."""
    pairs: dict[str, str]
    """name in A: name in B."""
    left_out: dict[str, int] = field(default_factory=dict)
    """by body or reaction: number of instants of A at which B has a gap."""
    uncertainties: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """as `series`: estimated interpolation error of B."""
    units: dict[str, str] = field(default_factory=dict)
    """by body: a line if A or B seems to be in other units than metres."""
    unaligned: tuple[Differences, ...] = ()
    """the differences with the best offsets at either end, if an offset was estimated and these
    differ by more than clocks drift: a bound must hold with them too."""
    shared: float = 1.0
    """fraction of the motion (the larger of A's and B's) that overlaps after an estimated
    offset."""

    guessed: tuple[str, ...] = ()
    """bodies of a scene compared with one of another name, because each side has only one."""

    @property
    def notes(self) -> list[str]:
        """Lines on what was not compared, or is uncertain."""
        lines = [
            f"{name}: compared with {self.pairs[name]}, the only body of B; if that is another "
            "body, B is the wrong recording or scene"
            for name in self.guessed
        ]
        lines += [
            f"{name}: {count} samples skipped (gap, impact or reset in B)"
            for name, count in self.left_out.items()
        ]
        lines += [f"{name}: {line}" for name, line in self.units.items()]
        if self.unaligned:
            first, last = (shown_offset(other.clocks.offset) for other in self.unaligned)
            lines.append(f"the best offset is {first} at the start and {last} at the end: more "
                         "than clocks drift, so the motions differ; bounds are checked with both "
                         "offsets as well")  # fmt: skip
        for name, uncertainties in self.uncertainties.items():
            uncertain = [
                f"{uncertainty.max():.2g} {UNITS[quantity]} of {quantity}"
                for quantity, uncertainty in uncertainties.items()
                if uncertainty.max() > max(self._matters(name, quantity), self.floors[quantity])
            ]
            if uncertain:
                lines.append(f"{name}: interpolation between the samples of B causes differences "
                             f"up to {', '.join(uncertain)}")  # fmt: skip
        return lines

    def _matters(self, name: str, quantity: str) -> float:
        """Interpolation error above which a note names it."""
        largest = float(self.series[name][quantity].max())
        return max(SUSPECT * largest, DIVERGED * self.scales[name][quantity])

    @property
    def start(self) -> float:
        """Origin of displayed times [s]: 0, or the first time if it counts from an epoch, whose
        leading digits would hide the differences between samples."""
        first = min(float(t[0]) for t in self.t.values())
        return first if abs(first) > CALENDAR else 0.0


def differences(
    a: Tracks, b: Tracks, *, align: str | None = None, match: Mapping[str, str] | None = None
) -> Differences:
    """Compare B with A.

    align: one of ALIGN; None: "none" if the times overlap, else "offset". match: name in A to name
    in B. Raises RbSimError if they have no body or no time in common.
    """
    pairs = _pairs(a, b, dict(match or {}))
    first, second = next(iter(pairs.items()))
    if align is None:
        together = overlap(a.bodies[first], b.bodies[second], Clocks()).mean() > TOGETHER
        align = "none" if together else "offset"
    clocks = clocks_for(align, a.bodies[first], b.bodies[second])
    result = _with_clocks(a, b, clocks, align, pairs)
    if not match and a.length and b.length:  # between scenes; names in recordings are arbitrary
        result.guessed = tuple(name for name, other in pairs.items() if name != other)
    if align in ("offset", "clock"):
        one, two = a.bodies[first], b.bodies[second]
        result.shared = max(
            moved(one, overlap(one, two, clocks)), moved(two, overlap(two, one, clocks.back))
        )
        result.unaligned = tuple(
            _with_clocks(a, b, other, align, pairs) for other in wanted_at_ends(one, two)
        )
    return result


def _with_clocks(
    a: Tracks, b: Tracks, clocks: Clocks, align: str, pairs: dict[str, str]
) -> Differences:
    result = Differences(clocks, align, {}, {}, {}, floors(a, b), pairs)
    for name, other in pairs.items():
        _add_body(result, name, a.bodies[name], b.bodies[other])
    for name in a.reactions:
        if name in b.reactions:
            _add_reaction(result, name, a.reactions[name], b.reactions[name])
    if not result.series:
        raise RbSimError(f"{a.name} and {b.name}: their times do not overlap")
    return result


def _pairs(a: Tracks, b: Tracks, match: dict[str, str]) -> dict[str, str]:
    for name, other in match.items():
        if name not in a.bodies or other not in b.bodies:
            raise RbSimError(
                f"--match {name}={other}: the first must be one of {', '.join(a.bodies)}, "
                f"the second one of {', '.join(b.bodies)}"
            )
    pairs = match or {name: name for name in a.bodies if name in b.bodies} or _named(a, b)
    if not pairs:
        raise RbSimError(
            f"no body is in both: {a.name} has {', '.join(a.bodies)}; {b.name} has "
            f"{', '.join(b.bodies)}; use --match NAME_IN_A=NAME_IN_B"
        )
    return pairs


def _named(a: Tracks, b: Tracks) -> dict[str, str]:
    """Name in A to name in B, by the body that the other side's topic or frame names, or if each
    has only one body."""
    pairs = {name: body for body, name in a.pairs_for(b.bodies)[0].items()}
    return pairs or b.pairs_for(a.bodies)[0]


def _add_body(result: Differences, name: str, a: Track, b: Track) -> None:
    rates = {
        "velocity": (a.linear_velocity, b.linear_velocity),
        "spin": (a.angular_velocity, b.angular_velocity),
    }
    _add(result, name, a, b, rates, posed=True)


def _add_reaction(result: Differences, name: str, a: Wrenches, b: Wrenches) -> None:
    if len(b.t) < FEW:
        return
    one, two = (
        Track(w.t, w.values[:, :3], np.tile([0.0, 0.0, 0.0, 1.0], (len(w.t), 1)), anew=w.anew)
        for w in (a, b)
    )
    parts = {"force": slice(3), "torque": slice(3, 6)}
    vectors = {each: (a.values[:, part], b.values[:, part]) for each, part in parts.items()}
    _add(result, f"reaction {name}", one, two, vectors, posed=False)


def _add(
    result: Differences,
    key: str,
    a: Track,
    b: Track,
    vectors: Mapping[str, tuple[np.ndarray | None, np.ndarray | None]],
    *,
    posed: bool,
) -> None:
    """Add the differences of vectors (n, 3) of A and B, and of the poses if the tracks have any."""
    other = Interpolated(b)
    within = _known(result, key, a, other)
    if not within.any():
        return
    t = np.clip(result.clocks.of(a.t[within]), b.t[0], b.t[-1])
    series: dict[str, np.ndarray] = {}
    scales: dict[str, float] = {}
    uncertainties: dict[str, np.ndarray] = {}
    if posed:
        (position, orientation), p = other.at(t), a.position[within]
        if line := unit_note(p, position):
            result.units[key] = line
        series["position"] = np.linalg.norm(position - p, axis=1)
        series["angle"] = angle_between(orientation, a.orientation[within])
        scales = {"position": float(np.ptp(p, axis=0).max()), "angle": 1.0}
        of_pose = other.uncertainty(t)
        uncertainties = {"position": of_pose[0], "angle": of_pose[1]}
    for quantity, (one, two) in vectors.items():
        if one is not None and two is not None:
            series[quantity] = np.linalg.norm(other.of(two, t) - one[within], axis=1)
            uncertainties[quantity] = other.uncertainty_of(two, t)
            scales[quantity] = float(np.linalg.norm(one[within], axis=1).max())
    result.t[key], result.series[key], result.scales[key] = a.t[within], series, scales
    result.uncertainties[key] = uncertainties


def _known(result: Differences, name: str, a: Track, b: Interpolated) -> np.ndarray:
    """Mask of the samples of A at which B is known; counts the other ones within B's time span."""
    within = overlap(a, b.track, result.clocks)
    known = within & b.known(result.clocks.of(a.t))
    if lost := int(within.sum() - known.sum()):
        result.left_out[name] = lost
    return known


def summary(found: Differences, bounds: Mapping[str, float] | None = None) -> dict[str, Any]:
    """RMS, maximum, first divergence and growth of each difference, as plain data.

    bounds: largest allowed difference, by quantity; `exceeded` lists violations.
    """
    given = dict(bounds or {})
    table: dict[str, Any] = {}
    exceeded: list[str] = []
    for name, series in found.series.items():
        table[name] = {}
        for quantity, values in series.items():
            floor = found.floors[quantity]
            bound = given.get(quantity, max(DIVERGED * found.scales[name][quantity], floor))
            uncertainty = found.uncertainties[name][quantity]
            table[name][quantity] = _figures(found.t[name], values, uncertainty, bound, floor)
            worst = max([found, *found.unaligned], key=lambda one: _largest(one, name, quantity))
            largest = _largest(worst, name, quantity)
            if quantity in given and largest > given[quantity] and worst is not found:
                exceeded.append(
                    f"{name}: {quantity} {largest:.3g} {UNITS[quantity]} with the offset "
                    f"{shown_offset(worst.clocks.offset)}, allowed {given[quantity]:g}"
                )
            elif quantity in given and not values.max() <= given[quantity]:
                exceeded.append(
                    f"{name}: {quantity} {values.max():.3g} {UNITS[quantity]}, allowed "
                    f"{given[quantity]:g}{_interpolated(values, uncertainty, UNITS[quantity])}"
                )
    if given and found.shared < TOGETHER:
        exceeded.append(
            f"only {found.shared:.0%} of the motion overlaps with the estimated offset (at least "
            f"{TOGETHER:.0%} needed to check a bound); use --align none or first"
        )
    return {
        "align": found.align,
        "offset": found.clocks.offset,
        "offset_error": found.clocks.offset_error,
        "drift": found.clocks.drift,
        "drift_error": found.clocks.drift_error,
        "start": found.start,
        "pairs": found.pairs,
        "left_out": found.left_out,
        "differences": table,
        "exceeded": exceeded,
        "notes": found.notes,
    }


def shown_offset(offset: float) -> str:
    """A clock offset as text, to a microsecond if it contains an epoch."""
    return f"{offset:.6f} s" if abs(offset) > CALENDAR else f"{offset:.6g} s"


def _largest(found: Differences, name: str, quantity: str) -> float:
    """Largest difference; 0 if A and B have no instant in common."""
    return float(found.series.get(name, {}).get(quantity, np.zeros(1)).max())


def _interpolated(values: np.ndarray, uncertainty: np.ndarray, unit: str) -> str:
    """Text with the share of interpolation in the largest difference; "" if negligible."""
    made = float(uncertainty[int(np.argmax(values))])
    return (
        f" (of which interpolation up to {made:.2g} {unit})"
        if made > SUSPECT * values.max()
        else ""
    )


def _figures(
    t: np.ndarray, values: np.ndarray, uncertainty: np.ndarray, bound: float, floor: float
) -> dict[str, Any]:
    sure = values - SURELY * uncertainty
    above = np.flatnonzero(sure > bound)
    return {
        "samples": len(values),
        "rms": float(np.sqrt(np.mean(values**2))),
        "max": float(values.max()),
        "at": float(t[int(np.argmax(values))]),
        "bound": float(bound),
        "first_above": float(t[above[0]]) if len(above) else None,
        "rounding": float(floor),
        "interpolation": float(uncertainty.max()),
        "growth": growth_rate(t, values) if _of_motions(values, sure, floor) else None,
    }


def _of_motions(values: np.ndarray, sure: np.ndarray, floor: float) -> bool:
    """Whether most differences above rounding also exceed the interpolation error."""
    return bool(2 * np.count_nonzero(sure[values > floor] > 0.0) > np.count_nonzero(values > floor))


def growth_rate(t: np.ndarray, values: np.ndarray) -> float | None:
    """Exponential growth rate [1/s] of a difference, until it saturates.

    Slope of its logarithm between ten times the least and a tenth of the largest difference; None
    if fewer than GROWING samples lie in that range.
    """
    positive = values[values > 0]
    if not len(positive):
        return None
    low, high = 10 * positive.min(), 0.1 * positive.max()
    end = int(np.argmax(values >= high)) if (values >= high).any() else len(values)
    within = np.flatnonzero((values[:end] > low) & (values[:end] < high))
    if len(within) < GROWING:
        return None
    slope, _ = np.polyfit(t[within], np.log(values[within]), 1)
    return float(slope)
