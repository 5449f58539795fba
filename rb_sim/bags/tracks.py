# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motions to compare: read from an rb_sim bag, a foreign bag, samples, or a CSV file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.bags.info import forward, joined, linear
from rb_sim.bags.readings import Readings
from rb_sim.bags.transforms import JOINT, POSE, TWIST, WRENCH, FixedFrames, Piece, plain, words
from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.base.names import MOST_NAMED, first_few, ros_name
from rb_sim.base.rounding import WRITTEN_ROUNDING, related
from rb_sim.io.bag.reader import BagReader, reader_of, scene_as_run
from rb_sim.io.messages.robot_description import joints_above, slides
from rb_sim.io.sink import restarts
from rb_sim.mechanics.error_scales import held_together
from rb_sim.mechanics.samples import ContactEvent, centers_of_mass, concatenate, origins
from rb_sim.numerics.rotations import from_rotation_vector, product, rotate, unit
from rb_sim.scene.extent import reach_of
from rb_sim.scene.schema import Scene

if TYPE_CHECKING:
    from rb_sim.scene.schema import Scene


# Poses of a scene's bodies from recorded joint states (sensor_msgs/JointState).
#
# Joint positions are relative to the pose in the scene file, as in rb_sim's `joint_states` and
# `robot_description`: a hinge rotates its body about its axis by the angle [rad], a linear guide
# translates it by the displacement [m], and child bodies move along.


class Poses(NamedTuple):
    """Poses of one body's origin, world axes."""

    t: Array
    """increasing [s], shape (n,)."""
    position: Array
    orientation: Array


def joint_poses(
    found: Mapping[str, tuple[Array, Array]], scene: Scene
) -> tuple[dict[str, Poses], str]:
    """Poses of bodies determined by joint states, and a line if these match no joint.

    found: times [s] and positions, (n, 1), of each joint, by its name in the bag."""
    above = joints_above(scene)
    joints = {ros_name(name): name for name, spec in above.values() if spec.type != "weld"}
    mine = {joints.get(name, name): series for name, series in found.items()}
    names = set(joints.values()) & set(mine)
    if found and not names:
        known = ", ".join(joints.values()) or "none: no fixed_axis, no translation along a line"
        return {}, f"its joint states are of {', '.join(found)}; the scene's joints are {known}"
    chains = {body: _chain(body, above) for body in above}
    poses = {}
    for body, chain in chains.items():
        wanted = [name for name, spec in chain if spec.type != "weld"]
        rooted = not chain or chain[0][1].type == "weld" or chain[0][0] in names
        if rooted and wanted and names.issuperset(wanted):
            poses[body] = _placed(body, chain, mine, scene)
    return {body: placed for body, placed in poses.items() if len(placed.t)}, ""


def _chain(body: str, above: Mapping[str, tuple[str, Any]]) -> list[tuple[str, Any]]:
    """Joints and welds from the world to a body; empty if it hangs on a free body."""
    chain: list[tuple[str, Any]] = []
    at: str | None = body
    while at is not None and at in above:
        chain.insert(0, above[at])
        at = getattr(above[at][1], "parent", None)
    # the pose of a free body is unknown
    return [] if at is not None else chain


def _placed(
    body: str, chain: list[tuple[str, Any]], mine: dict[str, tuple[Array, Array]], scene: Scene
) -> Poses:
    series = [mine[name] for name, spec in chain if spec.type != "weld"]
    first, last = max(t[0] for t, _ in series), min(t[-1] for t, _ in series)
    t = series[0][0]
    t = t[(t >= first) & (t <= last)]
    # displacement of a world point by the joints so far: rotation, then translation
    turn, shift = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)), np.zeros((len(t), 3))
    for name, spec in chain:
        if spec.type == "weld":
            continue
        value = linear(t, *mine[name])
        if slides(spec):
            shift = shift + rotate(turn, value * np.array(spec.guide.direction))
            continue
        p, q = _start(scene, spec.body)
        point = p + rotate(q, np.array(spec.point_B))
        swing = from_rotation_vector(value * rotate(q, np.array(spec.axis_B)))
        shift = shift + rotate(turn, point - rotate(swing, point))
        turn = product(turn, swing)
    p, q = _start(scene, body)
    return Poses(t, shift + rotate(turn, p), product(turn, q))


