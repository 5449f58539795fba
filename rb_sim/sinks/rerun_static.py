"""What does not change in a recording: shapes, surfaces, colours, widths and names of curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from rb_sim.sinks.contact_power import contacts_of
from rb_sim.sinks.extent import reach_of
from rb_sim.sinks.rerun_shapes import shape_archetype, stand_in, support_archetype

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleLayout
    from rb_sim.scene.schema import Scene
    from rb_sim.sinks.rerun_scales import Scales

AXIS = 1.4
"""Length of the body axes in reaches of the shape, so that they stick out of a ball."""

VELOCITY = (64, 190, 110)
REACTION = (255, 165, 40)
COMMAND = (235, 80, 160)
TRAIL = (150, 160, 175)
BODIES = ((96, 150, 225), (215, 140, 90), (130, 185, 110), (175, 130, 200), (200, 185, 100))
AXES = ((230, 80, 80), (90, 190, 90), (90, 130, 240), (190, 190, 190))
"""Of x, y, z and the scalar part w."""

ARROW = 2.5
"""Radius of an arrow in pixels: its length has a scale of its own, which its width has not."""

MARKER = 5.0
"""Radius in pixels of the point at a body's centre of mass, which is seen of a body that is smaller
than it: a box that flies for half a kilometre."""


class Static:
    """Logs it once, at the start of a recording. scales: of the arrows and of the camera."""

    def __init__(self, recording: Any, scene: Scene, layout: SampleLayout, scales: Scales) -> None:
        self._recording, self._scene, self._layout = recording, scene, layout
        self._scales = scales
        self._drawn = drawn_reactions(layout)

    def _log(self, entity: str, archetype: Any) -> None:
        self._recording.log(entity, archetype, static=True)

    def log(self) -> None:
        """Send all of it."""
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for i, name in enumerate(self._layout.bodies):
            body = self._scene.bodies[name]
            color = (*BODIES[i % len(BODIES)], 255)
            if body.shape is not None:
                self._log(f"world/{name}/shape", shape_archetype(body.shape, color))
            else:
                self._log(f"world/{name}/inertia", stand_in(body, color))
            marker = rr.Points3D(
                [body.center_of_mass],
                radii=rr.Radius.ui_points(MARKER),
                colors=[BODIES[i % len(BODIES)]],
            )
            self._log(f"world/{name}/marker", marker)
            axis = AXIS * reach_of(body) or 0.5 * self._scales.length
            self._log(f"world/{name}", rr.TransformAxes3D(axis_length=axis))
            width: Any = rr.Radius.ui_points(1.5)
            style = rr.LineStrips3D.from_fields(colors=[TRAIL], radii=[width])
            self._log(f"world/trail/{name}", style)
            self._log_arrow(f"world/velocity/{name}", VELOCITY)
            self._log_plot(f"plots/{name}/position", "xyz")
            self._log_plot(f"plots/{name}/orientation", "xyzw")
            self._log_plot(f"plots/{name}/velocity", "xyz")
            self._log_plot(f"plots/{name}/angular_velocity", "xyz")
        for name in self._layout.contacts:
            size: Any = rr.Radius.ui_points(7.0)
            self._log(f"world/contact/{name}", rr.Points3D.from_fields(radii=[size]))
        for name in self._layout.commanded:
            self._log_arrow(f"world/command/{name}", COMMAND)
        for k, name in enumerate(self._layout.reactions):
            if k in self._drawn:
                self._log_arrow(f"world/reaction/{name}", REACTION)
            self._log_plot(f"plots/reactions/{name}/force", "xyz")
            self._log_plot(f"plots/reactions/{name}/torque", "xyz")
        self._log_supports()
        for c, name in enumerate(self._layout.contacts):
            style = rr.SeriesLines(
                names=[name],
                colors=[BODIES[c % len(BODIES)]],
                interpolation_mode="StepAfter",
                aggregation_policy="Max",
            )
            self._log(f"plots/contacts/{name}", style)
        names = ["kinetic", "potential", "total"]
        self._log("plots/energy", _lines(names, [AXES[0], AXES[2], (240, 240, 240)]))
        self._log("plots/residual", _lines(["residual"], [AXES[3]]))

    def _log_supports(self) -> None:
        """The surface of each contact, in the world or on its parent.

        A plane on a body that has a shape is not drawn: the shape shows it, and a plane around it
        would hide what is below, the body's own arrows too.
        """
        for name, spec in contacts_of(self._scene).items():
            on = None if spec.parent is None else self._scene.bodies[spec.parent].shape
            if spec.surface.type == "plane" and on is not None:
                continue
            frame = "world" if spec.parent is None else f"world/{spec.parent}"
            near, origin = np.zeros(3), np.zeros(3)
            if spec.parent is None:
                near, origin = self._scales.center, self._scales.origin
            surface = support_archetype(spec.surface, near, self._scales.size, origin)
            if surface is not None:
                self._log(f"{frame}/support/{name}", surface)

    def _log_arrow(self, entity: str, color: tuple[int, int, int]) -> None:
        radius: Any = rr.Radius.ui_points(ARROW)
        self._log(f"{entity}/arrow", rr.Arrows3D.from_fields(colors=[color], radii=[radius]))

    def _log_plot(self, entity: str, names: str) -> None:
        self._log(entity, _lines(list(names), AXES[: len(names)]))


def drawn_reactions(layout: SampleLayout) -> list[int]:
    """Reactions to draw: bearings, but not the total that they add up to."""
    names = layout.reactions
    parts = {name.rpartition("/")[0] for name in names}
    return [k for k, name in enumerate(names) if name not in parts]


def _lines(names: list[str], colors: Any) -> Any:
    return rr.SeriesLines(names=names, colors=list(colors), widths=[1.5] * len(names))
