"""Constraints that a sample violates: whether, and which of them most.

The general formulation in maximal coordinates tells it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.engine.manifold import Manifold, relative
from rb_sim.errors import RbSimError
from rb_sim.finding import Finding
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.place import InitialPlace

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


CONTRADICTORY = (
    "look for constraints that contradict each other from here on, or try method dopri853"
)
STEPPED = "time stepping holds joints to first order: try a smaller step, or an event-driven method"


def violated_constraint(scene: Scene, layout: SampleLayout, block: SampleBlock, i: int) -> str:
    """Name of the constraint whose violation is largest at sample i; "" where it cannot be told."""
    if layout.contacts or not scene.constraints:
        return ""
    options = scene.simulation.model_copy(update={"project_initial": True})
    try:
        projected = scene.model_copy(update={"simulation": options})
        system = compile_motion(projected, "maximal").system
    except RbSimError:
        return ""
    y = np.concatenate(
        [
            np.concatenate([column[i, b] for column in columns_of(block)])
            for b in range(len(layout.bodies))
        ]
    )
    with np.errstate(all="ignore"):
        violations, _ = Manifold(system).violations(float(block.t[i]), y.tolist())
    worst = relative(system, violations, system.length, system.speed).max(axis=0)
    place = InitialPlace(scene)
    owners = [n for n, spec in scene.constraints.items() for _ in spec.parts(place)]  # type: ignore[attr-defined]
    part = int(np.searchsorted(system.first_row, int(np.argmax(worst)), side="right")) - 1
    return owners[part]


def residual_found(
    scene: Scene, layout: SampleLayout, block: SampleBlock, bound: float
) -> Finding | None:
    """The first sample of the block whose residual is beyond the bound, or no number."""
    beyond = np.flatnonzero(~(block.residual <= bound))
    if not len(beyond):
        return None
    i = int(beyond[0])
    where = violated_constraint(scene, layout, block, i)
    advice = STEPPED if scene.simulation.method == "time_stepping" else CONTRADICTORY
    what = "violation of a constraint, relative to the scene's size or speed,"
    figure = float(np.nanmax(block.residual[i:]))
    return Finding("residual", float(block.t[i]), figure, bound, what, where, advice)


def columns_of(block: SampleBlock) -> tuple[np.ndarray, ...]:
    """The columns of a body's coordinates, in their order."""
    return (
        block.position,
        block.orientation,
        block.linear_velocity,
        block.angular_velocity,
    )
