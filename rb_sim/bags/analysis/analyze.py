"""Everything that a bag tells, in one pass over it and in bounded memory."""

from __future__ import annotations

from pathlib import Path

from rb_sim.bags.analysis.anybody import Anybody
from rb_sim.bags.analysis.bodies import bodies_of
from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.figures import COLUMNS
from rb_sim.bags.analysis.result import Aligned, Analysis
from rb_sim.bags.analysis.run import RecordedRun
from rb_sim.bags.readings import Readings
from rb_sim.base.errors import SinkError
from rb_sim.io.bag.reader import reader_of
from rb_sim.scene.schema import Scene


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
    source: RecordedRun | Anybody
    if reader is not None and topics is None:
        source = RecordedRun(found, reader)
    else:
        if masses is None and scene is not None:
            masses = bodies_of(scene)
        readings = Readings(bag, topics, frozenset(masses or ()))
        source = Anybody(found, masses or {}, scene, readings)
    for name, kind, t, values in source.readings():
        found.add(name, kind, t, values)
        if table is not None:
            table.add(name, COLUMNS[kind], t, values)
    for name, body in found.bodies.items():
        body.finish()
        found.notes += [f"{name}: {line}" for line in body.notes]
    source.finish()
    if not found.figures:
        kinds = ", ".join(sorted(set(found.other_topics.values())))
        none = "" if found.messages else "no message"
        why = f"its topics are of other types ({kinds})" if kinds else none
        parts = [why, *found.notes[:3]]
        raise SinkError(f"{bag}: nothing to analyze: {'; '.join(filter(None, parts))}")
    return found
