# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""HTML page of a run: poses, arrows, curves and events, reduced to screen resolution."""

from __future__ import annotations

import base64
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import SinkError
from rb_sim.base.palette import (
    AXES,
    BROWN,
    COMMAND,
    CYCLE,
    ENERGIES,
    EVENT,
    GREEN,
    GREY,
    REACTION,
    SLIPPING,
    STICKING,
)
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.io.drawn_supports import Sight, Supports, solid_of
from rb_sim.io.rerun.arrow_scales import (
    Extent,
    Lengths,
    drawn_reactions,
    local_origin,
    nice,
)
from rb_sim.io.sink import Envelope, Timeline, event_text, samples_at
from rb_sim.mechanics.samples import centers_of_mass, origins
from rb_sim.numerics.rotations import norms
from rb_sim.scene.extent import reach_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout


COLORS = {
    "axes": AXES,
    "energy": [ENERGIES[name] for name in ("kinetic", "potential", "total")],
    "trace": GREY,
    "event": EVENT,
    "contact": (GREY, SLIPPING, STICKING),
}
APPLIED, TORQUE = GREEN, BROWN
MOST_REACTIONS = 24
"""Maximum number of reactions with arrows and curves: those with the largest forces."""
MOST_EVENTS = 500
FEW_BODIES = 12
"""Up to this number of bodies, poses are stored in single precision and names are shown."""

LONGEST, IN_VIEW = 0.7, 0.98
"""Arrow length, relative to the scene, that this fraction of the instants does not exceed; impacts
would otherwise make all other arrows invisible."""


class Applied(NamedTuple):
    """Wrench of an effect on a body, world axes, about its centre of mass [N, N m]."""

    name: str
    body: str
    commanded: bool
    """whether it is a command or from a table (not gravity, springs etc.)."""
    force: Array
    torque: Array


class Lawful(NamedTuple):
    """The closed-form solution: its name, and its samples at the instants of the page."""

    name: str
    block: SampleBlock


