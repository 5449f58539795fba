"""Everything that a bag tells, in one pass over it and in bounded memory."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rb_sim.bags.analysis.anybody import Anybody
from rb_sim.bags.analysis.bodies import BodyFigures, Struck
from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.figures import COLUMNS, Figures
from rb_sim.bags.analysis.masses import bodies_of
from rb_sim.bags.analysis.result import Analysis
from rb_sim.bags.analysis.table import Aligned
from rb_sim.bags.readings import Readings
from rb_sim.bags.sources import POSE, SCALAR, TWIST, WRENCH
from rb_sim.bags.tracks import Impacts, length_of
from rb_sim.base.errors import SinkError
from rb_sim.io.bag.reader import BagReader, reader_of
from rb_sim.io.frames import centers_of_mass, origins, rotate
from rb_sim.mechanics.samples import SampleBlock, SampleLayout
from rb_sim.scene.schema import Scene

# The wrenches that a bag of ours tells for each body, as one about its centre of mass.


TOLD = ("gravity", "commanded_wrench")
"""Effects whose force follows from the samples."""


class Loads:
    """Adds up reactions (on the body and, opposite, on its parent), commands and uniform gravity.

    notes: effects whose wrench is not among the samples; what a motion takes differs by it.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._layout = layout
        self._offsets = centers_of_mass(scene.bodies, layout.bodies)
        self._weights = np.zeros((len(layout.bodies), 3))
        untold = []
        for name, effect in scene.effects.items():
            kind = effect.type  # type: ignore[attr-defined]
            if kind == "gravity":
                for body in effect.bodies or layout.bodies:  # type: ignore[attr-defined]
                    g = np.array(effect.acceleration)  # type: ignore[attr-defined]
                    self._weights[layout.bodies.index(body)] += scene.bodies[body].mass * g
            elif kind not in TOLD:
                untold.append(f"{name} ({kind})")
        self._parents = [self._parent(scene, name) for name in layout.reactions]
        # a bearing's share is in the total of its constraint, which has an entry of its own
        self._counted = ["/" not in name for name in layout.reactions]
        text = "the samples do not contain the wrench of " + ", ".join(untold)
        self.notes = [f"{text}; the recorded total does not include it"] if untold else []

    def _parent(self, scene: Scene, reaction: str) -> int | None:
        spec = scene.constraints.get(reaction.partition("/")[0])
        parent = getattr(spec, "parent", None)
        return None if parent is None else self._layout.bodies.index(parent)

    def totals(self, block: SampleBlock) -> np.ndarray:
        """Force and torque about C, world axes, shape (n, N, 6)."""
        n, bodies = len(block), self._layout.bodies
        total = np.zeros((n, len(bodies), 6))
        total[:, :, :3] = self._weights
        for k, body in enumerate(self._layout.reaction_bodies):
            if not self._counted[k]:
                continue
            force, torque = block.reaction_force[:, k], block.reaction_torque[:, k]
            for i, sign in ((bodies.index(body), 1.0), (self._parents[k], -1.0)):
                if i is not None:
                    arm = block.anchor[:, k] - block.position[:, i]
                    total[:, i, :3] += sign * force
                    total[:, i, 3:] += sign * (torque + np.cross(arm, force))
        for m, body in enumerate(self._layout.commanded):
            i = bodies.index(body)
            arm = -rotate(block.orientation[:, i], self._offsets[i])
            force, torque = block.command[:, m, :3], block.command[:, m, 3:]
            total[:, i, :3] += force
            total[:, i, 3:] += torque + np.cross(arm, force)
        return total


FEW, SHUFFLED = 3, 0.01
"""Steps back, and how many of a source's readings they are, from which on its messages lie in no
order: a clock is not set so often."""


def analyze(
    bag: Path,
    *,
    topics: frozenset[str] | None = None,
    masses: dict[str, Body] | None = None,
    scene: Scene | None = None,
    table: Aligned | None = None,
) -> Analysis:
    """Read a bag, ours or anybody's. masses: by body, child frame, or topic; else those of the bag.

    scene: that of the poses, for its constraints and effects, and for masses where none are given.
    table: gets the aligned samples. Raises SinkError for what is no bag, or has no readings.
    """
    reader = reader_of(bag, unfinished=True)
    found = Analysis(str(bag))
    if reader is None or topics is not None:
        if masses is None and scene is not None:
            masses = bodies_of(scene)
        readings = Readings(bag, topics, frozenset(masses or ()))
        anybody = Anybody(found, masses or {}, scene, readings)
        _anybody(found, readings, anybody, table)
    else:
        _ours(found, reader, table)
    if not found.figures:
        kinds = ", ".join(sorted(set(found.other_topics.values())))
        none = "" if found.messages else "no message"
        why = f"its topics are of other types ({kinds})" if kinds else none
        parts = [why, *found.notes[:3]]
        raise SinkError(f"{bag}: nothing to analyze: {'; '.join(filter(None, parts))}")
    return found


