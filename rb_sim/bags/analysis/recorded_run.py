# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Analysis of an rb_sim bag: its samples, one stretch at a time, and the result as plain data.

Differentiation and balances never span a reset or a state that was set: no motion connects the
samples on either side.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.accuracy.checks.balance import Events, Ledger, is_known, wrenches_on_bodies
from rb_sim.bags.analysis.analysis_page import Aligned, Analysis
from rb_sim.bags.analysis.anybody import Anybody
from rb_sim.bags.analysis.bodies import BodyFigures, Struck, bodies_of
from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.figures import COLUMNS
from rb_sim.bags.analysis.scene_laws import ConstraintFigures, SceneLaws
from rb_sim.bags.readings import Readings
from rb_sim.bags.tracks import Impacts, length_of
from rb_sim.bags.transforms import POSE, SCALAR, TWIST, WRENCH
from rb_sim.base.errors import SinkError
from rb_sim.base.names import MOST_NAMED, first_few
from rb_sim.io.bag.reader import BagReader, reader_of, scene_as_run
from rb_sim.io.sink import stretches
from rb_sim.mechanics.samples import SampleBlock, SampleLayout, centers_of_mass, origins
from rb_sim.numerics.rotations import unit
from rb_sim.scene.schema import Scene

if TYPE_CHECKING:
    from rb_sim.bags.analysis.analysis_page import Analysis, Reading


class RecordedRun:
    """Readings of an rb_sim bag, by topic, and their analysis, which is stored in `found`."""

    def __init__(self, found: Analysis, reader: BagReader) -> None:
        self._found, self._reader = found, reader
        scene, layout = scene_as_run(reader), reader.layout
        self._scene, self._balances = scene, Balances(scene, layout)
        self._impacts = Impacts(scene)
        self._offsets = centers_of_mass(scene.bodies, layout.bodies)
        self._laws = SceneLaws(scene) if scene.constraints else None
        self._constraints = None if self._laws is None else ConstraintFigures(self._laws)
        found.length = length_of(scene.bodies.values())
        found.title = f"{scene.name}: {scene.description}" if scene.description else scene.name
        for name, properties in bodies_of(scene).items():
            found.bodies[name] = BodyFigures(properties, struck=Struck(by_events=True))

    def readings(self) -> Iterator[Reading]:
        """Yield all readings in one pass over the bag."""
        for part in parts_of(self._reader):
            if part.anew:
                self._found.begin_anew()
            self._balances.add(part)
            if self._laws is not None and self._constraints is not None:
                at = self._laws.at(part.block.t - part.since, coordinates(part.block))
                self._constraints.add(part.block.t, at)
            yield from self._readings(part.block)

    def _readings(self, block: SampleBlock) -> Iterator[Reading]:
        t, layout, found = block.t, self._reader.layout, self._found
        motion = origins(block, self._offsets)
        totals = wrenches_on_bodies(block, self._scene, layout)
        for name, times in self._impacts.times(block.events).items():
            found.bodies[name].struck(times)
        for i, name in enumerate(layout.bodies):
            pose = np.hstack([motion.position[:, i], block.orientation[:, i]])
            found.bodies[name].add(t, pose, totals[:, i])
            twist = np.hstack([motion.linear_velocity[:, i], motion.angular_velocity[:, i]])
            yield f"{name}/pose", POSE, t, pose
            yield f"{name}/twist", TWIST, t, twist
        for k, name in enumerate(layout.reactions):
            wrench = np.hstack([block.reaction_force[:, k], block.reaction_torque[:, k]])
            yield f"reactions/{name}", WRENCH, t, wrench
        for k, name in enumerate(layout.commanded):
            yield f"{name}/wrench_applied", WRENCH, t, block.command[:, k]
        for name in ("energy", "power", "residual"):
            yield name, SCALAR, t, getattr(block, name)[:, None]

    def finish(self) -> None:
        """Finish balances, contacts and constraints, after the last reading."""
        found, reader = self._found, self._reader
        found.facts = _facts(reader)
        found.notes += reader.left_out
        if any(missing.within for missing in reader.missing):
            found.notes.append("balances span the missing messages and contain their effect")
        found.balances[self._scene.name or "scene"] = self._balances.finish()
        found.notes += [*self._unknown, *self._balances.notes]
        found.contacts = self._balances.contacts
        found.constraints = None if self._constraints is None else self._constraints.as_dict()

    @property
    def _unknown(self) -> list[str]:
        """A line if effects exert a wrench that is not recorded."""
        effects = self._scene.effects.items()
        unknown = [f"{name} ({e.type})" for name, e in effects if not is_known(e)]  # type: ignore[attr-defined]
        text = f"the samples do not contain the wrench of {', '.join(unknown)}"
        return [f"{text}; the recorded total does not include it"] if unknown else []


def _facts(reader: BagReader) -> list[str]:
    """Lines about the run: method and duration, date of the file, versions."""
    options = json.loads(reader.record["simulation"])
    knob = [f"{key} {options[key]:g}" for key in ("step", "tolerance") if options.get(key)]
    versions = json.loads(reader.record.get("versions", "{}"))
    written = datetime.fromtimestamp(reader.path.stat().st_mtime, UTC)
    return [
        f"run of {options['duration']:g} s with {' and '.join([options['method'], *knob])}",
        f"file of {written:%d %b %Y %H:%M} UTC",
        ", ".join(f"{name} {version}" for name, version in versions.items()),
    ]


