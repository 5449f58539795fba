# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sources of readings in a bag, and its tree of transforms: poses of frames in the tree's root."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from rb_sim.bags.info import GrowingTime
from rb_sim.base.names import first_few
from rb_sim.io.messages.cdr import JOINT_STATE
from rb_sim.numerics.rotations import angle_between, cross, rotate, unit
from rb_sim.numerics.rotations import product as turned

# Kinds of readings.


POSE, TWIST, WRENCH, IMU = "pose", "twist", "wrench", "imu"
SCALAR, JOINT = "scalar", "joint"


class Piece(NamedTuple):
    """Consecutive readings of one source, in the order of the file."""

    source: str
    """the topic; TOPIC:CHILD for transforms and joints; TOPIC:twist for the twist of an Odometry;
    if ambiguous a name made by `Sources`."""
    kind: str
    """POSE [position, quaternion], TWIST [v, w], WRENCH [force, torque], IMU [q, w, a], SCALAR,
    JOINT [rad or m]."""
    frame: str
    child: str
    t: np.ndarray
    """header stamp, or log time if the type has no stamp [s], shape (n,)."""
    log: np.ndarray
    """log time [s], shape (n,)."""
    values: np.ndarray
    """shape (n, number of columns of the kind)."""
    stamp: np.ndarray
    """t as integers [ns], exact also since the epoch, shape (n,)."""
    twist: np.ndarray
    """of poses whose messages also hold one, in the axes of the child, shape (n, 6), NaN if it is
    not finite; else (n, 0)."""
    transform: bool = False
    """whether it belongs to a tree of transforms."""

    def take(self, which: Any) -> Piece:
        """The readings of this mask or with these indices."""
        return self._replace(**{name: getattr(self, name)[which] for name in COLUMNS})


COLUMNS = ("t", "log", "values", "stamp", "twist")
"""Fields of a Piece with a row for each reading."""


# Names of sources: different frames or types under one topic are different sources.
#
# A topic may carry poses of one body in several frames, transforms from several parents to one
# child, or messages of several types, which must not be joined into one motion.


MOST_FRAMES = 16
"""Maximum number of sources of one name; more mean a name that changes with every message."""
MOST_OF_TOPIC = 1000
WORLD = ("", "world", "map", "odom")
"""Frame names that count as the world, besides the reference frame of the poses."""
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped")


class Origin(NamedTuple):
    """Key that distinguishes the readings under one name."""

    ros_type: str
    frame: str
    child: str


class Sources:
    """Assigns a name to each origin: the topic (TOPIC:CHILD as in Piece) to the first, for later
    ones with the difference in brackets."""

    def __init__(self) -> None:
        self._named: dict[str, dict[Origin, str]] = {}
        self._of_topic: dict[str, int] = {}
        self._channels: dict[str, set[int]] = {}

    @property
    def notes(self) -> list[str]:
        """A line for each name with several origins, and each source with several channels."""
        lines = []
        for base, named in self._named.items():
            others = list(named.values())[1:]
            if others:
                named_others = first_few(others)
                lines.append(f"{base}: not all of one type and frame: {named_others} for itself")
        return lines + [
            f"{source}: comes in {len(channels)} channels, which are taken as one source"
            for source, channels in self._channels.items()
            if len(channels) > 1
        ]

    def name(self, topic: str, ros_type: str, frame: str, child: str, channel: int = 0) -> str:
        """Name of the source of these readings. Raises ValueError if a topic has too many."""
        origin = Origin(ros_type, frame.removeprefix("/"), child.removeprefix("/"))
        base = f"{topic}:{child}" if ros_type in (*TRANSFORMS, JOINT_STATE) else topic
        named = self._named.setdefault(base, {})
        if origin not in named:
            count = self._of_topic[topic] = self._of_topic.get(topic, 0) + 1
            if len(named) >= MOST_FRAMES:
                raise ValueError(f"it has more than {MOST_FRAMES} frames")
            if count > MOST_OF_TOPIC:
                raise ValueError(f"it has more than {MOST_OF_TOPIC} children")
            named[origin] = base if not named else self._other(base, origin, next(iter(named)))
        self._channels.setdefault(named[origin], set()).add(channel)
        return named[origin]

    def _other(self, base: str, origin: Origin, first: Origin) -> str:
        parts = []
        if origin.ros_type != first.ros_type:
            parts.append(origin.ros_type.rpartition("/")[2])
        if origin.child != first.child:
            parts.append(f"of {origin.child or 'no child'}")
        if origin.frame != first.frame:
            parts.append(f"in {origin.frame or 'no frame'}")
        return f"{base} ({', '.join(parts)})"