def _anybody(found: Analysis, readings: Readings, anybody: Anybody, table: Aligned | None) -> None:
    start: int | None = None
    for piece in readings.pieces():
        if start is None:
            start = round(float(piece.log[0]) * 1e9)
            # stamps may count from the epoch and log times from 0, or the other way round
            first = int(piece.stamp[0])
            start = first if abs(first - start) > 1e15 else min(first, start)
        t = (piece.stamp - start) * 1e-9
        columns = COLUMNS[piece.kind]
        found.figures.setdefault(piece.source, Figures(columns)).add(t, piece.values)
        found.kinds[piece.source] = piece.kind
        anybody.add(piece, t)
        if table is not None:
            table.add(piece.source, columns, t, piece.values)
    found.notes += readings.notes
    found.other_topics = readings.other_topics
    found.bytes, found.messages = readings.bytes, readings.messages
    for name, figures in found.figures.items():
        back = figures.rates.backwards
        if back:
            found.notes.append(f"{name}: time goes back {back} times{_why(back, figures)}")
    _finish(found)
    anybody.finish()


def _why(back: int, figures: Figures) -> str:
    """What a reader can do where it is no clock that was set now and then."""
    if back < max(FEW, SHUFFLED * figures.rates.count):
        return ""
    return ": its messages do not lie in the order of their times; sort the bag first (`mcap sort`)"


def _ours(found: Analysis, reader: BagReader, table: Aligned | None) -> None:
    from rb_sim.bags.analysis.scene_laws import ConstraintFigures, SceneLaws
    from rb_sim.bags.analysis.stretches import Balances, parts_of
    from rb_sim.io.bag.as_run import scene_as_run

    scene = scene_as_run(reader)
    balances, loads = Balances(scene, reader.layout), Loads(scene, reader.layout)
    impacts = Impacts(scene)
    offsets = centers_of_mass(scene.bodies, reader.layout.bodies)
    found.length = length_of(scene.bodies.values())
    for name, properties in bodies_of(scene).items():
        found.bodies[name] = BodyFigures(properties, struck=Struck(told=True))
    laws = SceneLaws(scene) if scene.constraints else None
    constraints = None if laws is None else ConstraintFigures(laws)
    for part in parts_of(reader):
        block = part.block
        if part.anew:
            for figures in found.figures.values():
                figures.begin_anew()
        balances.add(part)
        if laws is not None and constraints is not None:
            constraints.add(block.t, laws.at(block.t - part.since, coordinates(block)))
        motion = origins(block, offsets)
        totals = loads.totals(block)
        for name, times in impacts.times(block.events).items():
            found.bodies[name].struck(times)
        for i, name in enumerate(reader.layout.bodies):
            pose = np.hstack([motion.position[:, i], block.orientation[:, i]])
            if part.anew:
                found.bodies[name].finish()
            found.bodies[name].add(block.t, pose, totals[:, i])
            twist = np.hstack([motion.linear_velocity[:, i], motion.angular_velocity[:, i]])
            _add(found, table, f"{name}/pose", POSE, block.t, pose)
            _add(found, table, f"{name}/twist", TWIST, block.t, twist)
        for k, name in enumerate(reader.layout.reactions):
            wrench = np.hstack([block.reaction_force[:, k], block.reaction_torque[:, k]])
            _add(found, table, f"reactions/{name}", WRENCH, block.t, wrench)
        for k, name in enumerate(reader.layout.commanded):
            _add(found, table, f"{name}/wrench_applied", WRENCH, block.t, block.command[:, k])
        for name in ("energy", "power", "residual"):
            _add(found, table, name, SCALAR, block.t, getattr(block, name)[:, None])
    _finish(found)
    found.title = f"{scene.name}: {scene.description}" if scene.description else scene.name
    found.facts = _facts(reader)
    found.notes += reader.left_out
    if any(missing.within for missing in reader.missing):
        found.notes.append("balances span the missing messages and contain their effect")
    found.balance = balances.finish()
    found.notes += loads.notes + balances.notes
    found.contacts = balances.contacts
    found.constraints = None if constraints is None else constraints.as_dict()


def _facts(reader: BagReader) -> list[str]:
    """How, when and with what a run was made."""
    options = json.loads(reader.record["simulation"])
    knob = [f"{key} {options[key]:g}" for key in ("step", "tolerance") if options.get(key)]
    versions = json.loads(reader.record.get("versions", "{}"))
    written = datetime.fromtimestamp(reader.path.stat().st_mtime, UTC)
    return [
        f"run of {options['duration']:g} s with {' and '.join([options['method'], *knob])}",
        f"file of {written:%d %b %Y %H:%M} UTC",
        ", ".join(f"{name} {version}" for name, version in versions.items()),
    ]


def _finish(found: Analysis) -> None:
    """No more poses come; says where they were too few."""
    for name, body in found.bodies.items():
        body.finish()
        found.notes += [f"{name}: {line}" for line in body.notes]


def coordinates(block: SampleBlock) -> np.ndarray:
    """p_WC, q_WB, v_WC, w_WB_B of each body in turn, shape (n, 13 N)."""
    q = block.orientation / np.linalg.norm(block.orientation, axis=-1, keepdims=True)
    parts = [block.position, q, block.linear_velocity, block.angular_velocity]
    return np.concatenate(parts, axis=2).reshape(len(block), -1)


def _add(
    found: Analysis, table: Aligned | None, name: str, kind: str, t: np.ndarray, values: np.ndarray
) -> None:
    found.kinds[name] = kind
    found.figures.setdefault(name, Figures(COLUMNS[kind])).add(t, values)
    if table is not None:
        table.add(name, COLUMNS[kind], t, values)