def _start(scene: Scene, body: str) -> tuple[Array, Array]:
    """Position and orientation of a body in the scene file."""
    spec = scene.bodies[body]
    return np.array(spec.position, dtype=float), np.array(spec.orientation, dtype=float)


# Reference magnitudes of the quantities of two motions, and the rounding of their differences.


ROUNDING = 1e-11
"""Upper bound of relative rounding differences between two runs of the same motion."""


UNITS = {"position": "m", "angle": "rad", "velocity": "m/s", "spin": "rad/s",
         "force": "N", "torque": "N m"}  # fmt: skip
"""Units of the quantities of two motions that are compared."""


def length_of(bodies: Iterable[Any]) -> float:
    """Largest distance of a point of a scene's bodies from its body's origin [m]."""
    return max((hypot(*body.center_of_mass) + reach_of(body) for body in bodies), default=0.0)


def floors(a: Tracks, b: Tracks) -> dict[str, float]:
    """Difference below which two motions count as equal, by quantity."""
    tracks = [*a.bodies.values(), *b.bodies.values()]
    covered = _largest(np.ptp(track.position, axis=0) for track in tracks)
    length = max(a.length, b.length, covered if covered > ROUNDING else 0.0) or 1.0
    wrenches = [w.values for w in (*a.reactions.values(), *b.reactions.values())]
    sizes = {
        "position": length,
        "angle": 1.0,
        "speed": _largest(_present(track.linear_velocity for track in tracks)),
        "spin": _largest(_present(track.angular_velocity for track in tracks)),
        "force": _largest(w[:, :3] for w in wrenches),
        "torque": _largest(w[:, 3:] for w in wrenches),
    }
    found = related(sizes, length)
    return {q: ROUNDING * found["speed" if q == "velocity" else q] for q in UNITS}


def _present(values: Iterable[np.ndarray | None]) -> Iterable[np.ndarray]:
    return (value for value in values if value is not None)


def _largest(values: Iterable[np.ndarray]) -> float:
    """Largest absolute finite value; 0 if there is none."""
    finite = (np.abs(value[np.isfinite(value)]) for value in values)
    return max((float(value.max(initial=0.0)) for value in finite), default=0.0)


# Bodies affected by an impact in an rb_sim run: all that constraints connect to its body.


class Impacts:
    """Groups of bodies connected by constraints, to find the bodies that an impact affects."""

    def __init__(self, scene: Scene) -> None:
        index = {name: i for i, name in enumerate(scene.bodies)}
        specs: dict[str, Any] = dict(scene.constraints)
        self._of = {name: index[spec.body] for name, spec in specs.items()}
        parents = {name: getattr(spec, "parent", None) for name, spec in specs.items()}
        joints = {(self._of[name], index[p]) for name, p in parents.items() if p is not None}
        group = held_together(joints)
        self._group = {name: group.get(i, i) for name, i in index.items()}
        self._of = {name: group.get(i, i) for name, i in self._of.items()}

    def times(self, events: Iterable[ContactEvent]) -> dict[str, np.ndarray]:
        """Impact times of each affected body [s]."""
        struck = [(self._of[e.contact.partition("/")[0]], e.t) for e in events if any(e.impulse)]
        found = {name: {t for of, t in struck if of == g} for name, g in self._group.items()}
        return {body: np.array(sorted(times)) for body, times in found.items() if times}


Array = np.ndarray


@dataclass
class Track:
    """Motion of one body: pose and velocities of its frame's origin, world axes, over time."""

    t: Array
    """increasing [s], shape (n,)."""
    position: Array
    """shape (n, 3) [m]."""
    orientation: Array
    """[x, y, z, w], body to world, unit, shape (n, 4)."""
    linear_velocity: Array | None = None
    """of the origin, world axes [m/s], shape (n, 3)."""
    angular_velocity: Array | None = None
    """world axes [rad/s], shape (n, 3)."""
    anew: tuple[int, ...] = ()
    """indices of samples after a discontinuity: a reset, a set state, or an impact."""
    frame: str = ""
    """reference frame of the poses, and child frame; "" if unknown."""
    child: str = ""