def words(source: str) -> set[str]:
    """Parts of a source's name that may be the name of a body."""
    plain = topic_of(source)
    return {source, plain, *plain.replace(":", "/").split("/")}


def topic_of(source: str) -> str:
    """Name of a source without the brackets that distinguish it."""
    return source.partition(" (")[0]


# Tree of transforms: parents of frames, and the chain from a frame to its root.
#
# A robot's transforms form a tree (`map` to `odom` to `base_link`): the pose of a frame in the root
# is the product of the transforms along the chain. Each namespace (`/robot1/tf` with
# `/robot1/tf_static`) has its own tree.


Links = dict[str, dict[str, str]]
"""Source of the transform by parent frame, by child frame."""


class Chain(NamedTuple):
    """Recipe for the pose of a frame in the root of its tree.

    root_child = before[-1] ... before[0] driver after[0] ... after[-1], by names of sources.
    """

    name: str
    """name of the composed source."""
    driver: str
    """source whose stamps the composed poses have."""
    before: tuple[str, ...]
    """transforms from the reference frame of the driver up to the root."""
    after: tuple[str, ...]
    """static transforms from the driver's child frame down to the child."""
    root: str
    child: str
    replaced: str
    """source with the same child, whose poses are not in the root."""


def chains(pieces: Iterable[Piece], wanted: frozenset[str]) -> list[Chain]:
    """Chains that can be composed, found in the first readings of a bag.

    wanted: frames whose poses are composed even if fixed to their parent. Frames with two parents
    or in a cycle are not part of a tree and are excluded.
    """
    firsts: dict[str, Piece] = {}
    for piece in pieces:
        if piece.kind == POSE:
            firsts.setdefault(piece.source, piece)
    trees = _trees(piece for piece in firsts.values() if piece.transform)
    made = [_chain(piece, trees, firsts, wanted) for piece in firsts.values()]
    return [chain for chain in made if chain is not None]


def _trees(pieces: Iterable[Piece]) -> dict[str, Links]:
    """Trees of these transforms, by namespace."""
    trees: dict[str, Links] = {}
    for piece in pieces:
        links = trees.setdefault(namespace(piece.source), {})
        links.setdefault(plain(piece.child), {})[plain(piece.frame)] = piece.source
    return trees


def plain(frame: str) -> str:
    """The frame's name without the leading slash of ROS 1."""
    return frame.removeprefix("/")


def is_static(source: str) -> bool:
    """Whether a source of transforms is static."""
    return source.partition(":")[0].endswith("/tf_static")


def namespace(source: str) -> str:
    """Prefix before /tf or /tf_static in the name of a source of transforms."""
    return source.partition(":")[0].rpartition("/")[0]


def _chain(
    piece: Piece, trees: dict[str, Links], firsts: dict[str, Piece], wanted: frozenset[str]
) -> Chain | None:
    """The chain of a source of poses; None if it needs none or is undefined."""
    links, driver = _tree_of(piece, trees), piece
    after: list[str] = []
    while driver.transform and is_static(driver.source):
        above = links.get(plain(driver.frame), {})
        after.insert(0, driver.source)
        if plain(piece.child) not in wanted or len(above) != 1 or len(after) > len(links):
            return None
        driver = firsts[next(iter(above.values()))]
    found = _way(plain(driver.frame), links)
    if found is None:
        return None
    before, root = found
    if not after and all(_is_nothing(firsts[source]) for source in before):
        return None
    name = f"{piece.source} (in {root} by transforms)"
    return Chain(name, driver.source, before, tuple(after), root, piece.child, piece.source)


