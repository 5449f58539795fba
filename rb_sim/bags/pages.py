# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""HTML pages of motions: a run of ours, and the poses in a bag of somebody else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.accuracy.closed_forms import exact_samples
from rb_sim.bags.compare import CALENDAR
from rb_sim.bags.comparison_views import drawn
from rb_sim.bags.message_rates import linear
from rb_sim.bags.tracks import Track, Tracks
from rb_sim.base.errors import RbSimError
from rb_sim.base.palette import CYCLE
from rb_sim.io.page.motion_page import COLORS, FEW_BODIES, Applied, Lawful, RunPage, packed, spread
from rb_sim.io.page.supports import ground
from rb_sim.numerics.rotations import continuous, unit
from rb_sim.scene.schema import Scene
from rb_sim.trajectory.record import Record
from rb_sim.trajectory.wrenches import wrenches_by_body

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleBlock
    from rb_sim.trajectory.trajectory import Trajectory


AXES = 0.12
"""Length of the axes of a pose, in sizes of the motion."""
SMALLEST = 0.1
"""Size of a motion [m], at least: of a body that only turns."""


def page_of_tracks(
    tracks: Tracks, title: str, facts: Sequence[tuple[str, str]], warnings: Sequence[str]
) -> dict[str, Any]:
    """The data of the page, at instants that all poses have in common; between messages on straight
    lines."""
    names = drawn(tracks)
    shown = [tracks.bodies[name] for name in names]
    t, left_out = _instants(shown)
    zero = float(t[0]) if abs(t[0]) > CALENDAR else 0.0
    position = np.stack([linear(t, track.t, track.position) for track in shown], axis=1)
    turns = [linear(t, track.t, continuous(track.orientation)) for track in shown]
    orientation = unit(np.stack(turns, axis=1))
    places = np.concatenate([track.position for track in shown])
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    center, size = 0.5 * (low + high), max(float(np.linalg.norm(high - low)), SMALLEST)
    rows = [*facts, ("poses", f"{sum(len(track.t) for track in shown)}{left_out}")]
    if zero:
        rows.append(("t = 0", f"{zero:.6f} s by the stamps"))
    torques = [w.values[:, 3:] for w in tracks.reactions.values()]
    forces = [w.values[:, :3] for w in tracks.reactions.values()]
    plane = ground(center, size, float(low[2]))
    return {
        "title": title,
        "description": "",
        "facts": rows,
        "warnings": list(warnings),
        "legend": [f"grid {plane['step']:g} m"],
        "view": {"center": center.tolist(), "size": size * (1.0 + 2.0 * AXES)},
        "colors": COLORS,
        "bodies": [
            {"name": name, "solid": None, "color": CYCLE[i % len(CYCLE)], "reach": AXES * size}
            for i, name in enumerate(names)
        ],
        "supports": {"solids": [], "planes": [plane], "lines": [], "links": [], "joints": []},
        "t": packed(t - zero, "float64"),
        "position": packed(position),
        "orientation": packed(orientation),
        "groups": {},
        "arrows": [],
        "curves": {
            "t": packed(t - zero, "float64"),
            "energy": None,
            "scale": {"force": _largest(forces), "torque": _largest(torques)},
        },
        "reactions": [
            {
                "name": name,
                "body": wrench.frame or "its frame",
                "about": "its frame's origin",
                "force": packed(linear(t, wrench.t, wrench.values[:, :3])),
                "torque": packed(linear(t, wrench.t, wrench.values[:, 3:])),
            }
            for name, wrench in tracks.reactions.items()
        ],
        "exact": None,
        "events": [],
        "point": "origin of its frame",
        "trace": True,
        "axes": True,
        "names": True,
    }


def _instants(tracks: list[Track]) -> tuple[np.ndarray, str]:
    """Those of all poses, as many as a page has room for; what is left out, in words."""
    every = np.unique(np.concatenate([track.t for track in tracks]))
    rows = spread(len(every), 28.0 * len(tracks))
    if len(rows) == len(every):
        return every, ""
    return every[rows], f"; the page shows {len(rows)} of {len(every)} instants"


def _largest(vectors: list[np.ndarray]) -> float:
    return max((float(np.nanmax(np.abs(v), initial=0.0)) for v in vectors), default=0.0)


# A run: its samples with applied wrenches, and the closed form beside them.


GIVEN = ("wrench", "wrench_table")
"""Effects that are applied from outside; `commanded_wrench` is among the samples."""


def page_of_run(
    run: Trajectory, facts: Sequence[tuple[str, str]], warnings: Sequence[str]
) -> dict[str, Any]:
    """The data of the page of a run. facts: rows of its table; warnings: lines above the view.

    Raises RbSimError for a run without samples or without a scene.
    """
    if not len(run) or run.scene is None:
        raise RbSimError("there is no sample to show")
    page = RunPage(run.scene, run.layout, run.block)
    lawful = _closed_form(run, page.kept)
    rows = list(facts)
    if lawful is not None:
        rows.append(("closed form", f"dashed: {lawful.name}"))
    applied = _applied(Record(page.kept, run.layout, run.scene))
    return page.data(facts=rows, warnings=warnings, applied=applied, lawful=lawful)


def _closed_form(run: Trajectory, kept: SampleBlock) -> Lawful | None:
    """The exact motion, of a run without commands and resets whose scene has one."""
    if run.block.inputs or not isinstance(run.scene, Scene):
        return None
    try:
        found = exact_samples(run.scene, kept.t)
    except RbSimError:  # of another version of the program, say
        return None
    return None if found is None else Lawful(*found)


def _applied(record: Record) -> list[Applied]:
    """The wrenches of effects but for the commanded ones, at the samples of the page."""
    if not isinstance(record.scene, Scene) or len(record.layout.bodies) > FEW_BODIES:
        return []
    effects = {n: e for n, e in record.scene.effects.items() if e.type != "commanded_wrench"}
    scene = record.scene.model_copy(update={"effects": effects})
    found = []
    for name, by_body in wrenches_by_body(Record(record.block, record.layout, scene)).items():
        for body, wrench in by_body.items():
            given = effects[name].type in GIVEN
            found.append(Applied(name, body, given, wrench.force, wrench.torque))
    return found