class Wrenches(NamedTuple):
    """A reaction, or any foreign wrench, over time."""

    t: Array
    """increasing [s], shape (n,)."""
    values: Array
    """force [N] and torque [N m], shape (n, 6), in world axes or those of `frame`."""
    anew: tuple[int, ...] = ()
    """as in Track."""
    frame: str = ""
    """frame of foreign messages."""


@dataclass
class Tracks:
    """Motions and wrenches read from one source."""

    name: str
    bodies: dict[str, Track]
    reactions: dict[str, Wrenches] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    length: float = 0.0
    """largest distance of a body's points from its origin [m]; 0 without a scene."""
    composed: dict[str, str] = field(default_factory=dict)
    """composed source (poses in the root of the transforms) by original source."""
    fixed: FixedFrames = field(default_factory=FixedFrames)
    """the static transforms."""

    def pairs_for(self, bodies: Iterable[str]) -> tuple[dict[str, str], dict[str, list[str]]]:
        """Name of the poses of each body, by topic or frame, or because there is only one of each;
        and, for bodies with several differing candidates, their names."""
        pairs: dict[str, str] = {}
        several: dict[str, list[str]] = {}
        wanted = list(bodies)
        for body in wanted:
            found = self._named(body)
            first = next((n for n in found if self.bodies[n].linear_velocity is not None), None)
            if found and all(_same(self.bodies[found[0]], self.bodies[n]) for n in found[1:]):
                pairs[body] = first or found[0]
            elif found:
                several[body] = found
        counts = Counter(pairs.values())
        for body, name in list(pairs.items()):
            if counts[name] > 1:  # a topic that matches two bodies is ambiguous
                several[body] = [pairs.pop(body)]
        outer = [name for name in self.bodies if name not in self.composed]
        if not (pairs or several) and len(wanted) == len(outer) == 1:
            pairs = {wanted[0]: outer[0]}
        return pairs, several

    def _named(self, body: str) -> list[str]:
        """Candidate poses for a body: of that name; else with that child frame, or (without a
        frame) with the name in the topic; else with the name anywhere in topic or frame."""
        child = {name: track.child for name, track in self.bodies.items()}
        found = [name for name in child if name == body]
        found = found or [
            n for n, of in child.items() if of == body or (not of and body in words(n))
        ]
        found = found or [name for name in child if body in words(name)]
        return [name for name in found if self.composed.get(name) not in found]


def tracks_of_bag(bag: Path, scene: Scene | None = None) -> Tracks:
    """The motions in a bag.

    scene: used for foreign bags, to place bodies without poses by joint states. Raises SinkError if
    the bag has no poses."""
    reader = reader_of(bag, unfinished=True)
    if reader is None:
        return _of_anybody(bag, scene)
    return tracks_of_blocks(reader.blocks(), reader.scene, reader.layout, str(bag), reader)


def tracks_of_blocks(blocks, scene, layout, name: str, reader: BagReader | None = None) -> Tracks:
    """The motions in samples; `reader` reports what was missing in them."""

    block = concatenate(blocks, layout)
    if not len(block):
        raise SinkError(f"{name}: no whole sample in it")
    motion = origins(block, centers_of_mass(scene.bodies, layout.bodies))
    kept = forward(block.t)
    begun = tuple(int(kept[:k].sum()) for k, _ in restarts(block.inputs) if k)
    impacts = Impacts(scene if reader is None else scene_as_run(reader)) if block.events else None
    struck = {} if impacts is None else impacts.times(block.events)
    anew = {
        body: begun + _beside(block.t[kept], struck.get(body, np.empty(0)))
        for body in layout.bodies
    }
    bodies = {
        body: Track(
            block.t[kept],
            motion.position[kept, i],
            unit(block.orientation[kept, i]),
            motion.linear_velocity[kept, i],
            motion.angular_velocity[kept, i],
            anew[body],
        )
        for i, body in enumerate(layout.bodies)
    }
    wrenches = np.concatenate([block.reaction_force, block.reaction_torque], axis=2)
    reactions = {
        n: Wrenches(block.t[kept], wrenches[kept, k], anew[body])
        for k, (n, body) in enumerate(zip(layout.reactions, layout.reaction_bodies, strict=True))
    }
    notes = [] if reader is None else reader.left_out
    return Tracks(name, bodies, reactions, notes, length_of(scene.bodies.values()))


