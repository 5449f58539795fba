"""Guides along splines: where a motion is among their pieces, and the steps that must end there.

A law along a spline is smooth on each piece only, and no method keeps its order across their ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from rb_sim.catalogue.constraints.rows import CurveRow, material_point
from rb_sim.catalogue.curves import SplineCurve, curve_nearest, curve_point
from rb_sim.catalogue.splines import Pieces
from rb_sim.graph.functions import call, minimum
from rb_sim.graph.machine import Law, PlainLaw, compile_law
from rb_sim.graph.symbols import Graph
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.mechanics.systems.translation import GuidedBody, on_curve
from rb_sim.numerics.vectors import dot


def splines_of(system: Any) -> list[Pieces]:
    """The splines along which something is guided, in the order of `ways`."""
    if isinstance(system, GuidedBody):
        return [system.curve.pieces] if isinstance(system.curve, SplineCurve) else []
    return [placed.row.curve.pieces for placed in _guided(system)]


def ways(system: Any, y: Sequence[Any]) -> list[Any]:
    """The parameter of each spline and its rate, in turn."""
    if isinstance(system, GuidedBody):
        return list(y)
    found: list[Any] = []
    for placed in _guided(system):
        p, v, _ = material_point(state_of(y, placed.body), placed.row.r_B)
        s = curve_nearest(placed.row.curve, p)
        slope = curve_point(placed.row.curve, s)[1]
        found += [s, dot(v, slope) / dot(slope, slope)]
    return found


def on_guides(system: Any, y: Sequence[Any]) -> Any:
    """False once a body in maximal coordinates has left the end of its spline."""
    within: Any = True
    for placed, s in zip(_guided(system), ways(system, y)[::2], strict=True):
        within = on_curve(placed.row.curve, s) & within
    return within


def share_law(splines: Sequence[Pieces]) -> Law | PlainLaw | None:
    """The share of a step after which the first piece ends; y is as `integrate.loop` gives it to
    SHARE. None where there are no splines.
    """
    if not splines:
        return None
    graph, share = Graph(), 1.0
    h, tolerance, *ends = graph.vector("y", 2 + 4 * len(splines))
    for k, pieces in enumerate(splines):
        before, after = ends[2 * k : 2 * k + 2], ends[2 * (k + len(splines)) :][:2]
        share = minimum(share, call(pieces.share, *before, *after, h, tolerance)[0])
    return compile_law([share])


class GuidedLaws:
    """What the laws of every system say of its splines."""

    system: Any

    @cached_property
    def splines(self) -> int:
        """Guides whose pieces end steps."""
        return len(splines_of(self.system))

    @cached_property
    def share(self) -> Law | PlainLaw | None:
        """The share of a step after which a piece of a spline ends."""
        return share_law(splines_of(self.system))


def _guided(system: Any) -> list[Any]:
    """The placed rows of splines of a system in maximal coordinates."""
    return [
        placed
        for placed in getattr(system, "constraints", ())
        if isinstance(placed.row, CurveRow) and isinstance(placed.row.curve, SplineCurve)
    ]
