"""Whether a twist is the derivative of the poses that it belongs to: of which axes, in which units.

With a the readings and b the velocities from the poses, the part that k b in some axes leaves is

    (|a|^2 - 2 k a.b + k^2 |b|^2) / max(|a|^2, k^2 |b|^2)      summed over the readings

Where what the frame of the twist says leaves much, and other axes or a known factor leave little,
that is told.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.bags.analysis.bodies import BodyFigures
from rb_sim.bags.analysis.derivatives import Motion, velocity_noise
from rb_sim.bags.message_rates import linear
from rb_sim.bags.sources import Piece
from rb_sim.bags.tracks import axes_of, poses_of
from rb_sim.numerics.rotations import conjugate, cross, rotate

AXES = {"world": "in the axes of the poses", "body": "in the body's axes"}
FACTORS = (
    {1.0: "", 1000.0: " times 1000 (is it in mm?)", 1e-3: " over 1000 (are the poses in mm?)",
     -1.0: " with the other sign"},
    {1.0: "", 180.0 / np.pi: " times 57.3 (is it in degrees?)", -1.0: " with the other sign"},
)  # fmt: skip
NAMES = ("linear velocity", "angular velocity")
OFF = 0.1
"""RMS of what is left, of the larger of both, from which on another reading is looked for."""
BETTER = 0.5
"""Of that, below which another one is told."""
APART = 0.5
"""RMS of what is left from which on that is told even where nothing else fits."""
ABOVE_NOISE = 5.0
"""Times their noise that velocities from poses must have to say anything."""
EARLY = 64
"""Pieces of twists that wait for the first poses."""
MOST = 200_000
"""Readings that wait for the poses of their time; then the oldest are let go."""


class Fit(NamedTuple):
    """One way to read a twist."""

    off: float
    """RMS of what is left, of the larger of both."""
    words: str


class Twists:
    """Finds the poses that each twist belongs to: of its own message, else the only ones in the
    folder of its topic."""

    def __init__(self) -> None:
        self._poses: dict[str, tuple[Piece, BodyFigures]] = {}
        self._checks: dict[str, TwistCheck | None] = {}
        self._early: list[tuple[Piece, np.ndarray]] = []

    def poses(self, piece: Piece, figures: BodyFigures) -> None:
        """The first poses of a source."""
        self._poses[piece.source] = piece, figures
        early, self._early = self._early, []
        for waiting in early:
            self.add(*waiting)

    def add(self, piece: Piece, t: np.ndarray) -> None:
        """The next readings of a twist, at times t [s]."""
        if piece.source not in self._checks:
            names = poses_of(piece.source, self._poses)
            if not names:
                self._early = [*self._early[1 - EARLY :], (piece, t)]
                return
            self._checks[piece.source] = self._check(piece, names)
        check = self._checks[piece.source]
        if check is not None:
            check.add(t, piece.values)

    def _check(self, piece: Piece, names: list[str]) -> TwistCheck | None:
        pose, figures = self._poses[names[0]]
        axes = axes_of(piece, pose)
        if len(names) > 1 or not axes:
            return None
        own = piece.source == f"{pose.source}:twist"
        check = TwistCheck(piece.source, axes, figures.center_of_mass, own)
        figures.listen(lambda motion, jumps: check.motion(motion))
        return check

    @property
    def notes(self) -> list[str]:
        """Lines of all."""
        return [line for check in self._checks.values() if check for line in check.notes]


class TwistCheck:
    """Lays the readings of one twist beside the poses of one body, in bounded memory.

    axes: "world" or "body", as the frame of the twist says. center_of_mass: of the body whose
    motion is given, from the origin, in its own axes. own: one message holds both, as an Odometry;
    else it may be a command, and not the derivative at all.
    """

    def __init__(self, source: str, axes: str, center_of_mass: np.ndarray, own: bool) -> None:
        self.source = source
        self._own_poses = own
        self._axes, self._center = axes, center_of_mass
        self._waiting: list[tuple[np.ndarray, np.ndarray]] = []
        self._own, self._posed, self._noise = np.zeros(2), np.zeros(2), np.zeros(2)
        self._both = {name: np.zeros(2) for name in AXES}
        """squares of both, of the noise, and products: of the linear and the angular velocity."""

    def add(self, t: np.ndarray, twist: np.ndarray) -> None:
        """The next readings, (n, 6)."""
        self._waiting.append((t, twist))
        while sum(len(part) for part, _ in self._waiting[1:]) > MOST:
            del self._waiting[0]

    def motion(self, motion: Motion) -> None:
        """The next motion from the poses."""
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
        for j, (posed, noise) in enumerate(
            zip((v, motion.spin), velocity_noise(motion), strict=True)
        ):
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
        """A line for each velocity that is not what it should be."""
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