def _beside(t: Array, struck: Array) -> tuple[int, ...]:
    """Indices of the samples at and just after the impact times `struck`."""
    cuts = np.searchsorted(t, [struck - WRITTEN_ROUNDING, struck + WRITTEN_ROUNDING]).ravel()
    return tuple(sorted({k for k in cuts.tolist() if 0 < k < len(t)}))


def _of_anybody(bag: Path, scene: Scene | None) -> Tracks:
    readings = Readings(bag, joints=scene is not None)
    found: dict[str, dict[str, list[Piece]]] = {kind: {} for kind in (POSE, TWIST, WRENCH, JOINT)}
    for piece in readings.pieces():
        if piece.kind in found:
            name = piece.child if piece.kind == JOINT else piece.source
            found[piece.kind].setdefault(name, []).append(piece)
    bodies = {name: _track(parts) for name, parts in found[POSE].items()}
    placed, unmatched = {}, ""
    if scene is not None:
        moved = {name: _joined(parts) for name, parts in found[JOINT].items()}
        placed, unmatched = joint_poses(moved, scene)
    named = {part for name, track in bodies.items() for part in (track.child, *words(name))}
    of_joints = {body: Track(t, p, q) for body, (t, p, q) in placed.items() if body not in named}
    if not (bodies or of_joints):
        none = "no pose in it (PoseStamped, Odometry or TF)"
        others = sorted(set(readings.other_topics.values()))
        none += f"; other types in it: {first_few(others)}" if others else ""
        none = f"{none}, and {unmatched}" if unmatched else none
        why = "; ".join([none, *readings.notes[:MOST_NAMED]])
        raise SinkError(f"{bag}: {why}")
    reactions = {
        name: Wrenches(*_joined(parts), frame=plain(parts[0].frame))
        for name, parts in found[WRENCH].items()
    }
    notes = [unmatched] if unmatched else []
    for name, track in bodies.items():
        if count := sum(len(part.t) for part in found[POSE][name]) - len(track.t):
            notes.append(f"{name}: {count} poses skipped: stamps do not increase")
    for parts in found[TWIST].values():
        notes += _add_twist(bodies, found[POSE], parts)
    return Tracks(
        str(bag), bodies | of_joints, reactions, [*readings.notes, *notes],
        composed={inner: name for inner, name in readings.composed.items() if name in bodies},
        fixed=readings.fixed,
    )  # fmt: skip


def _joined(parts: list[Piece]) -> tuple[Array, Array]:
    return joined((part.t for part in parts), (part.values for part in parts))


def _track(parts: list[Piece]) -> Track:
    t, values = _joined(parts)
    frame, child = plain(parts[0].frame), plain(parts[0].child)
    return Track(t, values[:, :3], unit(values[:, 3:7]), frame=frame, child=child)


def _add_twist(
    bodies: dict[str, Track], poses: dict[str, list[Piece]], parts: list[Piece]
) -> list[str]:
    """Assign a twist to the poses of its body, converted from the axes of its frame (that of the
    poses, or of the body as in an Odometry). Returns a line if that is not possible."""
    source, (t, twist) = parts[0].source, _joined(parts)
    names = [name for name in poses_of(source, bodies) if np.array_equal(t, bodies[name].t)]
    if len(names) != 1:
        line = f"{source}: may belong to any of {', '.join(names)}; not used"
        return [line] if names else []
    track, pose = bodies[names[0]], poses[names[0]][0]
    v, w, axes = twist[:, :3], twist[:, 3:], axes_of(parts[0], pose)
    if not axes:
        return [
            f"{source}: its frame {plain(parts[0].frame)} is neither that of the poses, "
            f"{plain(pose.frame)}, nor the body's: not used"
        ]
    if axes == "body":
        v, w = rotate(track.orientation, v), rotate(track.orientation, w)
    track.linear_velocity, track.angular_velocity = v, w
    return []