class RunPage:
    """Builds the data of a page from the samples of a run.

    samples: all of them; `kept` are those shown. Further quantities passed to `data` are at the
    `kept` instants.
    """

    def __init__(self, scene: Any, layout: SampleLayout, samples: SampleBlock) -> None:
        self.scene, self.layout, self.samples = scene, layout, samples
        self._pose_kind = "float32" if len(layout.bodies) <= FEW_BODIES else "uint16"
        self._reactions = self._strongest()
        pose = 7.0 * (4.0 if self._pose_kind == "float32" else 2.0) * len(layout.bodies)
        self._rows = spread(len(samples), pose * 1.5 + 72.0 * len(self._reactions) + 16.0)
        timeline = Timeline().follow(samples.t)
        self._t = timeline
        self.kept = samples_at(samples, self._rows)
        extent = Extent(scene, layout)
        extent.add(self.kept)
        center, size = extent.center_and_size()
        self.origin = local_origin(center, size)
        self._view = Sight(center - self.origin, size, extent.lowest - self.origin[2])
        self._here = replace(
            self.kept,
            position=self.kept.position - self.origin,
            anchor=self.kept.anchor - self.origin,
        )

    def data(
        self,
        *,
        facts: Sequence[tuple[str, str]],
        warnings: Sequence[str],
        applied: Sequence[Applied] = (),
        lawful: Lawful | None = None,
    ) -> dict[str, Any]:
        """Data of the page. facts: rows of its table; applied: wrenches at `kept` samples."""
        few = len(self.layout.bodies) <= FEW_BODIES
        groups, arrows = self._arrows(applied)
        supports = Supports(self.scene, self.layout, self._here, self._view, self.origin)
        return {
            "title": self.scene.name,
            "description": self.scene.description,
            "facts": [*facts, *self._counted()],
            "warnings": list(warnings),
            "legend": self._legend(supports),
            "view": {"center": self._view.center.tolist(), "size": self._view.size},
            "colors": COLORS,
            "bodies": self._bodies(),
            "supports": supports.as_dict(),
            "t": packed(self._t[self._rows], "float64"),
            "position": packed(self._here.position, self._pose_kind),
            "orientation": packed(self._here.orientation, self._pose_kind),
            "groups": groups,
            "arrows": arrows,
            "curves": self._curves(),
            "reactions": self._reaction_curves(),
            "strongest": self._most_loaded(),
            "exact": None if lawful is None else self._exact(lawful),
            "events": self._events(),
            "point": "centre of mass",
            "trace": False,
            "axes": False,
            "names": 1 < len(self.layout.bodies) <= 5 and few,
        }

    def _counted(self) -> list[tuple[str, str]]:
        """Rows with the number of samples, and what the page omits."""
        count, kept = len(self.samples), len(self._rows)
        text = f"{count}"
        if kept < count:
            text += f"; the 3D view has {kept} of them, curves keep least and greatest values"
        rows = [("samples", text)]
        total = len(drawn_reactions(self.layout))
        if len(self._reactions) < total and len(self._reactions) == MOST_REACTIONS:
            rows.append(("reactions", f"the {MOST_REACTIONS} with the greatest forces of {total}"))
        events = len(self.samples.events)
        if events:
            shown = "" if events <= MOST_EVENTS else f"; the first {MOST_EVENTS} are marked"
            rows.append(("contact events", f"{events}{shown}"))
        if self.origin.any():
            rows.append(("origin of the positions", f"{self.origin.tolist()} m in the world"))
        return rows

    def _legend(self, supports: Supports) -> list[str]:
        steps = sorted({plane["step"] for plane in supports.of("planes")})
        return [f"grid {steps[0]:g} m"] if steps else []

    def _bodies(self) -> list[dict[str, Any]]:
        found = []
        for i, name in enumerate(self.layout.bodies):
            body = self.scene.bodies[name]
            reach = reach_of(body)
            about = {"color": CYCLE[i % len(CYCLE)], "reach": reach or 0.1 * self._view.size}
            found.append({"name": name, "solid": solid_of(body), **about})
        return found

    def _strongest(self) -> list[int]:
        """Indices of the reactions that ever act, without totals of several parts; at most the
        MOST_REACTIONS largest."""
        forces = self.samples.reaction_force
        with np.errstate(all="ignore"):
            greatest = np.nanmax(norms(forces), axis=0, initial=0.0)
        torque = np.nanmax(norms(self.samples.reaction_torque), axis=0, initial=0.0)
        acting = [k for k in drawn_reactions(self.layout) if greatest[k] > 0.0 or torque[k] > 0.0]
        if len(acting) <= MOST_REACTIONS:
            return acting
        return sorted(sorted(acting, key=lambda k: -greatest[k])[:MOST_REACTIONS])

    def _most_loaded(self) -> int:
        """Which of the reactions carries most on average: the one that is shown first."""
        forces = norms(self.samples.reaction_force[:, self._reactions])
        return int(np.argmax(np.nan_to_num(forces).mean(axis=0))) if self._reactions else 0

    def _arrows(self, applied: Sequence[Applied]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        """Groups with a common name, colour and scale, and their arrows."""
        here, layout = self._here, self.layout
        wanted: dict[str, list[dict[str, Any]]] = {"reaction": [], "command": [], "applied": []}
        torques: list[dict[str, Any]] = []
        for k in self._reactions:
            name, anchor, force = layout.reactions[k], here.anchor[:, k], here.reaction_force[:, k]
            one = {"name": name, "point": anchor, "vector": force}
            if name in layout.contacts:
                one["state"] = here.contact_state[:, layout.contacts.index(name)]
            wanted["reaction"].append(one)
            torques.append({"name": name, "point": anchor, "vector": here.reaction_torque[:, k]})
        for each in applied:
            body = layout.bodies.index(each.body)
            at = here.position[:, body]
            group = "command" if each.commanded else "applied"
            wanted[group].append({"name": each.name, "point": at, "vector": each.force})
            torques.append({"name": each.name, "point": at, "vector": each.torque})
        for k, name in enumerate(layout.commanded):
            body = layout.bodies.index(name)
            at = origins(here, centers_of_mass(self.scene.bodies, layout.bodies)).position[:, body]
            command = here.command[:, k]
            wanted["command"].append({"name": name, "point": at, "vector": command[:, :3]})
            torques.append({"name": name, "point": at, "vector": command[:, 3:]})
        names = {
            "reaction": ("reaction forces", REACTION, True),
            "command": ("applied wrenches: forces", COMMAND, True),
            "applied": ("forces of effects (gravity, springs, drag)", APPLIED, False),
        }
        length = max(max((b["reach"] for b in self._bodies()), default=0.0), self._view.size / 8.0)
        every = [one["vector"] for group in wanted.values() for one in group]
        force = self._per_metre(every, length)
        groups, arrows = {}, []
        for key, (name, color, on) in names.items():
            about = {"name": name, "unit": "N", "color": color, "on": on, "heads": 1}
            self._add(groups, arrows, key, wanted[key], force, length, about)
        least = (
            WRITTEN_ROUNDING
            * float(np.nanmax(norms(np.array(every)), initial=0.0))
            * self._view.size
        )
        torques = [one for one in torques if norms(one["vector"]).max(initial=0.0) > least]
        torque = self._per_metre([one["vector"] for one in torques], length)
        about = {"name": "torques", "unit": "N m", "color": TORQUE, "on": False, "heads": 2}
        self._add(groups, arrows, "torque", torques, torque, length, about)
        return groups, arrows

    def _per_metre(self, vectors: list[Array], length: float) -> float:
        """Force [N] or torque [N m] per metre of arrow: one scale for the whole run."""
        if not vectors:
            return 1.0
        lengths, all_ = Lengths(), np.stack(vectors, axis=1)
        lengths.add(all_)
        greatest = np.nanmax(norms(all_), axis=1)
        longest = float(np.nanquantile(greatest, IN_VIEW)) / (LONGEST * self._view.size)
        return max(1.0 / lengths.per_metre(length), nice(2.0 * longest) if longest > 0.0 else 0.0)

    def _add(
        self,
        groups: dict[str, Any],
        arrows: list[dict[str, Any]],
        key: str,
        wanted: list[dict[str, Any]],
        per: float,
        length: float,
        about: dict[str, Any],
    ) -> None:
        """Add a group with those arrows that are ever long enough to be seen."""
        seen = [
            one for one in wanted if norms(one["vector"]).max(initial=0.0) > 0.005 * per * length
        ]
        if not seen:
            return
        unit = 10.0 ** np.floor(np.log10(length))
        groups[key] = {**about, "per": per, "length": f"{unit:g}", "value": f"{per * unit:.4g}"}
        for one in seen:
            state = one.get("state")
            arrows.append({
                "group": key,
                "name": one["name"],
                "point": packed(np.nan_to_num(one["point"])),
                "vector": packed(np.nan_to_num(one["vector"])),
                "state": None if state is None else packed(state, "uint8"),
            })  # fmt: skip

    def _curves(self) -> dict[str, Any]:
        """Energies, and (in `_values`) the columns of the reactions, at their own instants."""
        samples = self.samples
        energy = np.c_[samples.kinetic_energy, samples.potential_energy, samples.energy]
        columns = [energy]
        for k in self._reactions:
            columns += [samples.reaction_force[:, k], samples.reaction_torque[:, k]]
        values = np.concatenate(columns, axis=1)
        room = CURVE_BYTES / (4.0 * values.shape[1])
        envelope = Envelope(values.shape[1], int(min(MOST_SAMPLES, room) / 2.0))
        envelope.add(self._t, values)
        t, self._values = envelope.curves()
        force = float(np.nanmax(np.abs(samples.reaction_force), initial=0.0))
        size = max(float(np.nanmax(np.abs(energy), initial=0.0)), 1e-300)
        torque = float(np.nanmax(np.abs(samples.reaction_torque), initial=0.0))
        self._scale = {
            "energy": size,
            "force": force,
            "torque": max(force * self._view.size, torque),
        }
        packed_energy = packed(np.nan_to_num(self._values[:, :3]))
        return {"t": packed(t, "float64"), "energy": packed_energy, "scale": self._scale}

    def _reaction_curves(self) -> list[dict[str, Any]]:
        found = []
        contacts = set(self.layout.contacts)
        for j, k in enumerate(self._reactions):
            columns = np.nan_to_num(self._values[:, 3 + 6 * j : 9 + 6 * j])
            name, body = self.layout.reactions[k], self.layout.reaction_bodies[k]
            turns = (
                np.abs(columns[:, 3:]).max(initial=0.0) > WRITTEN_ROUNDING * self._scale["torque"]
            )
            about = "the contact point" if name in contacts else "the anchor"
            torque = packed(columns[:, 3:]) if turns else None
            force = packed(columns[:, :3])
            found.append(
                {"name": name, "body": body, "about": about, "force": force, "torque": torque}
            )
        return found

    def _exact(self, lawful: Lawful) -> dict[str, Any]:
        block = lawful.block
        energy = np.c_[block.kinetic_energy, block.potential_energy, block.energy]
        reactions: list[dict[str, Any]] = []
        for k in self._reactions:
            reactions += [packed(block.reaction_force[:, k]), packed(block.reaction_torque[:, k])]
        return {
            "name": lawful.name,
            "position": packed(block.position - self.origin),
            "orientation": packed(block.orientation),
            "energy": packed(energy),
            "reactions": reactions,
        }

    def _events(self) -> list[tuple[float, str]]:
        """Time on the page's clock, which never goes back, and text of each event."""
        times, clock = self.samples.t, self._t
        found = []
        for event in self.samples.events[:MOST_EVENTS]:
            row = min(int(np.searchsorted(times, event.t)), len(times) - 1)
            found.append((event.t + float(clock[row] - times[row]), event_text(event)))
        return found


# Writing of a page: template, style, scripts and data in one file.
#
# The page loads no other file, so it opens offline.


ASSETS = Path(__file__).with_name("page")
SCRIPTS = {"page": ("solids.js", "plots.js", "page.js"), "report": ("plots.js", "report.js")}
"""Scripts of each kind of page, in order of dependence."""

MOST_SAMPLES = 5000
"""Maximum number of instants of a motion in a page; a screen cannot show more."""

BYTES = 1_400_000
"""Bytes for poses and arrows of a page; with curves, in base64, it stays below 3 MB."""

CURVE_BYTES = 550_000
"""Bytes for its curves of energies and reactions."""


def packed(values: Array, kind: str = "float32") -> dict[str, Any]:
    """Values in the format of the page. kind: float64, float32, uint8; or uint16: 65,535 steps
    between the least and the largest value."""
    flat = np.asarray(values, dtype=float).ravel()
    scale = {}
    if kind == "uint16":
        flat = np.nan_to_num(flat)
        low, high = float(flat.min(initial=0.0)), float(flat.max(initial=0.0))
        step = (high - low) / 65535.0 or 1.0
        scale = {"low": low, "step": step}
        flat = np.rint((flat - low) / step)
    with np.errstate(over="ignore", invalid="ignore"):
        data = np.ascontiguousarray(flat, dtype=np.dtype(kind).newbyteorder("<"))
    return {"type": kind, **scale, "base64": base64.b64encode(data.tobytes()).decode()}


def spread(count: int, per_sample: float) -> np.ndarray:
    """Indices of the samples that fit into a page, including first and last.

    per_sample: bytes of one sample.
    """
    most = int(min(count, MOST_SAMPLES, max(2.0, BYTES / max(per_sample, 1.0))))
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def save(page: dict[str, Any], path: Path, kind: str = "page", body: str = "") -> None:
    """Write the page atomically. Raises SinkError.

    page: its data and title. kind: "page", a motion in 3D; or "report", curves in the HTML `body`.
    """
    data = json.dumps(page, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    data = data.replace("<", "\\u003c")  # `</script>` and `<!--` in a name would end the data
    scripts = [(ASSETS / name).read_text(encoding="utf-8") for name in SCRIPTS[kind]]
    parts = {
        "title": _escaped(page["title"]),
        "style": (ASSETS / "page.css").read_text(encoding="utf-8"),
        "body": body,
        "data": data,
        "script": "\n".join(scripts),
    }
    text = (ASSETS / f"{kind}.html").read_text(encoding="utf-8")
    written = []
    for name, part in parts.items():  # in the order of the template: a part may contain braces
        head, found, tail = text.partition("{{" + name + "}}")
        if found:
            written += [head, part]
            text = tail
    text = "".join([*written, text])
    draft = path.with_name(f".{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        raise SinkError(f"{path}: cannot write it: {error.strerror}") from None
    finally:
        draft.unlink(missing_ok=True)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")