def _tree_of(piece: Piece, trees: dict[str, Links]) -> Links:
    """Tree of a transform; for other poses the only tree with their frame, if unique."""
    if piece.transform:
        return trees[namespace(piece.source)]
    known = [links for links in trees.values() if plain(piece.frame) in links]
    return known[0] if len(known) == 1 else {}


def _way(frame: str, links: Links, ends: Container[str] = ()) -> tuple[tuple[str, ...], str] | None:
    """Transforms from a frame up to the root, or the first of `ends` above it, and that frame; None
    if ambiguous."""
    way: list[str] = []
    while frame in links and not (way and frame in ends):
        parents = links[frame]
        if len(parents) != 1 or len(way) > len(links):
            return None
        frame, source = next(iter(parents.items()))
        way.append(source)
    return tuple(way), frame


def _is_nothing(piece: Piece) -> bool:
    """Whether a transform is static and the identity."""
    value = piece.values[0]
    return is_static(piece.source) and not np.any(value[:6]) and bool(value[6])


# Composition of poses in the root of a tree of transforms.
#
#     p_RC = p_RP + R(q_RP) p_PC        q_RC = q_RP q_PC        (root R, parent P, child C)
#
# at the stamps of the lowest transform that is not static. A parent's transform is interpolated as
# in tf2: positions linearly, attitudes by slerp (Shoemake, Animating rotation with quaternion
# curves, 1985).


APART = 1.0
"""[s]: largest interval in which a transform is interpolated, unless usual ones are longer."""
USUAL = 3.0
"""Multiple of a transform's median interval that is still interpolated."""
BACK = 1.0
"""[s]: a larger step back of the stamps is a set clock, a smaller one a late message."""
MOST = 100_000
"""Maximum number of poses waiting for their parents' transforms, and of transforms kept."""
MOST_NAMED = 4