def poses_of(twist: str, names: Iterable[str]) -> list[str]:
    """Candidate poses of a twist: those of its own message; else all in the folder of its topic."""
    own, known = twist.removesuffix(":twist"), list(names)
    folder = own.rpartition("/")[0]
    return [own] if own in known else [n for n in known if n.rpartition("/")[0] == folder]


def axes_of(twist: Piece, pose: Piece) -> str:
    """Axes of a twist: "body", "world" (those of the poses), or "" if unknown."""
    frame = plain(twist.frame)
    if twist.source.endswith(":twist") or frame in {plain(pose.child), *words(pose.source)} - {""}:
        return "body"
    return "world" if frame in ("", plain(pose.frame)) else ""


def tracks_of_csv(path: Path) -> Tracks:
    """Poses in a text file: columns t, x, y, z, qx, qy, qz, qw (and vx, vy, vz, wx, wy, wz, body)
    by the names in its header, or in this order without a header (TUM format).

    A header may start with # and state units, as in EuRoC files: p_RS_R_x [m], q_RS_w []. Without a
    unit, that of the times is guessed from their values. Raises RbSimError.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise RbSimError(f"{path}: {reason}") from None
    lines = [line for line in text.splitlines() if line.strip()]
    header = next((h for line in lines if line.startswith("#") and (h := _header(line))), None)
    rows = [line for line in lines if not line.startswith("#")]
    if rows and any(map(OWN.fullmatch, _cells(rows[0]))):
        raise RbSimError(
            f"{path}: a table of Trajectory.to_csv has positions of centres of mass, not of the "
            "poses in bags; compare the bag or the scene of its run"
        )
    if rows and not _is_number(_cells(rows[0])[0]):
        header, rows = _columns(rows[0]), rows[1:]
    if not rows:
        raise RbSimError(f"{path}: no line with numbers in it")
    names, bodies, table, units = _table(header, rows, path)
    t, notes = _in_seconds(table[:, 0], units["t"])
    if units["x"] in _METRES:
        table[:, 1:4] *= _METRES[units["x"]]
        notes.append(f"positions are in {units['x']}, as its header says")
    tracks = {}
    for body in dict.fromkeys(bodies):
        own = np.array([name == body for name in bodies])
        part, times = table[own], t[own]
        kept = forward(times)
        if lost := int((~kept).sum()):
            notes.append(f"{lost} lines of {body} skipped: their times do not increase")
        part = part[kept]
        v, w = (part[:, names.index(n) : names.index(n) + 3] if n in names else None
                for n in ("vx", "wx"))  # fmt: skip
        tracks[body] = Track(times[kept], part[:, 1:4], unit(part[:, 4:8]), v, w)
    return Tracks(str(path), tracks, notes=[f"{path}: {note}" for note in notes])


OWN = re.compile(r"position\..+\.x")
"""Column name of a position in a table of `Trajectory.to_csv`."""
COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz")
NANOSECONDS = "nanosec"
"""Column that is added to the seconds in t."""
_MEANS = (
    (re.compile(r"t|time.*|stamp.*|sec(?:onds)?"), "t"),
    (re.compile(r"(?:.*\.)?(?:p|pos|position|translation|t)?(?:_[a-z]+)*[_.]?([xyz])"), ""),
    (
        re.compile(r"(?:.*\.)?(?:q|quat|quaternion|orientation|rotation)(?:_[a-z]+)*[_.]?([wxyz])"),
        "q",
    ),
    (re.compile(r"(?:v|vel|velocity|linear_velocity)(?:_[a-z]+)*[_.]?([xyz])"), "v"),
    (re.compile(r"(?:w|omega|angular_velocity)[_.]?([xyz])"), "w"),
    (re.compile("body"), "body"),
    (re.compile("nano_?sec(?:onds)?|nsec"), NANOSECONDS),
)
"""Patterns of lower-case column names, and the column of COLUMNS (a group is its component)."""
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "\u00b5s": 1e-6, "ns": 1e-9}
_METRES = {"mm": 1e-3, "cm": 1e-2}
_TODAY = 1e8, 1e10
"""Range of calendar times [s]: years 1973 to 2286."""
_RATE = 100.0
"""[Hz]: for times that start at 0, the unit is chosen whose sample rate is nearest to this."""
_LONG_STEP = 1.5
"""Step between samples above which the unit cannot be seconds."""


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in (line.split(",") if "," in line else line.split())]


def _header(line: str) -> list[tuple[str, str]] | None:
    """`_columns` of a line with column names; None for a comment."""
    found = _columns(line)
    given = {name for name, _ in found}
    return found if {"x", "y", "z"} <= given or {"t", "x"} <= given else None


def _columns(line: str) -> list[tuple[str, str]]:
    """(column, unit) of each cell of a header; "" if unknown."""
    found = []
    for cell in _cells(line.lstrip("# ")):
        name, _, unit = cell.replace("(", "[").lower().partition("[")
        name = name.strip()
        known = ((means, m) for pattern, means in _MEANS if (m := pattern.fullmatch(name)))
        means, match = next(known, ("", None))
        own = means + (match[1] if match and match.groups() else "")
        if own == "t" and name.rpartition("_")[2] in _SECONDS:  # stamp_ms
            unit = name.rpartition("_")[2]
        found.append((own if match else "", unit.strip(" ])")))
    return found


def _in_seconds(t: Array, unit: str) -> tuple[Array, list[str]]:
    """Times [s], and a note if the file's unit is another one."""
    if unit in _SECONDS:
        note = [f"times are in {unit}, as its header says"]
        return t * _SECONDS[unit], note if _SECONDS[unit] != 1.0 else []
    steps = np.diff(t)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    units = {name: _SECONDS[name] for name in ("ns", "us", "ms")}
    name = next((n for n, x in units.items() if _TODAY[0] <= t[0] * x <= _TODAY[1] < t[0]), "")
    calendar = _TODAY[0] <= t[0] <= _TODAY[1] and step < 1.0 / units["ms"]
    if not name and step > _LONG_STEP and not calendar:
        name = min(units, key=lambda n: abs(np.log(step * units[n] * _RATE)))
    if not name:
        return t, []
    return t * units[name], [f"times are taken as {name}, by their steps of {step:g}; name their "
                             "unit in the header, as `t [s]`, if it is another one"]  # fmt: skip


