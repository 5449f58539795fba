"""A run as an HTML page: its samples with applied wrenches, and the closed form beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rb_sim.accuracy.closed_forms import exact_samples
from rb_sim.base.errors import RbSimError
from rb_sim.io.page.motion_page import FEW_BODIES, Applied, Lawful, RunPage
from rb_sim.scene.schema import Scene
from rb_sim.trajectory.record import Record
from rb_sim.trajectory.wrenches import wrenches_by_body

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleBlock
    from rb_sim.trajectory.trajectory import Trajectory

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