class Composed:
    """Composes the poses of `chains` from readings that arrive in pieces; bounded memory.

    fixed: the static transforms.
    """

    def __init__(self, chains: list[Chain], fixed: FixedFrames) -> None:
        self._chains, self._fixed = chains, fixed
        links = {source for chain in chains for source in (*chain.before, *chain.after)}
        self._histories = {source: _History() for source in links if not is_static(source)}
        self._links = links
        self._drivers = {chain.driver for chain in chains}
        self._waiting: dict[str, list[tuple[Array, Piece]]] = {c.name: [] for c in chains}
        self._reached = {chain.name: -np.inf for chain in chains}
        """latest time up to which each chain was composed."""
        self._time = GrowingTime()
        self._start: int | None = None
        self._lost: Counter[str] = Counter()
        self._made: Counter[str] = Counter()
        self._between: Counter[str] = Counter()

    def add(self, piece: Piece) -> None:
        """Append readings of a source."""
        if piece.source not in self._links and piece.source not in self._drivers:
            return
        if is_static(piece.source) and piece.source in self._links:
            self._fixed.add(piece)
            return
        if self._start is None:
            self._start = int(piece.stamp[0])
        t = self._time.found(piece.source, (piece.stamp - self._start) * 1e-9, BACK)
        if piece.source in self._histories:
            self._histories[piece.source].add(t, piece.values)
        for chain in self._chains:
            if chain.driver == piece.source:
                self._waiting[chain.name].append((t, piece))

    def ready(self, *, last: bool = False) -> Iterator[Piece]:
        """Yield the poses whose transforms are all available; with `last` all remaining ones."""
        for chain in self._chains:
            yield from self._take(chain, last)
        for source, history in self._histories.items():
            history.forget(min(self._reached[c.name] for c in self._chains if source in c.before))

    @property
    def notes(self) -> list[str]:
        """Lines on what was composed, and what was not possible."""
        roots: dict[str, list[str]] = {}
        for chain in self._chains:
            if self._made[chain.name]:
                roots.setdefault(chain.root, []).append(chain.replaced)
        lines = [f"along the tree of transforms also in {root}: {_some(of)}"
                 for root, of in roots.items()]  # fmt: skip
        for name, count in self._between.items():
            lines.append(
                f"{name}: {count} of {self._made[name]} poses by transforms between two stamps "
                "(linear, as tf2 has it): accelerations are only as good as that"
            )
        for name, count in self._lost.items():
            lines.append(f"{name}: {count} poses skipped: a transform between their frame and "
                         "the root has no stamps close enough before and after them")  # fmt: skip
        lines += [f"{source}: changes, though static: the first is taken"
                  for source in sorted(self._fixed.changing & self._links)]  # fmt: skip
        return lines

    def _take(self, chain: Chain, last: bool) -> Iterator[Piece]:
        waiting = self._waiting[chain.name]
        moving = [self._histories[s] for s in chain.before if s in self._histories]
        size = sum(len(t) for t, _ in waiting)
        limit = min((history.last for history in moving), default=np.inf)
        if last or size > MOST:
            limit = np.inf
        rest: list[tuple[Array, Piece]] = []
        for t, piece in waiting:
            now = t <= limit
            if not now.all():
                rest.append((t[~now], piece.take(~now)))
            if now.any():
                self._reached[chain.name] = max(self._reached[chain.name], float(t[now].max()))
                yield from self._made_of(chain, t[now], piece.take(now))
        self._waiting[chain.name] = rest

    def _made_of(self, chain: Chain, t: Array, piece: Piece) -> Iterator[Piece]:
        """Composed poses of a chain at times t of its driver."""
        pose, known, between = _unit(piece.values), np.ones(len(t), bool), np.zeros(len(t), bool)
        for source in chain.after:
            pose = product(pose, self._fixed.poses[source])
        for source in chain.before:
            if source in self._fixed.poses:
                parent = self._fixed.poses[source]
            else:
                parent, reached, inside = self._histories[source].at(t)
                known, between = known & reached, between | inside
            pose = product(parent, pose)
        self._count(chain.name, known, between)
        if known.any():
            yield piece.take(known)._replace(
                source=chain.name, frame=chain.root, child=chain.child, values=pose[known],
                twist=np.empty((int(known.sum()), 0)), transform=False,
            )  # fmt: skip

    def _count(self, name: str, known: Array, between: Array) -> None:
        self._made[name] += int(known.sum())
        for counter, which in ((self._lost, ~known), (self._between, between & known)):
            if which.any():
                counter[name] += int(which.sum())


class _History:
    """Poses of one transform over growing time."""

    def __init__(self) -> None:
        self._t, self._poses = np.empty(0), np.empty((0, 7))
        self._apart: float | None = None

    @property
    def last(self) -> float:
        """Latest time; -inf if empty."""
        return float(self._t[-1]) if len(self._t) else -np.inf

    def add(self, t: Array, poses: Array) -> None:
        """Append poses; those not later than all before are dropped."""
        later = t > np.maximum.accumulate(np.append(self.last, t))[:-1]
        self._t = np.concatenate([self._t, t[later]])[-MOST:]
        self._poses = np.concatenate([self._poses, _unit(poses[later])])[-MOST:]
        if self._apart is None and len(self._t) > 1:
            self._apart = max(APART, USUAL * float(np.median(np.diff(self._t))))

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Poses (n, 7) at times t; masks of the known and of the interpolated ones."""
        if not len(self._t):
            return HERE.repeat(len(t), axis=0), np.zeros(len(t), bool), t < -np.inf
        upper = np.clip(np.searchsorted(self._t, t), 0, len(self._t) - 1)
        lower = np.maximum(upper - 1, 0)
        same = self._t[upper] == t
        width = np.where(same, 1.0, self._t[upper] - self._t[lower])
        inside = (t > self._t[lower]) & (t < self._t[upper]) & (width <= (self._apart or 0.0))
        part = np.where(same | ~inside, 1.0, (t - self._t[lower]) / np.where(inside, width, 1.0))
        poses = interpolated(self._poses[lower], self._poses[upper], part)
        return poses, same | inside, inside

    def forget(self, before: float) -> None:
        """Drop poses not needed from time `before` on."""
        first = max(0, int(np.searchsorted(self._t, before, side="right")) - 1)
        self._t, self._poses = self._t[first:], self._poses[first:]


def product(parent: Array, child: Array) -> Array:
    """Pose of a child in the parent's reference frame; shapes (n, 7) or (1, 7)."""
    p, q = parent[:, :3], parent[:, 3:]
    return np.hstack([p + rotate(q, child[:, :3]), turned(q, child[:, 3:])])


