# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Analysis of foreign bags: assigns poses and wrenches to bodies, and balances them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.bags.analysis.bodies import BodyFigures, scene_with
from rb_sim.bags.analysis.derivatives import Body, Jump, Motion
from rb_sim.bags.analysis.whole import Whole
from rb_sim.bags.info import linear
from rb_sim.bags.tracks import axes_of, poses_of
from rb_sim.bags.transforms import POSE, TWIST, WORLD, WRENCH, Piece, carried_over, plain, words
from rb_sim.base.errors import RbSimError
from rb_sim.numerics.rotations import conjugate, cross, rotate

if TYPE_CHECKING:
    from rb_sim.bags.analysis.analysis_page import Analysis, Reading
    from rb_sim.bags.analysis.figures import Figures
    from rb_sim.bags.readings import Readings
    from rb_sim.scene.schema import Scene


# Check that a recorded twist is the derivative of its poses, in the stated axes and units.
#
# With a the recorded and b the differentiated velocities, the squared relative residual of k b is
#
#     (|a|^2 - 2 k a.b + k^2 |b|^2) / max(|a|^2, k^2 |b|^2)      summed over the readings
#
# If it is large for the axes that the frame states, but small for other axes or a known factor,
# that is reported.


AXES = {"world": "in the axes of the poses", "body": "in the body's axes"}
FACTORS = (
    {1.0: "", 1000.0: " times 1000 (is it in mm?)", 1e-3: " over 1000 (are the poses in mm?)",
     -1.0: " with the other sign"},
    {1.0: "", 180.0 / np.pi: " times 57.3 (is it in degrees?)", -1.0: " with the other sign"},
)  # fmt: skip
NAMES = ("linear velocity", "angular velocity")
OFF = 0.1
"""Relative RMS residual above which other axes and factors are tried."""
BETTER = 0.5
"""Fraction of that residual below which the alternative is reported."""
APART = 0.5
"""Relative RMS residual above which a mismatch is reported even if no alternative fits."""
ABOVE_NOISE = 5.0
"""Minimum ratio of velocities from poses to their noise for this check."""
MOST = 200_000
"""Number of readings buffered until the poses of their time; beyond it the oldest are dropped."""


class Fit(NamedTuple):
    """One interpretation of a twist: axes and factor."""

    off: float
    """RMS residual relative to the larger of the two velocities."""
    words: str


class TwistCheck:
    """Compares one twist with the differentiated poses of one body, in bounded memory.

    axes: "world" or "body", as the frame of the twist states. center_of_mass [m]: of the body, from
    its origin, body axes. own: pose and twist come in one message, as in an Odometry; otherwise the
    twist may be a command.
    """

    def __init__(self, source: str, axes: str, center_of_mass: np.ndarray, own: bool) -> None:
        self.source = source
        self._own_poses = own
        self._axes, self._center = axes, center_of_mass
        self._waiting: list[tuple[np.ndarray, np.ndarray]] = []
        self._own, self._posed, self._noise = np.zeros(2), np.zeros(2), np.zeros(2)
        self._both = {name: np.zeros(2) for name in AXES}
        """products of both by axes; with the squares above: of linear and angular velocity."""

    def add(self, t: np.ndarray, twist: np.ndarray) -> None:
        """Append readings, shape (n, 6)."""
        self._waiting.append((t, twist))
        while sum(len(part) for part, _ in self._waiting[1:]) > MOST:
            del self._waiting[0]

    def motion(self, motion: Motion, jumps: Sequence[Jump] = ()) -> None:
        """Append motion from the poses, and compare the readings within its time span."""
        del jumps
        if not self._waiting or len(motion.t) < 2:
            return
        t = np.concatenate([part for part, _ in self._waiting])
        twist = np.concatenate([part for _, part in self._waiting])
        within = (t >= motion.t[0]) & (t <= motion.t[-1])
        later = t > motion.t[-1]
        self._waiting = [(t[later], twist[later])] if later.any() else []
        if within.any():
            self._compare(motion, t[within], twist[within])

    def _compare(self, motion: Motion, t: np.ndarray, twist: np.ndarray) -> None:
        q = motion.orientation
        v = motion.velocity - cross(motion.spin, rotate(q, self._center))
        for j, (posed, noise) in enumerate(zip((v, motion.spin), motion.scatter[2:], strict=True)):
            a = twist[:, 3 * j : 3 * j + 3]
            at = {"world": linear(t, motion.t, posed)}
            at["body"] = linear(t, motion.t, rotate(conjugate(q), posed))
            self._own[j] += np.sum(a * a)
            self._posed[j] += np.sum(at["world"] ** 2)
            self._noise[j] += len(t) * noise**2
            for name, b in at.items():
                self._both[name][j] += np.sum(a * b)

    @property
    def notes(self) -> list[str]:
        """A line for each velocity that does not match."""
        return [line for j in (0, 1) if (line := self._note(j))]

    def _note(self, j: int) -> str:
        own, posed = float(self._own[j]), float(self._posed[j])
        if not posed > max(ABOVE_NOISE**2 * float(self._noise[j]), 0.0):
            return ""
        start = f"{self.source}: its {NAMES[j]} is "
        if own == 0.0:
            return start + "zero, though its poses move" if self._own_poses else ""
        expected = self._fit(j, self._axes, 1.0)
        fits = [self._fit(j, axes, k) for axes in AXES for k in FACTORS[j]]
        best = min(fits)
        if expected.off > OFF and best.off < BETTER * expected.off:
            return (f"{start}not the derivative of its poses {expected.words} ({expected.off:.0%} "
                    f"off), but {best.words} ({best.off:.1%} off)")  # fmt: skip
        if expected.off > APART and self._own_poses:
            return (f"{start}not the derivative of its poses {expected.words}: "
                    f"{expected.off:.0%} off")  # fmt: skip
        return ""

    def _fit(self, j: int, axes: str, k: float) -> Fit:
        own, posed, both = (float(x[j]) for x in (self._own, self._posed, self._both[axes]))
        left = (own - 2.0 * k * both + k * k * posed) / max(own, k * k * posed)
        return Fit(float(np.sqrt(max(left, 0.0))), AXES[axes] + FACTORS[j][k])


