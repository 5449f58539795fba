"""Which reactions hold the bodies at rest, if any do (LL 38.1).

The verdict follows from two numbers, both relative to the largest load: the imbalance, the part of
the load that no reaction could carry, and the margin, by which the safest balanced state clears
slack, lift-off and slip.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rb_sim.scene.schema import Scene
from rb_sim.statics.admissible import AdmissibleSet, Reduced, eliminate
from rb_sim.statics.element import Element
from rb_sim.statics.equilibrium import Equilibrium, assemble
from rb_sim.statics.explain import explain_limit, explain_state, failing_supports, uncarried_loads
from rb_sim.statics.model import StaticsScene
from rb_sim.statics.result import Finding, Reaction, ReactionRange, StaticsResult, Verdict

Array = NDArray[np.float64]

TOLERANCE = 1e-10
"""half-width of the band called "at the limit", relative to the largest load."""


def solve(
    scene: StaticsScene | Scene, *, tolerance: float = TOLERANCE, ranges: bool = True
) -> StaticsResult:
    """The reactions of a scene, of an ordinary one at its initial pose, or what gives.

    tolerance: half-width of the band in which the verdict is "at the limit", relative to the
        largest load. Below 1e-12 rounding decides.
    ranges: also find the range of every component when the reactions are not unique.
    """
    return solved(system_of(scene), tolerance=tolerance, ranges=ranges)


def solved(
    system: Equilibrium, *, tolerance: float = TOLERANCE, ranges: bool = True
) -> StaticsResult:
    """As `solve`, of supports and loads in place."""
    reduced = eliminate(system)
    if float(np.linalg.norm(reduced.uncarried)) > max(tolerance, reduced.round_off):
        findings = uncarried_loads(system, reduced)
        return _without(system, reduced, float("nan"), tolerance, findings)
    loaded = bool(system.load.any())
    whole = AdmissibleSet(system, reduced)
    widest = whole.widest()
    slack = whole.slack(whole.at(widest))
    margin = min(1.0, float(slack.min(initial=1.0)))
    tolerance = max(tolerance, whole.gap)
    if margin < -tolerance:
        findings = failing_supports(system, reduced, whole, widest)
        return _without(system, reduced, margin, tolerance, findings)
    leaning = float(np.linalg.norm(reduced.uncarried)) > reduced.round_off
    limit = loaded and (margin <= tolerance or leaning)
    relaxed = whole
    if margin <= tolerance:
        relaxed = AdmissibleSet(system, reduced, relax=2.0 * tolerance - margin)
    inside = relaxed.near_middle(widest)
    x = relaxed.shortest(inside) if loaded else np.zeros(len(reduced.unit))
    x = np.where(np.abs(x) <= reduced.round_off, 0.0, x)
    reactions = _reactions(system, reduced, x)
    spread = _ranges(system, relaxed, inside, x, ranges)
    unique = all(r.determinate for r in spread.values())
    verdict: Verdict = "at the limit" if limit else "equilibrium" if unique else "indeterminate"
    findings = explain_limit(system, whole, widest, tolerance) if limit else ()
    return StaticsResult(
        verdict=verdict,
        explanation=explain_state(verdict, reactions, spread, whole.freedom, findings),
        reactions=reactions,
        ranges=spread,
        indeterminacy=whole.freedom,
        mobility=reduced.motions.shape[1],
        margin=margin,
        tolerance=tolerance,
        accuracy=max(relaxed.gap, relaxed.relax, reduced.round_off),
        balance=balance(system, reactions),
        apart=system.apart,
        findings=findings,
    )


def _without(
    system: Equilibrium,
    reduced: Reduced,
    margin: float,
    tolerance: float,
    findings: tuple[Finding, ...],
) -> StaticsResult:
    """The result "no equilibrium"."""
    return StaticsResult(
        verdict="no equilibrium",
        explanation="no equilibrium: " + "; ".join(finding.words for finding in findings),
        reactions={},
        ranges={},
        indeterminacy=reduced.self_stress.shape[1],
        mobility=reduced.motions.shape[1],
        margin=margin,
        tolerance=tolerance,
        accuracy=reduced.round_off,
        balance={},
        findings=findings,
        apart=system.apart,
    )


def system_of(scene: StaticsScene | Scene) -> Equilibrium:
    """The equilibrium of either kind of scene."""
    if isinstance(scene, StaticsScene):
        return assemble(scene)
    from rb_sim.statics.of_scene import at_rest

    return at_rest(scene)


def _reactions(system: Equilibrium, reduced: Reduced, x: Array) -> dict[str, Reaction]:
    """Reactions in SI units of scaled unknowns."""
    found = {}
    for element, column in zip(system.elements, system.columns, strict=True):
        values = (reduced.unit * x)[column]
        direction = element.direction
        found[element.name] = Reaction(
            kind=element.kind,
            body=element.body,
            parent=element.parent,
            force=element.force_W @ values + element.given_W,
            torque=element.torque_W @ values,
            anchor=element.anchor_W,
            parent_anchor=element.parent_anchor_W,
            direction=direction,
            along=_along(element, values),
            friction=element.friction if element.rubs else None,
        )
    return found


def _along(element: Element, values: Array) -> float | None:
    """The force along the element's direction [N]."""
    if element.direction is None:
        return None
    return float(values[0] if element.normal_W is None else element.given_W @ element.normal_W)


