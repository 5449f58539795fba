"""Everything that a bag tells, in one pass over it and in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.analysis.bodies import BodyFigures
from rb_sim.analysis.derivatives import Body
from rb_sim.analysis.figures import Figures
from rb_sim.analysis.table import Aligned
from rb_sim.bags.readings import IMU, POSE, SCALAR, TWIST, WRENCH, Readings
from rb_sim.errors import SinkError
from rb_sim.sinks.bag_reader import BagReader
from rb_sim.sinks.frames import centers_of_mass, origins

COLUMNS = {
    POSE: ("x", "y", "z", "qx", "qy", "qz", "qw"),
    TWIST: ("vx", "vy", "vz", "wx", "wy", "wz"),
    WRENCH: ("fx", "fy", "fz", "tx", "ty", "tz"),
    IMU: ("qx", "qy", "qz", "qw", "wx", "wy", "wz", "ax", "ay", "az"),
    SCALAR: ("value",),
}
UNITS = {"x": "m", "y": "m", "z": "m", "vx": "m/s", "vy": "m/s", "vz": "m/s", "wx": "rad/s",
         "wy": "rad/s", "wz": "rad/s", "fx": "N", "fy": "N", "fz": "N", "tx": "N m", "ty": "N m",
         "tz": "N m", "ax": "m/s^2", "ay": "m/s^2", "az": "m/s^2"}  # fmt: skip


@dataclass
class Analysis:
    """What was found; `figures` and `bodies` also give curves and spectra to draw."""

    name: str
    figures: dict[str, Figures] = field(default_factory=dict)
    bodies: dict[str, BodyFigures] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    balance: dict[str, Any] | None = None
    contacts: dict[str, Any] | None = None
    other_topics: dict[str, str] = field(default_factory=dict)
    bytes: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {
            "bag": self.name,
            "notes": self.notes,
            "sources": {
                name: {"kind": self.kinds[name], **figures.as_dict()}
                for name, figures in self.figures.items()
            },
            "bodies": {name: body.as_dict() for name, body in self.bodies.items()},
            "balance": self.balance,
            "contacts": self.contacts,
            "other_topics": self.other_topics,
        }


def analyze(
    bag: Path,
    *,
    topics: frozenset[str] | None = None,
    masses: dict[str, Body] | None = None,
    table: Aligned | None = None,
) -> Analysis:
    """Read a bag, ours or anybody's. masses: by body, child frame, or topic; else those of the bag.

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
        _anybody(found, Readings(bag, topics), masses or {}, table)
    else:
        _ours(found, reader, table)
    for body in found.bodies.values():
        body.finish()
    if not found.figures:
        kinds = ", ".join(sorted(set(found.other_topics.values()))) or "no message"
        why = "; ".join(found.notes[:3])
        raise SinkError(f"{bag}: nothing to analyze in it: {kinds}{': ' + why if why else ''}")
    return found


def _anybody(
    found: Analysis, readings: Readings, masses: dict[str, Body], table: Aligned | None
) -> None:
    start: float | None = None
    for piece in readings.pieces():
        if start is None:
            start = float(piece.log[0])
            # stamps may count from the epoch and log times from 0, or the other way round
            first = float(piece.t[0])
            start = first if abs(first - start) > 1e6 else min(first, start)
        t = piece.t - start
        columns = COLUMNS[piece.kind]
        figures = found.figures.setdefault(piece.source, Figures(columns))
        found.kinds[piece.source] = piece.kind
        figures.add(t, piece.values)
        if piece.kind == POSE:
            if piece.source not in found.bodies:
                found.bodies[piece.source] = BodyFigures(_mass(masses, piece.source, piece.child))
            found.bodies[piece.source].add(t, piece.values)
        if table is not None:
            table.add(piece.source, columns, t, piece.values)
    found.notes += readings.notes
    found.other_topics = readings.other_topics
    found.bytes = readings.bytes
    for name, figures in found.figures.items():
        back = figures.rates.backwards
        if back:
            found.notes.append(f"{name}: time goes back {back} times")


def _mass(masses: dict[str, Body], source: str, child: str) -> Body | None:
    parts = {source, child, *source.replace(":", "/").split("/")}
    named = [body for name, body in masses.items() if name in parts]
    return named[0] if named else next(iter(masses.values())) if len(masses) == 1 else None


def _ours(found: Analysis, reader: BagReader, table: Aligned | None) -> None:
    from rb_sim.analysis.loads import Loads
    from rb_sim.bags.as_run import scene_as_run
    from rb_sim.watches.balance import Ledger

    scene = scene_as_run(reader)
    ledger, loads = Ledger(scene, reader.layout), Loads(scene, reader.layout)
    offsets = centers_of_mass(scene.bodies, reader.layout.bodies)
    for name, body in scene.bodies.items():
        properties = Body(body.mass, np.array(body.inertia), np.array(body.center_of_mass))
        found.bodies[name] = BodyFigures(properties)
    for block in reader.blocks():
        ledger.add(block)
        motion = origins(block, offsets)
        totals = loads.totals(block)
        for i, name in enumerate(reader.layout.bodies):
            pose = np.hstack([motion.position[:, i], block.orientation[:, i]])
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
    found.notes += reader.damage
    found.notes += loads.notes
    found.balance = {"energy": ledger.energy(), "momentum": ledger.momentum()}
    found.contacts = ledger.contacts()


def _add(
    found: Analysis, table: Aligned | None, name: str, kind: str, t: np.ndarray, values: np.ndarray
) -> None:
    found.kinds[name] = kind
    found.figures.setdefault(name, Figures(COLUMNS[kind])).add(t, values)
    if table is not None:
        table.add(name, COLUMNS[kind], t, values)
