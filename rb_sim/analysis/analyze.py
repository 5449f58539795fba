"""Everything that a bag tells, in one pass over it and in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.analysis.anybody import Anybody
from rb_sim.analysis.bodies import BodyFigures
from rb_sim.analysis.derivatives import Body
from rb_sim.analysis.figures import COLUMNS, Figures
from rb_sim.analysis.masses import bodies_of
from rb_sim.analysis.sizes import sizes_beside, sizes_of
from rb_sim.analysis.struck import Struck
from rb_sim.analysis.table import Aligned
from rb_sim.bags.piece import POSE, SCALAR, TWIST, WRENCH
from rb_sim.bags.readings import Readings
from rb_sim.bags.scales import length_of
from rb_sim.errors import SinkError
from rb_sim.sinks.bag_reader import BagReader
from rb_sim.sinks.frames import centers_of_mass, origins

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock
    from rb_sim.scene.schema import Scene

FEW, SHUFFLED = 3, 0.01
"""Steps back, and how many of a source's readings they are, from which on its messages lie in no
order: a clock is not set so often."""


@dataclass
class Analysis:
    """What was found; `figures` and `bodies` also give curves and spectra to draw."""

    name: str
    figures: dict[str, Figures] = field(default_factory=dict)
    bodies: dict[str, BodyFigures] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    balance: dict[str, Any] | None = None
    """of a run of ours."""
    balances: dict[str, dict[str, Any]] = field(default_factory=dict)
    """of somebody else's poses, by what they are of."""
    constraints: dict[str, Any] | None = None
    """errors of the constraints, recomputed from the poses."""
    contacts: dict[str, Any] | None = None
    other_topics: dict[str, str] = field(default_factory=dict)
    length: float = 0.0
    """how far the scene's bodies reach from their origins [m]; 0 where no scene is known."""
    bytes: int = 0
    messages: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        sizes = sizes_of(self.figures.items(), self.length)
        return {
            "bag": self.name,
            "notes": self.notes,
            "sources": {
                name: {
                    "kind": self.kinds[name],
                    **figures.as_dict(sizes_beside(name, figures, sizes)),
                }
                for name, figures in self.figures.items()
            },
            "bodies": {name: body.as_dict() for name, body in self.bodies.items()},
            "balance": self.balance,
            "balances": self.balances,
            "constraints": self.constraints,
            "contacts": self.contacts,
            "other_topics": self.other_topics,
        }


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
    try:
        reader = BagReader(bag, unfinished=True)
    except SinkError as error:
        if "not recorded by rb_sim" not in str(error):
            raise
        reader = None
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
        raise SinkError(f"{bag}: nothing to analyze in it: {'; '.join(filter(None, parts))}")
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
    from rb_sim.analysis.constraints import ConstraintFigures
    from rb_sim.analysis.laws import SceneLaws
    from rb_sim.analysis.loads import Loads
    from rb_sim.analysis.stretches import Balances, parts_of
    from rb_sim.bags.impacts import Impacts
    from rb_sim.sinks.as_run import scene_as_run

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
    found.notes += reader.left_out
    if any(missing.within for missing in reader.missing):
        found.notes.append("the balances go across what is missing: they are off by what it did")
    found.balance = balances.finish()
    found.notes += loads.notes + balances.notes
    found.contacts = balances.contacts
    found.constraints = None if constraints is None else constraints.as_dict()


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