def interpolated(a: Array, b: Array, part: Array) -> Array:
    """Poses at fraction `part` (0 to 1) between a and b; shapes (n, 7), (n,)."""
    p, q, u = a[:, 3:], b[:, 3:], part[:, None]
    q = np.where(np.sum(p * q, axis=1, keepdims=True) < 0, -q, q)
    angle = 0.5 * angle_between(p, q)[:, None]
    size = np.where(angle > 0, np.sin(angle), 1.0)
    left = np.where(angle > 0, np.sin((1 - u) * angle) / size, 1 - u)
    right = np.where(angle > 0, np.sin(u * angle) / size, u)
    return np.hstack([(1 - u) * a[:, :3] + u * b[:, :3], left * p + right * q])


def _unit(poses: Array) -> Array:
    return np.hstack([poses[:, :3], unit(poses[:, 3:7])])


def _some(names: list[str]) -> str:
    return ", ".join(names[:MOST_NAMED]) + f" and {len(names) - MOST_NAMED} more" * (
        len(names) > MOST_NAMED
    )


# Frames connected by static transforms.


Array = np.ndarray
HERE = np.array([[0.0] * 6 + [1.0]])
"""The identity pose, shape (1, 7)."""


class FixedFrames:
    """Static transforms of a bag; children with two parents or a changing transform are
    excluded."""

    def __init__(self, pieces: Iterable[Piece] = ()) -> None:
        fixed = [p for p in pieces if p.kind == POSE and p.transform and is_static(p.source)]
        self._trees = _trees(fixed)
        self._first: dict[str, Array] = {}
        for piece in fixed:
            self._first.setdefault(piece.source, piece.values[:1])
        self.poses = {source: _unit(values) for source, values in self._first.items()}
        """first pose of each, shape (1, 7), by source."""
        self.changing: set[str] = set()
        for piece in fixed:
            self.add(piece)

    def add(self, piece: Piece) -> None:
        """Compare readings of a static transform with its first one."""
        if not (piece.values == self._first[piece.source]).all():
            self.changing.add(piece.source)

    def carrier(self, frame: str, bodies: Container[str]) -> tuple[str, Array] | None:
        """Nearest ancestor of a frame among `bodies`, and the frame's pose in it, (7,).

        None if there is none, or if the trees of several namespaces disagree.
        """
        found = []
        for links in self._trees.values():
            way, above = _way(plain(frame), links, bodies) or ((), "")
            if way and above in bodies and not self.changing.intersection(way):
                pose = HERE
                for source in way:
                    pose = product(self.poses[source], pose)
                found.append((above, pose[0]))
        same = all(f == found[0][0] and np.array_equal(p, found[0][1]) for f, p in found)
        return found[0] if found and same else None


def carried_over(wrench: Array, pose: Array) -> Array:
    """Wrenches (n, 6) about a frame's origin, in its axes, transformed to the frame in which it has
    the given pose (7,): about that frame's origin, in its axes.

        F_B = R F_S        K_B = R K_S + r x F_B
    """
    r, q = pose[:3], pose[3:]
    force = rotate(q, wrench[:, :3])
    return np.hstack([force, rotate(q, wrench[:, 3:]) + cross(r, force)])