# Detect poses that are not in metres, by free fall.
#
# A freely falling body accelerates at 9.81 m/s^2 in one direction. A steady acceleration of 100 or
# 1000 times that means poses in centimetres or millimetres.


GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""
UNITS = {100.0: "cm", 1000.0: "mm"}
NEAR = 0.02
"""Largest relative deviation of a fall from gravity, which itself varies by 0.3 %."""
EVEN = 0.2
"""Maximum relative scatter of the acceleration within a block for it to count as constant."""
BLOCK = 16
"""Samples per block."""
LEAST = 2
"""Minimum number of falling blocks for a note."""
ALONG = 0.99
"""Minimum length of the mean unit vector of all falls for one common direction."""


class Fall:
    """Detects free fall in one source of poses."""

    def __init__(self) -> None:
        self._count = dict.fromkeys(UNITS, 0)
        self._along = {factor: np.zeros(3) for factor in UNITS}

    def look(self, motion: Motion) -> None:
        """Append motion."""
        n = len(motion.t) // BLOCK
        blocks = motion.acceleration[: n * BLOCK].reshape(n, BLOCK, 3)
        mean = blocks.mean(axis=1)
        size = np.linalg.norm(mean, axis=1)
        scatter = np.sqrt(np.mean(np.sum((blocks - mean[:, None]) ** 2, axis=2), axis=1))
        even = scatter < EVEN * size
        for factor in UNITS:
            falls = even & (np.abs(size / (factor * GRAVITY) - 1.0) < NEAR)
            self._count[factor] += int(falls.sum())
            self._along[factor] += (mean[falls] / size[falls, None]).sum(axis=0)

    @property
    def note(self) -> str:
        """A line that names the probable unit if it is not metres; else ""."""
        for factor, unit in UNITS.items():
            count = self._count[factor]
            if count >= LEAST and np.linalg.norm(self._along[factor]) > ALONG * count:
                return (
                    f"falls at {factor * GRAVITY:.0f} m/s^2, {factor:.0f} times gravity: are its "
                    f"poses in {unit}?"
                )
        return ""


FEW, SHUFFLED = 3, 0.01
"""Number of steps back in time, absolute and relative to a source's readings, above which its
messages count as unordered: clocks are not set that often."""
MOST_EARLY = {TWIST: 64, WRENCH: 4096}
"""Number of pieces buffered until the poses of their body, by kind."""