def _ranges(
    system: Equilibrium, admissible: AdmissibleSet, inside: Array, x: Array, wanted: bool
) -> dict[str, ReactionRange]:
    """Range of each component; nan where it is not unique and not `wanted`."""
    found = {}
    for element, column in zip(system.elements, system.columns, strict=True):
        rows = np.zeros((7, len(x)))
        unit = admissible.reduced.unit[column]
        rows[:3, column] = element.force_W * unit
        rows[3:6, column] = element.torque_W * unit
        if element.direction is not None and element.normal_W is None:
            rows[6, column.start] = unit[0]
        spans = np.array([_span(admissible, row, inside, x, wanted) for row in rows])
        spans[:3] += element.given_W[:, None]
        if element.normal_W is not None:
            spans[6] += element.given_W @ element.normal_W
        found[element.name] = ReactionRange(
            force=spans[:3],
            torque=spans[3:6],
            along=spans[6] if element.direction is not None else None,
            determinate=bool((spans[:, 0] == spans[:, 1]).all()),
        )
    return found


def _span(
    admissible: AdmissibleSet, row: Array, inside: Array, x: Array, wanted: bool
) -> tuple[float, float]:
    """[min, max] of row . x; equal ends where it has one value."""
    value = float(row @ x)
    if not row.any() or admissible.fixed(row):
        return value, value
    if not wanted:
        return float("nan"), float("nan")
    low, high = admissible.least(row, inside), -admissible.least(-row, inside)
    size = float(np.abs(row).max())
    if high - low <= 10.0 * admissible.relax * size:
        return value, value  # as wide as the set was let off
    round_off = admissible.reduced.round_off * size
    low, high = (0.0 if abs(end) <= round_off else end for end in (low, high))
    return min(low, value), max(high, value)


def balance(system: Equilibrium, reactions: dict[str, Reaction]) -> dict[str, tuple[Array, Array]]:
    """Sum of forces [N] and of torques about the centre of mass [N m] on each body."""
    centres, total, names = system.centres, system.load_about_centres(), list(system.bodies)
    for reaction in reactions.values():
        for body, point, force, torque in reaction.ends():
            if body is not None:
                row = names.index(body)
                total[row, :3] += force
                total[row, 3:] += torque + np.cross(point - centres[row], force)
    return {name: (total[row, :3], total[row, 3:]) for row, name in enumerate(names)}
