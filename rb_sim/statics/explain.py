"""The verdict in words: what gives, what is about to give, what is not unique."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rb_sim.statics.admissible import AdmissibleSet, Reduced
from rb_sim.statics.element import Bound, Element
from rb_sim.statics.equilibrium import Equilibrium
from rb_sim.statics.result import Finding, Reaction, ReactionRange, Verdict

Array = NDArray[np.float64]

AXES = ("x", "y", "z")
MINOR = 1e-6
"""share of the largest motion below which a body's part in it is not mentioned."""


def uncarried_loads(system: Equilibrium, reduced: Reduced) -> tuple[Finding, ...]:
    """Which balance fails, body by body, when no reaction could carry the load.

    The uncarried part of the load, read as a virtual motion (velocity of the pole and angular
    velocity of each body), is one that no support resists and on which the loads do work: the body
    starts to move that way, and the load along it is what nothing balances.
    """
    scaled = reduced.uncarried.reshape(-1, 2, 3)
    load = system.load.reshape(-1, 2, 3)
    lever = system.lever
    found: list[Finding] = []
    largest = float(np.abs(scaled).max())
    for name, pole, (push, turn), (force, torque) in zip(
        system.bodies, system.poles, scaled, load, strict=True
    ):
        if max(np.abs(push).max(), np.abs(turn).max()) <= MINOR * largest:
            continue
        speed, spin = float(np.linalg.norm(push)), float(np.linalg.norm(turn))
        if spin <= MINOR * speed:
            along = push / speed
            found.append(_failing_force(name, along, float(force @ along)))
        else:
            axis = turn / spin
            # velocity of the pole is push, angular velocity turn / lever: the screw's axis
            through = pole + np.cross(turn, push) / spin**2 * lever
            through = _support_on(system, name, through, axis)
            moment = float((torque + np.cross(pole - through, force)) @ axis)
            found.append(_failing_torque(name, axis, through, moment))
            pitch = float(push @ axis)
            if abs(pitch) > MINOR * (speed + spin):
                found.append(_failing_force(name, axis, float(force @ axis)))
    return tuple(found)


def _support_on(system: Equilibrium, body: str, through: Array, axis: Array) -> Array:
    """A point of support of the body on the axis, if there is one; else `through`."""
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
        f"nothing it is held by can carry {_number(amount)} N"
    )
    return Finding("force", name, amount, words)


def _failing_torque(name: str, axis: Array, through: Array, amount: float) -> Finding:
    words = (
        f"the torque balance of body '{name}' about {_direction(axis)} through {_vector(through)} "
        f"fails: nothing it is held by can carry {_number(amount)} N m"
    )
    return Finding("torque", name, amount, words)


def failing_supports(
    system: Equilibrium, reduced: Reduced, admissible: AdmissibleSet, widest: Array
) -> tuple[Finding, ...]:
    """The supports that give when the balance asks of them what they cannot do.

    Judged in the balanced state that asks the least: those that fall short of it by as much as the
    worst one (within a part in a thousand).
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
"""What is said of a contact beyond one of its bounds."""
TURNING = {"slips": "slipping", "rolls": "rolling", "spins": "spinning"}


def _gives(element: Element, bound: Bound | None, values: Array) -> Finding:
    """What a support would have to do and cannot."""
    first = float(values[0]) if bound is None or bound.push is None else bound.push
    if element.kind == "string":
        need = f"it would have to push with {_number(-first)} N"
        words = f"string '{element.name}' goes slack: {need}"
        return Finding("slack", element.name, -first, words)
    across = 0.0 if bound is None else float(np.linalg.norm(values[list(bound.tails)]))
    if bound is not None and first > 1e-9 * across:
        ratio = across / first
        wanting = WANTING[bound.gives].format(need=_number(ratio), has=_number(bound.coefficient))
        words = f"contact '{element.name}' {wanting}"
        if _number(ratio) == _number(bound.coefficient):
            words += f" (short by {ratio - bound.coefficient:.2g})"
        return Finding(bound.gives, element.name, ratio, words)
    words = f"contact '{element.name}' lifts: it would have to pull with {_number(-first)} N"
    return Finding("lifts", element.name, -first, words)


def explain_limit(
    system: Equilibrium, admissible: AdmissibleSet, widest: Array, tolerance: float
) -> tuple[Finding, ...]:
    """The supports that are on the point of giving in every admissible state."""
    x = admissible.at(widest)
    values = admissible.reduced.unit * x
    floor = 1e3 * tolerance * admissible.reduced.force
    by_name = {e.name: (e, c) for e, c in zip(system.elements, system.columns, strict=True)}
    found = []
    for (name, bound), gap in zip(admissible.owners, admissible.slack(x), strict=True):
        if gap > 2.0 * tolerance:
            continue
        element, column = by_name[name]
        first = float(values[column.start]) if bound is None or bound.push is None else bound.push
        if element.kind == "string":
            words = f"string '{name}' is on the point of going slack"
            found.append(Finding("slack", name, first, words))
        elif bound is not None and first > floor:
            words = f"contact '{name}' is on the point of {TURNING[bound.gives]}"
            found.append(Finding(bound.gives, name, bound.coefficient, words))
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
    """One line for a state that exists."""
    if verdict == "at the limit":
        return "at the limit: " + "; ".join(finding.words for finding in findings)
    if verdict == "equilibrium":
        count = len(reactions)
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
    """x, y, z with the sign where it is one of them, else the vector."""
    largest = int(np.argmax(np.abs(unit)))
    if abs(abs(unit[largest]) - 1.0) < 1e-9:
        return ("" if unit[largest] > 0 else "-") + AXES[largest]
    return _vector(unit)