class Anybody:
    """Assigns poses and wrenches to bodies, and feeds the balances.

    masses: by body, child frame, or topic. scene: with all bodies in one balance; without it each
    body has its own. readings: source of the pieces; if a body's poses also come composed in the
    root of a tree of transforms, those are used.
    """

    def __init__(
        self,
        found: Analysis,
        masses: dict[str, Body],
        scene: Scene | None,
        readings: Readings,
    ) -> None:
        self._found, self._masses, self._readings = found, masses, readings
        self._title: dict[Whole, str] = {}
        self._whole: dict[str, Whole] = {}
        """by body."""
        self._posed: dict[str, Piece] = {}
        """first pose of each body."""
        self._first: dict[str, Piece] = {}
        """first pose of each source."""
        self._falls: dict[str, Fall] = {}
        """by source of poses."""
        self._checks: dict[str, TwistCheck | None] = {}
        """by source of twists."""
        self._early: list[tuple[Piece, np.ndarray]] = []
        self._stamp: dict[str, int] = {}
        self._same: Counter[str] = Counter()
        self._carried: dict[str, str] = {}
        """frame to which the wrenches of each source were transformed."""
        if scene is not None:
            self._make(scene.name or "scene", tuple(scene.bodies), lambda: scene)

    def readings(self) -> Iterator[Reading]:
        """Yield all readings in one pass over the bag, at times [s] from its start."""
        found, readings = self._found, self._readings
        start: int | None = None
        for piece in readings.pieces():
            if start is None:
                start = round(float(piece.log[0]) * 1e9)
                # stamps may count from the epoch and log times from 0, or the other way round
                first = int(piece.stamp[0])
                start = first if abs(first - start) > 1e15 else min(first, start)
            t = (piece.stamp - start) * 1e-9
            yield piece.source, piece.kind, t, piece.values
            self._follow(piece, t)
        found.notes += readings.notes
        found.other_topics = readings.other_topics
        found.bytes, found.messages = readings.bytes, readings.messages
        for name, figures in found.figures.items():
            back = figures.rates.backwards
            if back:
                found.notes.append(f"{name}: time goes back {back} times{_why(back, figures)}")

    def _follow(self, piece: Piece, t: np.ndarray) -> None:
        """Process readings at times t [s]; those whose body has no poses yet wait for them."""
        if piece.kind == POSE:
            if piece.source not in self._first:
                self._begin(piece)
                early, self._early = self._early, []
                for waiting in early:
                    self._follow(*waiting)
            self._add(piece, t)
            return
        taken = True
        if piece.kind == TWIST:
            taken = self._compared(piece, t)
        elif piece.kind == WRENCH and self._masses:
            taken = self._acted(piece, t)
        before = sum(waiting.kind == piece.kind for waiting, _ in self._early)
        if not taken and before < MOST_EARLY[piece.kind]:
            self._early.append((piece, t))

    def _add(self, piece: Piece, t: np.ndarray) -> None:
        """Add poses; of several with the same stamp only the first."""
        last = self._stamp.get(piece.source)
        fresh = np.diff(piece.stamp, prepend=piece.stamp[0] - 1 if last is None else last) != 0
        self._stamp[piece.source] = int(piece.stamp[-1])
        if not fresh.all():
            self._same[piece.source] += int((~fresh).sum())
            t, piece = t[fresh], piece.take(fresh)
        if len(t):
            twist = piece.twist if piece.twist.shape[1] else None
            self._found.bodies[piece.source].add(t, piece.values, twist=twist)

    def finish(self) -> None:
        """Finish balances and constraint errors, after the last reading."""
        self._found.notes += [
            f"{source}: {count} poses have the stamp of the one before: not differentiated"
            for source, count in self._same.items()
        ]
        self._found.notes += [
            f"{source}: {fall.note}" for source, fall in self._falls.items() if fall.note
        ]
        self._found.notes += self._moving_frames() + self._several_frames()
        self._found.notes += [
            line for check in self._checks.values() if check for line in check.notes
        ]
        self._found.notes += [
            f"{source}: carried over to the frame {frame} by static transforms"
            for source, frame in self._carried.items()
        ]
        if self._readings.composed:
            self._found.notes += [
                f"{name}: no frame and no topic has this name: no balance"
                for name in self._masses
                if name not in self._posed
            ]
        for whole, title in self._title.items():
            result = whole.finish(self._posed)
            self._found.notes += whole.notes
            constraints = result.pop("constraints")
            self._found.constraints = constraints or self._found.constraints
            if result["energy"] is not None:
                self._found.balances[title] = result
        for source in dict.fromkeys(p.source for p, _ in self._early if p.kind == WRENCH):
            self._found.notes.append(
                f"{source}: not in the balance: neither its frame nor its topic names a body"
            )

    def _begin(self, piece: Piece) -> None:
        """Register a new source of poses."""
        first = self._first[piece.source] = piece.take(slice(1))
        again = piece.source in self._readings.composed
        name = None if again else self._named(piece.source, piece.child)
        body = None if name is None else self._masses[name]
        listener = None
        if name in self._posed:
            note = f"{piece.source}: {name} has poses already: not in the balance"
            self._found.notes.append(note)
        elif name is not None and body is not None:
            self._posed[name] = first
            if name not in self._whole:
                self._make(name, (name,), lambda: scene_with(name, body))
            if name in self._whole:
                listener = partial(self._whole[name].motion, name)
        figures = self._found.bodies[piece.source] = BodyFigures(body, listener)
        fall = self._falls[piece.source] = Fall()
        figures.listen(lambda motion, jumps: fall.look(motion))

    def _make(self, title: str, names: tuple[str, ...], scene: Callable[[], Scene]) -> None:
        try:
            whole = Whole(scene(), {name: self._masses[name] for name in names})
        except (TypeError, KeyError, RbSimError) as error:
            self._found.notes.append(f"{title}: no balance, no constraints: {error}")
            return
        self._title[whole] = title
        self._whole |= dict.fromkeys(names, whole)

    def _compared(self, piece: Piece, t: np.ndarray) -> bool:
        """Compare twists with the poses of the same message, else with the only ones in the folder
        of their topic; False if there are none yet."""
        if piece.source not in self._checks:
            names = poses_of(piece.source, self._first)
            if not names:
                return False
            pose, figures = self._first[names[0]], self._found.bodies[names[0]]
            check, axes = None, axes_of(piece, pose)
            if len(names) == 1 and axes:
                own = piece.source == f"{pose.source}:twist"
                check = TwistCheck(piece.source, axes, figures.center_of_mass, own)
                figures.listen(check.motion)
            self._checks[piece.source] = check
        if check := self._checks[piece.source]:
            check.add(t, piece.values)
        return True

    def _acted(self, piece: Piece, t: np.ndarray) -> bool:
        """Apply wrenches to the body that has or carries (a sensor's) their frame; False if it has
        no poses yet.

        Wrenches in a world frame are assigned by their topic."""
        bodies = {plain(pose.child): name for name, pose in self._posed.items() if pose.child}
        bodies |= {name: name for name in self._masses}
        body = bodies.get(plain(piece.frame))
        carrier = None if body else self._readings.fixed.carrier(piece.frame, bodies)
        values = piece.values
        if carrier is not None:
            body, values = bodies[carrier[0]], carried_over(values, carrier[1])
        own_axes = body is not None
        worlds = {*WORLD, *(pose.frame for pose in self._first.values())} - self._readings.inner
        if body is None and piece.frame in worlds:
            parts = words(piece.source)
            named = [name for name in self._masses if name in parts]
            body = named[0] if len(named) == 1 else self._only
        if body is None or body not in self._whole:
            return False
        self._whole[body].wrench(piece.source, body, own_axes, t, values)
        if carrier is not None:
            self._carried[piece.source] = carrier[0]
        return True

    @property
    def _only(self) -> str | None:
        return next(iter(self._masses)) if len(self._masses) == 1 else None

    def _named(self, source: str, child: str) -> str | None:
        """Name of the body that a source of poses belongs to; None if unknown."""
        parts = {child, *words(source)}
        named = [name for name in self._masses if name in parts]
        if not named and ("/tf_static:" in source or self._readings.composed):
            return None  # static frames are no body; which frame of a tree is the body is unknown
        return named[0] if named else self._only

    def _moving_frames(self) -> list[str]:
        """Notes on sources whose reference frame itself moves."""
        moving = {plain(pose.child): source for source, pose in self._first.items()
                  if pose.child and self._found.figures[source].moves}  # fmt: skip
        return [
            f"{source}: its poses are in the frame {pose.frame}, which moves "
            f"({moving[plain(pose.frame)]}): "
            "velocities and balances are relative to that frame, without its inertial forces"
            for source, pose in self._first.items()
            if moving.get(plain(pose.frame), source) != source
            and source not in self._readings.composed
        ]

    def _several_frames(self) -> list[str]:
        """Notes on scenes whose bodies' poses are in frames that no transform connects."""
        lines = []
        for whole, title in self._title.items():
            frames: dict[str, list[str]] = {}
            for name, pose in self._posed.items():
                if self._whole.get(name) is whole and plain(pose.frame):
                    frames.setdefault(plain(pose.frame), []).append(name)
            if len(frames) > 1:
                where = ", ".join(f"{' and '.join(names)} in {f}" for f, names in frames.items())
                lines.append(
                    f"{title}: no transform connects the frames of its bodies ({where}): taken as "
                    "one, so that its balances and constraints may mean nothing"
                )
        return lines


def _why(back: int, figures: Figures) -> str:
    """Advice appended to the note on steps back, if the messages are unordered."""
    if back < max(FEW, SHUFFLED * figures.rates.count):
        return ""
    return ": its messages do not lie in the order of their times; sort the bag first (`mcap sort`)"
