# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Solution of statics: reactions of the bodies at rest, if there is an equilibrium (LL 38.1).

The verdict follows from two numbers relative to the largest load: the imbalance, the part of the
load that no reaction can carry, and the margin, the distance of the safest balanced state from
slack, lift-off and slip.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rb_sim.base.rounding import NEGLIGIBLE
from rb_sim.equilibrium.equilibrium import (
    AdmissibleSet,
    Bound,
    Element,
    Equilibrium,
    Reduced,
    eliminate,
)
from rb_sim.equilibrium.statics_of_scene import at_rest
from rb_sim.equilibrium.statics_tables import (
    Finding,
    Reaction,
    ReactionRange,
    StaticsResult,
    Verdict,
)
from rb_sim.scene.schema import Scene

# Explanation of the verdict: failing supports, supports at their limit, non-unique reactions.


Array = NDArray[np.float64]

AXES = ("x", "y", "z")


def uncarried_loads(system: Equilibrium, reduced: Reduced) -> tuple[Finding, ...]:
    """The failing balances, body by body, if no reaction can carry the load.

    The uncarried part of the load, read as a virtual motion (velocity of the pole and angular
    velocity of each body), is one that no support resists and on which the loads do work: the body
    starts to move that way, and the load along it is not balanced.
    """
    scaled = reduced.uncarried.reshape(-1, 2, 3)
    load = system.load.reshape(-1, 2, 3)
    lever = system.lever
    found: list[Finding] = []
    largest = float(np.abs(scaled).max())
    for name, pole, (normal_force, turn), (force, torque) in zip(
        system.bodies, system.poles, scaled, load, strict=True
    ):
        if max(np.abs(normal_force).max(), np.abs(turn).max()) <= NEGLIGIBLE * largest:
            continue
        speed, spin = float(np.linalg.norm(normal_force)), float(np.linalg.norm(turn))
        if spin <= NEGLIGIBLE * speed:
            along = normal_force / speed
            found.append(_failing_force(name, along, float(force @ along)))
        else:
            axis = turn / spin
            # velocity of the pole is push, angular velocity turn / lever: the screw's axis
            through = pole + np.cross(turn, normal_force) / spin**2 * lever
            through = _support_on(system, name, through, axis)
            moment = float((torque + np.cross(pole - through, force)) @ axis)
            found.append(_failing_torque(name, axis, through, moment))
            pitch = float(normal_force @ axis)
            if abs(pitch) > NEGLIGIBLE * (speed + spin):
                found.append(_failing_force(name, axis, float(force @ axis)))
    # a body that only moves along carries no load in that direction
    arm = {"force": 1.0, "torque": lever}
    weight = max((abs(of.amount) / arm[of.kind] for of in found), default=0.0)
    return tuple(of for of in found if abs(of.amount) > NEGLIGIBLE * weight * arm[of.kind])


def _support_on(system: Equilibrium, body: str, through: Array, axis: Array) -> Array:
    """A support point of the body on the axis, if there is one; else `through`."""
    for element in system.elements:
        for name, anchor in (
            (element.body, element.anchor_W),
            (element.parent, element.parent_anchor_W),
        ):
            off_axis = np.linalg.norm(np.cross(anchor - through, axis))
            if name == body and off_axis <= 1e-9 * system.lever:
                return anchor
    return through


def _failing_force(name: str, along: Array, amount: float) -> Finding:
    words = (
        f"the force balance of body '{name}' along {_direction(along)} fails: "
        f"no support can carry {_number(amount)} N"
    )
    return Finding("force", name, amount, words)


def _failing_torque(name: str, axis: Array, through: Array, amount: float) -> Finding:
    words = (
        f"the torque balance of body '{name}' about {_direction(axis)} through {_vector(through)} "
        f"fails: no support can carry {_number(amount)} N m"
    )
    return Finding("torque", name, amount, words)


def failing_supports(
    system: Equilibrium, reduced: Reduced, admissible: AdmissibleSet, widest: Array
) -> tuple[Finding, ...]:
    """The supports that cannot provide what the balance requires.

    Judged in the balanced state with the least violation: those within 0.1 % of the largest
    violation.
    """
    x = admissible.at(widest)
    slack = admissible.slack(x)
    worst = float(slack.min())
    values = reduced.unit * x
    by_name = {e.name: (e, c) for e, c in zip(system.elements, system.columns, strict=True)}
    found = []
    for (name, bound), gap in zip(admissible.owners, slack, strict=True):
        if gap <= 0.999 * worst:
            element, column = by_name[name]
            found.append(_gives(element, bound, values[column]))
    return tuple(found)


WANTING = {
    "slips": "slips: it would need friction {need} and has {has}",
    "rolls": "rolls: it would need a rolling resistance of {need} m and has {has} m",
    "spins": "spins: it would need a spinning resistance of {need} m and has {has} m",
}
"""Explanation for a contact beyond one of its bounds."""
TURNING = {"slips": "slipping", "rolls": "rolling", "spins": "spinning"}


def _gives(element: Element, bound: Bound | None, values: Array) -> Finding:
    """Finding for a support beyond its bound."""
    first = float(values[0]) if bound is None or bound.normal_force is None else bound.normal_force
    if element.kind == "string":
        need = f"it would have to push with {_number(-first)} N"
        words = f"string '{element.name}' goes slack: {need}"
        return Finding("slack", element.name, -first, words)
    across = 0.0 if bound is None else float(np.linalg.norm(values[list(bound.tails)]))
    if bound is not None and first > 1e-9 * across:
        ratio = across / first
        wanting = WANTING[bound.motion].format(need=_number(ratio), has=_number(bound.coefficient))
        words = f"contact '{element.name}' {wanting}"
        if _number(ratio) == _number(bound.coefficient):
            words += f" (short by {ratio - bound.coefficient:.2g})"
        return Finding(bound.motion, element.name, ratio, words)
    words = f"contact '{element.name}' lifts: it would have to pull with {_number(-first)} N"
    return Finding("lifts", element.name, -first, words)