def _table(
    header: list[tuple[str, str]] | None, rows: list[str], path: Path
) -> tuple[list[str], list[str], Array, dict[str, str]]:
    """Names of the columns, body of each row, numbers, and unit by column."""
    cells = [_cells(row) for row in rows]
    given = [(name, "") for name in COLUMNS[: len(cells[0])]] if header is None else header
    found = [name for name, _ in given]
    missing = [name for name in COLUMNS[:8] if name not in found]
    if missing:
        raise RbSimError(
            f"{path}: no column {', '.join(missing)}; must be {', '.join(COLUMNS[:8])}"
        )
    names = [name for name in COLUMNS if name in found]
    index = [found.index(name) for name in names]
    body = found.index("body") if "body" in found else None
    try:
        table = np.array([[float(row[i]) for i in index] for row in cells])
        if NANOSECONDS in found:
            table[:, 0] += [1e-9 * float(row[found.index(NANOSECONDS)]) for row in cells]
        bodies = [row[body] if body is not None else path.stem for row in cells]
    except (ValueError, IndexError):
        raise RbSimError(f"{path}: a line is not {len(found)} numbers") from None
    if not np.isfinite(table).all():
        raise RbSimError(f"{path}: a number is not finite")
    return names, bodies, table, dict(reversed(given))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _same(one: Track, other: Track) -> bool:
    """Whether two tracks agree at common instants, which must be half of the shorter one."""
    _, i, j = np.intersect1d(one.t, other.t, return_indices=True)
    if 2 * len(i) < min(len(one.t), len(other.t)):
        return False
    p, q = one.position[i], one.orientation[i]
    near = np.abs(p - other.position[j]).max() <= WRITTEN_ROUNDING * max(1.0, np.abs(p).max())
    return bool(
        near
        and np.abs(np.abs(np.sum(q * other.orientation[j], axis=1)) - 1).max() <= WRITTEN_ROUNDING
    )
