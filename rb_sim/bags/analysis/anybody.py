"""Somebody else's poses and wrenches: which body they are of, and what follows from both."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rb_sim.bags.analysis.bodies import BodyFigures
from rb_sim.bags.analysis.derivatives import Body, Motion
from rb_sim.bags.analysis.masses import scene_with
from rb_sim.bags.analysis.twists import Twists
from rb_sim.bags.analysis.whole import Whole
from rb_sim.bags.sources import POSE, TWIST, WORLD, WRENCH, Piece, words
from rb_sim.bags.transforms import carried_over, plain
from rb_sim.base.errors import RbSimError

if TYPE_CHECKING:
    from rb_sim.bags.analysis.figures import Figures
    from rb_sim.bags.analysis.result import Analysis, Reading
    from rb_sim.bags.readings import Readings
    from rb_sim.scene.schema import Scene


# Whether poses are in other units than metres: what falls freely tells it.
#
# A body on which only weight acts takes 9.81 m/s^2 in one direction; where its acceleration stays
# at a hundred or a thousand times that, the poses are in centimetres or millimetres.


GRAVITY = 9.80665
"""[m/s^2], standard."""
UNITS = {100.0: "cm", 1000.0: "mm"}
NEAR = 0.02
"""Of gravity: within that an acceleration is one of a fall (gravity itself differs by 0.3 %)."""
EVEN = 0.2
"""Scatter of the acceleration within a block, of its mean, up to which it is one acceleration."""
BLOCK = 16
"""Samples of a block."""
LEAST = 2
"""Blocks of a fall below which it tells nothing."""
ALONG = 0.99
"""Length of the mean of the directions of all falls, from which on they are one."""


class Fall:
    """Looks for falls in the motion of one source of poses."""

    def __init__(self) -> None:
        self._count = dict.fromkeys(UNITS, 0)
        self._along = {factor: np.zeros(3) for factor in UNITS}

    def look(self, motion: Motion) -> None:
        """The next motion."""
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
        """Which other unit they are in, as it seems; or ""."""
        for factor, unit in UNITS.items():
            count = self._count[factor]
            if count >= LEAST and np.linalg.norm(self._along[factor]) > ALONG * count:
                return (
                    f"falls at {factor * GRAVITY:.0f} m/s^2, {factor:.0f} times gravity: are its "
                    f"poses in {unit}?"
                )
        return ""


FEW, SHUFFLED = 3, 0.01
"""Steps back, and how many of a source's readings they are, from which on its messages lie in no
order: a clock is not set so often."""
MOST_EARLY = 4096
"""Pieces of wrenches that wait for the poses of their body."""


class Anybody:
    """Gives poses to bodies, wrenches to the bodies that they act on, and both to the balances.

    masses: by body, child frame, or topic. scene: of all bodies together; else each body is
    balanced for itself. readings: where the pieces are from; a body whose poses come in the root of
    a tree of transforms, too, moves as it does there.
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
        self._child: dict[str, str] = {}
        """frame of each body with poses, "" where they do not tell it."""
        self._parent: dict[str, str] = {}
        """frame in which the poses of each body are, "" where they do not tell it."""
        self._worlds: set[str] = set(WORLD)
        self._twists = Twists()
        self._falls: dict[str, Fall] = {}
        """by source of poses."""
        self._own_twists: dict[str, list[Piece]] = {}
        """of messages that hold a pose and a twist, until the poses of these messages come."""
        self._early: list[tuple[Piece, np.ndarray]] = []
        self._stamp: dict[str, int] = {}
        self._same: Counter[str] = Counter()
        self._frames: dict[str, tuple[str, str]] = {}
        """of each source of poses, and that which its poses are of."""
        self._carried: dict[str, str] = {}
        """frame to which the wrenches of a source were carried over."""
        if scene is not None:
            self._make(scene.name or "scene", tuple(scene.bodies), lambda: scene)

    def readings(self) -> Iterator[Reading]:
        """All readings, in one pass over the bag, at times [s] from its start."""
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
        """The next readings, at times t [s]."""
        if piece.kind == POSE:
            if piece.source not in self._found.bodies:
                self._begin(piece)
                early, self._early = self._early, []
                for waiting in early:
                    self._acted(*waiting)
            self._add(piece, t)
        elif piece.kind == TWIST:
            self._twists.add(piece, t)
            if piece.source.endswith(":twist"):
                self._own_twists.setdefault(piece.source.removesuffix(":twist"), []).append(piece)
        elif piece.kind == WRENCH and self._masses:
            self._acted(piece, t)

    def _add(self, piece: Piece, t: np.ndarray) -> None:
        """Poses; of several with one stamp the first."""
        last = self._stamp.get(piece.source)
        fresh = np.diff(piece.stamp, prepend=piece.stamp[0] - 1 if last is None else last) != 0
        self._stamp[piece.source] = int(piece.stamp[-1])
        twist = self._twist_at(piece)
        if not fresh.all():
            self._same[piece.source] += int((~fresh).sum())
            t, piece = t[fresh], piece._replace(values=piece.values[fresh])
            twist = None if twist is None else twist[fresh]
        if len(t):
            self._found.bodies[piece.source].add(t, piece.values, twist=twist)

    def _twist_at(self, piece: Piece) -> np.ndarray | None:
        """The twists of the messages of these poses, NaN where a message has none that will do."""
        parts = self._own_twists.pop(piece.source, [])
        if not parts:
            return None
        stamp = np.concatenate([part.stamp for part in parts])
        order = np.argsort(stamp, kind="stable")
        at = order[np.minimum(np.searchsorted(stamp[order], piece.stamp), len(stamp) - 1)]
        values = np.concatenate([part.values for part in parts])[at]
        return np.where((stamp[at] == piece.stamp)[:, None], values, np.nan)

    def finish(self) -> None:
        """Balances and constraints; no more readings come."""
        self._found.notes += [
            f"{source}: {count} poses have the stamp of the one before: not differentiated"
            for source, count in self._same.items()
        ]
        self._found.notes += [
            f"{source}: {fall.note}" for source, fall in self._falls.items() if fall.note
        ]
        self._found.notes += self._moving_frames() + self._several_frames() + self._twists.notes
        self._found.notes += [
            f"{source}: carried over to the frame {frame} by static transforms"
            for source, frame in self._carried.items()
        ]
        if self._readings.composed:
            self._found.notes += [
                f"{name}: no frame and no topic has this name: no balance"
                for name in self._masses
                if name not in self._child
            ]
        for whole, title in self._title.items():
            result = whole.finish(self._child)
            self._found.notes += whole.notes
            constraints = result.pop("constraints")
            self._found.constraints = constraints or self._found.constraints
            if result["energy"] is not None:
                self._found.balances[title] = result
        for source in dict.fromkeys(piece.source for piece, _ in self._early):
            self._found.notes.append(
                f"{source}: not in the balance: neither its frame nor its topic names a body"
            )

    def _begin(self, piece: Piece) -> None:
        """The first poses of a source."""
        again = piece.source in self._readings.composed
        name = None if again else self._named(piece.source, piece.child)
        self._frames[piece.source] = piece.frame, piece.child
        body = None if name is None else self._masses[name]
        listener = None
        self._worlds.add(piece.frame)
        if name in self._child:
            note = f"{piece.source}: {name} has poses already: not in the balance"
            self._found.notes.append(note)
        elif name is not None and body is not None:
            self._child[name] = piece.child
            self._parent[name] = plain(piece.frame)
            if name not in self._whole:
                self._make(name, (name,), lambda: scene_with(name, body))
            if name in self._whole:
                listener = partial(self._whole[name].motion, name)
        figures = self._found.bodies[piece.source] = BodyFigures(body, listener)
        self._twists.poses(piece, figures)
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

    def _acted(self, piece: Piece, t: np.ndarray) -> None:
        """Wrenches on the body whose frame they are in, or that carries it (a sensor's); in the
        world's, by their topic."""
        bodies = {plain(child): name for name, child in self._child.items() if child}
        bodies |= {name: name for name in self._masses}
        body = bodies.get(plain(piece.frame))
        carrier = None if body else self._readings.fixed.carrier(piece.frame, bodies)
        values = piece.values
        if carrier is not None:
            body, values = bodies[carrier[0]], carried_over(values, carrier[1])
        own_axes = body is not None
        if body is None and piece.frame in self._worlds - self._readings.inner:
            parts = words(piece.source)
            named = [name for name in self._masses if name in parts]
            body = named[0] if len(named) == 1 else self._only
        if body is not None and body in self._whole:
            self._whole[body].wrench(piece.source, body, own_axes, t, values)
            if carrier is not None:
                self._carried[piece.source] = carrier[0]
        elif len(self._early) < MOST_EARLY:
            self._early.append((piece, t))

    @property
    def _only(self) -> str | None:
        return next(iter(self._masses)) if len(self._masses) == 1 else None

    def _named(self, source: str, child: str) -> str | None:
        """The body of a source of poses."""
        parts = {child, *words(source)}
        named = [name for name in self._masses if name in parts]
        if not named and ("/tf_static:" in source or self._readings.composed):
            return None  # what never moves is not the only body; which of a tree is, nobody knows
        return named[0] if named else self._only

    def _moving_frames(self) -> list[str]:
        """A line for each source whose poses are in a frame that moves itself."""
        frames = self._frames
        moving = {plain(child): source for source, (_, child) in frames.items()
                  if child and self._found.figures[source].moves}  # fmt: skip
        return [
            f"{source}: its poses are in the frame {frame}, which moves ({moving[plain(frame)]}): "
            "velocities and balances are relative to that frame, without its inertial forces"
            for source, (frame, _) in frames.items()
            if moving.get(plain(frame), source) != source and source not in self._readings.composed
        ]

    def _several_frames(self) -> list[str]:
        """A line for each scene whose bodies have poses in frames that no transform connects."""
        lines = []
        for whole, title in self._title.items():
            frames: dict[str, list[str]] = {}
            for name, frame in self._parent.items():
                if self._whole.get(name) is whole and frame:
                    frames.setdefault(frame, []).append(name)
            if len(frames) > 1:
                where = ", ".join(f"{' and '.join(names)} in {f}" for f, names in frames.items())
                lines.append(
                    f"{title}: no transform connects the frames of its bodies ({where}): taken as "
                    "one, so that its balances and constraints may mean nothing"
                )
        return lines


def _why(back: int, figures: Figures) -> str:
    """What a reader can do where it is no clock that was set now and then."""
    if back < max(FEW, SHUFFLED * figures.rates.count):
        return ""
    return ": its messages do not lie in the order of their times; sort the bag first (`mcap sort`)"