def explain_limit(
    system: Equilibrium, admissible: AdmissibleSet, widest: Array, tolerance: float
) -> tuple[Finding, ...]:
    """Supports at their limit in every admissible state."""
    x = admissible.at(widest)
    values = admissible.reduced.unit * x
    floor = 1e3 * tolerance * admissible.reduced.force
    by_name = {e.name: (e, c) for e, c in zip(system.elements, system.columns, strict=True)}
    found = []
    for (name, bound), gap in zip(admissible.owners, admissible.slack(x), strict=True):
        if gap > 2.0 * tolerance:
            continue
        element, column = by_name[name]
        first = (
            float(values[column.start])
            if bound is None or bound.normal_force is None
            else bound.normal_force
        )
        if element.kind == "string":
            words = f"string '{name}' is on the point of going slack"
            found.append(Finding("slack", name, first, words))
        elif bound is not None and first > floor:
            words = f"contact '{name}' is on the point of {TURNING[bound.motion]}"
            found.append(Finding(bound.motion, name, bound.coefficient, words))
        else:
            words = f"contact '{name}' is on the point of lifting"
            found.append(Finding("lifts", name, first, words))
    if not found:
        for finding in uncarried_loads(system, admissible.reduced):
            words = finding.words + " (within the tolerance)"
            found.append(Finding(finding.kind, finding.name, finding.amount, words))
    return tuple(found)


def explain_state(
    verdict: Verdict,
    reactions: Mapping[str, Reaction],
    ranges: Mapping[str, ReactionRange],
    indeterminacy: int,
    findings: tuple[Finding, ...],
) -> str:
    """One-line explanation of a state that exists."""
    if verdict == "at the limit":
        return "at the limit: " + "; ".join(finding.words for finding in findings)
    if verdict == "equilibrium":
        count = len(reactions)
        if not count:
            return "equilibrium: the loads balance without a reaction"
        return f"equilibrium: {count} reaction{'' if count == 1 else 's'}, each with one value"
    loose = [name for name, span in ranges.items() if not span.determinate]
    endless = [
        name
        for name in loose
        if np.isinf(ranges[name].force).any() or np.isinf(ranges[name].torque).any()
    ]
    words = (
        f"indeterminate: {indeterminacy} independent state{'' if indeterminacy == 1 else 's'} of "
        f"self-stress; not unique: {', '.join(loose)}"
    )
    if endless:
        words += f"; unbounded (jammed): {', '.join(endless)}"
    return words


def _number(value: float) -> str:
    return f"{value:.6g}"


def _vector(vector: Array) -> str:
    return "(" + ", ".join(_number(0.0 if abs(v) < 1e-12 else float(v)) for v in vector) + ")"


def _direction(unit: Array) -> str:
    """x, y or z with sign if the unit vector is along an axis, else the vector."""
    largest = int(np.argmax(np.abs(unit)))
    if abs(abs(unit[largest]) - 1.0) < 1e-9:
        return ("" if unit[largest] > 0 else "-") + AXES[largest]
    return _vector(unit)


TOLERANCE = 1e-10
"""Half-width of the band called "at the limit", relative to the largest load."""


def solve(scene: Scene, *, tolerance: float = TOLERANCE, ranges: bool = True) -> StaticsResult:
    """The reactions that hold the bodies of a scene at rest, or why there is no equilibrium.

    tolerance: half-width of the band in which the verdict is "at the limit", relative to the
        largest load. Below 1e-12 the verdict depends on rounding.
    ranges: also find the range of every component if the reactions are not unique.
    """
    return solved(at_rest(scene), tolerance=tolerance, ranges=ranges)


def solved(
    system: Equilibrium, *, tolerance: float = TOLERANCE, ranges: bool = True
) -> StaticsResult:
    """As `solve`, for a given system."""
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


def _reactions(system: Equilibrium, reduced: Reduced, x: Array) -> dict[str, Reaction]:
    """Reactions in SI units for the scaled unknowns x."""
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
            friction=element.friction if element.has_friction else None,
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
    """Range of each component; nan if it is not unique and not `wanted`."""
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
    """[min, max] of row . x; equal if the value is unique."""
    value = float(row @ x)
    if not row.any() or admissible.fixed(row):
        return value, value
    if not wanted:
        return float("nan"), float("nan")
    low, high = admissible.least(row, inside), -admissible.least(-row, inside)
    size = float(np.abs(row).max())
    if high - low <= 10.0 * admissible.relax * size:
        return value, value  # the width is due to the relaxation
    round_off = admissible.reduced.round_off * size
    low, high = (0.0 if abs(end) <= round_off else end for end in (low, high))
    return min(low, value), max(high, value)


def balance(system: Equilibrium, reactions: dict[str, Reaction]) -> dict[str, tuple[Array, Array]]:
    """Sum of forces [N] and of torques about the centre of mass [N m] on each body, (3,) each."""
    centres, total, names = system.centres, system.load_about_centres(), list(system.bodies)
    for reaction in reactions.values():
        for body, point, force, torque in reaction.ends():
            if body is not None:
                row = names.index(body)
                total[row, :3] += force
                total[row, 3:] += torque + np.cross(point - centres[row], force)
    return {name: (total[row, :3], total[row, 3:]) for row, name in enumerate(names)}
