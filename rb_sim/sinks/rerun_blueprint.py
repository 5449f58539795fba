"""How the Rerun viewer lays a recording out: 3D and text on the left, plots on the right."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import rerun.blueprint as rrb

from rb_sim.sinks.panels import BODY_TITLES, FORCE_TITLE, TORQUE_TITLE
from rb_sim.sinks.rerun_screenshot import MOTION

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleLayout

UNITS = {
    "position": " [m]",
    "orientation": "",
    "velocity": " [m/s]",
    "angular_velocity": " [rad/s]",
}
"""Beside the titles of the plots."""

_EYE = np.array([0.48, -0.72, 0.45])
"""From the centre of the scene to the eye, in sizes of the scene."""


def motion_blueprint(layout: SampleLayout, center: Array, size: float) -> Any:
    """The 3D view alone, without panels, for pictures of the motion."""
    return rrb.Blueprint(
        _spatial_view(layout, center, size, titled=False),
        rrb.TopPanel(state="hidden"),
        rrb.TimePanel(state="hidden", timeline="sim_time", play_state="paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def blueprint(layout: SampleLayout, center: Array, size: float) -> Any:
    """The layout. center, size [m]: what the 3D view is to show."""
    about = rrb.TextDocumentView(origin="/about", name="about")
    if layout.contacts:
        told = rrb.TextLogView(origin="/events", name="contact events")
        about = rrb.Horizontal(about, told)
    left = rrb.Vertical(_spatial_view(layout, center, size), about, row_shares=[5, 2])
    energy = [
        _plot("/plots/energy", "energy [J]"),
        _plot("/plots/residual", "log10 of the residual"),
    ]
    forces = [rrb.Vertical(_reactions(layout), row_shares=[1])] if layout.reactions else []
    states = [_plot("/plots/contacts", "contacts: 0 open, 1 slip, 2 stick")]
    energy = (states if layout.contacts else []) + energy
    right = rrb.Vertical(*forces, *energy, row_shares=[2] * len(forces) + [1] * len(energy))
    return rrb.Blueprint(
        rrb.Horizontal(left, _bodies(layout), right, column_shares=[5, 3, 3]),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _spatial_view(layout: SampleLayout, center: Array, size: float, titled: bool = True) -> Any:
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=center + size * _EYE,
        look_target=center,
        eye_up=(0, 0, 1),
    )
    so_far = rrb.VisibleTimeRanges(
        timeline="sim_time",
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin="/world",
        name=MOTION,
        titlebar=titled,
        eye_controls=eye,
        background=[22, 24, 30],
        overrides={f"/world/trail/{name}": so_far for name in layout.bodies},
        line_grid=rrb.LineGrid3D(visible=True, spacing=_spacing(size), color=[255, 255, 255, 40]),
    )


def _spacing(size: float) -> float:
    """Power of ten that divides the scene into some ten fields."""
    return float(10.0 ** np.round(np.log10(size / 10.0)))


def _bodies(layout: SampleLayout) -> Any:
    """The motion of each body, behind tabs if there are several."""
    columns = [
        rrb.Vertical(
            *(
                _plot(f"/plots/{name}/{key}", title.format(name) + UNITS[key])
                for key, title in BODY_TITLES.items()
            ),
            name=name,
        )
        for name in layout.bodies
    ]
    return columns[0] if len(columns) == 1 else rrb.Tabs(*columns)


def _reactions(layout: SampleLayout) -> Any:
    """Force and torque of each reaction, behind tabs if there are several."""
    columns = [
        rrb.Vertical(
            _plot(f"/plots/reactions/{name}/force", FORCE_TITLE.format(name, body) + " [N]"),
            _plot(f"/plots/reactions/{name}/torque", TORQUE_TITLE.format(name) + " [N m]"),
            name=name,
        )
        for name, body in zip(layout.reactions, layout.reaction_bodies, strict=True)
    ]
    return columns[0] if len(columns) == 1 else rrb.Tabs(*columns)


def _plot(origin: str, name: str) -> Any:
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=rrb.Corner2D.LeftTop)