def coordinates(block: SampleBlock) -> np.ndarray:
    """p_WC, q_WB, v_WC, w_WB_B of each of N bodies in turn, shape (n, 13 N)."""
    q = unit(block.orientation)
    parts = [block.position, q, block.linear_velocity, block.angular_velocity]
    return np.concatenate(parts, axis=2).reshape(len(block), -1)


# Stretches between resets or set states, and their balances.


FEW = 4
"""Mean number of samples between changes of commands below which balances are inaccurate."""


class Part(NamedTuple):
    """A run of consecutive samples."""

    block: SampleBlock
    anew: bool
    """whether they start with a reset or a state that was set."""
    since: float
    """stamp at which the scene's own time, that of its laws, is zero [s]."""


def parts_of(reader: BagReader) -> Iterator[Part]:
    """Samples of a bag, split where a state was set or the run was reset."""
    node = reader.settings.get("by") == "node"
    period = 1.0 / reader.scene.simulation.rate if node else 0.0
    since, some = 0.0, False
    for block in reader.blocks():
        for part, given in stretches(block):
            if given is not None:
                # stamps of a node continue; a reset sets the scene's time to 0, a new state takes a
                # period
                since = since + period if given.state else given.t * node
            if len(part) or part.events:
                yield Part(part, given is not None and some, since)
            some = some or len(part) > 0


class Balances:
    """Energy and momentum balances summed over the stretches of a run; bounded memory."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._scene, self._layout = scene, layout
        self._ledger = Ledger(scene, layout)
        self._totals: dict[str, dict[str, Any]] = {}
        """balances of the stretches so far: energy, linear and angular momentum."""
        self._events, self._contact_work = Events(), 0.0
        self._anew: list[float] = []
        self._latest = -np.inf
        self._count = self._samples = self._changes = 0

    def add(self, part: Part) -> None:
        """Append samples."""
        if part.anew:
            self._close()
            self._ledger = Ledger(self._scene, self._layout, part.since)
            self._count += 1
            self._anew += part.block.t[: MOST_NAMED - len(self._anew)][:1].tolist()
        self._samples += len(part.block)
        self._events.add(part.block.events)
        self._ledger.add(part.block, self._commands(part.block, part.anew))
        if len(part.block):  # else only events after the last sample
            self._latest = float(part.block.t[-1])

    def finish(self) -> dict[str, Any]:
        """Balances of energy and momentum of the whole run, after the last sample."""
        self._close()
        momenta = dict(self._totals)
        found = {"energy": momenta.pop("energy", None), "momentum": momenta or None}
        return found | ({"stretches": 1 + self._count} if self._count else {})

    @property
    def contacts(self) -> dict[str, Any] | None:
        """Work and events of the contacts, after `finish`; None without contacts."""
        if not self._layout.contacts:
            return None
        return {"work": self._contact_work, **self._events.as_dict()}

    @property
    def notes(self) -> list[str]:
        """Lines on restarts, and on commands that change too often for accurate balances."""
        lines = []
        if self._count:
            at = first_few([f"{t:g}" for t in self._anew], self._count)
            lines.append(f"reset or put elsewhere {self._count} times (t = {at} s): nothing is "
                         "differentiated or balanced across that")  # fmt: skip
        if self._changes * FEW > self._samples:
            lines.append(f"commands come at {self._changes} of {self._samples} samples: power and "
                         "reactions jump there, and the balances are only as good as the samples "
                         "in between")  # fmt: skip
        return lines

    def _commands(self, block: SampleBlock, anew: bool) -> list[float]:
        """Instants [s] from which a new command acts: just after the preceding sample."""
        changed = sorted({given.index for given in block.inputs})
        self._changes += len(changed)
        if len(changed) * FEW > len(block):
            return []
        before = [block.t[k - 1] if k else self._latest for k in changed if k or not anew]
        return [float(np.nextafter(t, np.inf)) for t in before]

    def _close(self) -> None:
        """End the current stretch and add its balance."""
        ledger = self._ledger
        if not ledger.samples:
            return
        self._contact_work += (ledger.contacts() or {"work": 0.0})["work"]
        for name, now in {"energy": ledger.energy(), **(ledger.momentum() or {})}.items():
            self._totals[name] = _joined(self._totals.get(name), now)


def _joined(before: dict[str, Any] | None, now: Any) -> dict[str, Any]:
    """Sum of the errors, their uncertainties and the work; the larger of the scales."""
    if before is None:
        return now
    error, scale = before["error"] + now["error"], max(before["scale"], now["scale"])
    found = before | {"error": error, "scale": scale}
    found["relative"] = abs(error) / scale if scale > 0.0 else None
    found["quadrature"] = before["quadrature"] + now["quadrature"]
    if "work" in now:
        found |= {"final": now["final"], "work": before["work"] + now["work"]}
    return found


# Entry point: one pass over the bag, in bounded memory.


def analyze(
    bag: Path,
    *,
    topics: frozenset[str] | None = None,
    masses: dict[str, Body] | None = None,
    scene: Scene | None = None,
    table: Aligned | None = None,
) -> Analysis:
    """Analyze a bag of rb_sim or of any other program.

    masses: by body, child frame, or topic; None: those of the bag. scene: that of the poses, for
    its constraints and effects, and for masses if none are given. table: collects the aligned
    samples. Raises SinkError if the file is not a bag or has no readings.
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
        found.events += [f"{name}: {line}" for line in body.events]
    source.finish()
    if not found.figures:
        kinds = ", ".join(sorted(set(found.other_topics.values())))
        none = "" if found.messages else "no message"
        why = f"its topics are of other types ({kinds})" if kinds else none
        parts = [why, *found.notes[:3]]
        raise SinkError(f"{bag}: nothing to analyze: {'; '.join(filter(None, parts))}")
    return found
