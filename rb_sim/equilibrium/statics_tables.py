# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The result of statics: as data, as a table for the terminal, as JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from rich.text import Text

from rb_sim.base.plain_data import finite
from rb_sim.scene.schema import Scene

Array = NDArray[np.float64]

Verdict = Literal["equilibrium", "indeterminate", "at the limit", "no equilibrium"]


@dataclass(frozen=True)
class Reaction:
    """Wrench BY a support ON its body, world axes; the parent feels the opposite force."""

    kind: str
    body: str
    parent: str | None
    """None is the world."""
    force: Array
    """[N], (3,)."""
    torque: Array
    """about the anchor [N m], (3,)."""
    anchor: Array
    """point of application on the body, world [m], (3,)."""
    parent_anchor: Array
    """point of application of the opposite force on the parent, world [m], (3,)."""
    direction: Array | None
    """normal of a contact, direction of a string or rod away from the body; world, (3,)."""
    along: float | None
    """force along `direction`: normal force, or tension (negative in compression) [N]."""
    friction: float | None
    """coefficient of friction; inf for rough, None without friction."""

    @property
    def friction_used(self) -> float | None:
        """tangential force| / normal force of a frictional contact; nan without normal force."""
        if self.friction is None or self.direction is None or self.along is None:
            return None
        across = float(np.linalg.norm(self.force - self.along * self.direction))
        return across / self.along if self.along > 0.0 else float("nan")

    def ends(self) -> list[tuple[str | None, Array, Array, Array]]:
        """(body, point, force, torque) at both ends: action and reaction."""
        return [
            (self.body, self.anchor, self.force, self.torque),
            (self.parent, self.parent_anchor, -self.force, -self.torque),
        ]


@dataclass(frozen=True)
class ReactionRange:
    """Smallest and largest value of each component over admissible reactions; inf: unbounded."""

    force: Array
    """world axes [N], (3, 2)."""
    torque: Array
    """world axes, about the anchor [N m], (3, 2)."""
    along: Array | None
    """tension or normal force [N], (2,)."""
    determinate: bool
    """all components have one value."""

    @property
    def undetermined(self) -> dict[str, list[float]]:
        """[min, max] of each component that has more than one value: force_x to torque_z."""
        spans = {"force": self.force, "torque": self.torque}
        return {
            f"{kind}_{axis}": [float(low), float(high)]
            for kind, values in spans.items()
            for axis, (low, high) in zip("xyz", values, strict=True)
            if low != high
        }


@dataclass(frozen=True)
class Finding:
    """A support that fails or would fail first, or a body whose balance fails."""

    kind: Literal["slack", "lifts", "slips", "rolls", "spins", "force", "torque"]
    """a string goes slack, a contact lifts, slips, rolls or spins, a body's force or torque is not
    balanced."""
    name: str
    """the support, or the body whose balance fails."""
    amount: float
    """missing pull or push [N]; required friction coefficient, or arm [m]; uncarried force [N] or
    torque [N m]."""
    words: str


@dataclass(frozen=True)
class StaticsResult:
    """Verdict on an equilibrium, reactions by the supports on the bodies, and their ranges."""

    verdict: Verdict
    explanation: str
    reactions: dict[str, Reaction]
    """Reactions; the minimum-norm ones if there are many; empty without equilibrium."""
    ranges: dict[str, ReactionRange]
    """Ranges of the reactions; empty without equilibrium, or if not requested."""
    indeterminacy: int
    """Number of independent states of self-stress."""
    mobility: int
    """Number of independent motions that no support resists in either direction."""
    margin: float
    """Distance of the safest state from slack, lift-off and slip as tension or normal force over
    the largest load, at most 1; negative: no equilibrium; nan: no state balances the loads."""
    tolerance: float
    """Largest |margin| and imbalance that count as "at the limit": the value requested, or the
    accuracy of the margin if that is larger."""
    accuracy: float
    """Bound of the error of ranges and minimum-norm reactions, over the largest load."""
    balance: dict[str, tuple[Array, Array]]
    """Sum of forces [N] and of torques about the centre of mass [N m] on each body, world axes,
    which should be 0; empty without equilibrium."""
    findings: tuple[Finding, ...] = field(default=())
    apart: tuple[str, ...] = ()
    """Contacts whose surfaces do not touch and which carry nothing."""

    @property
    def determinate(self) -> bool:
        """Whether all reactions have exactly one value."""
        return bool(self.reactions) and all(r.determinate for r in self.ranges.values())


AXES = ("x", "y", "z")
COLOURS = {
    "equilibrium": "green",
    "indeterminate": "yellow",
    "at the limit": "yellow",
    "no equilibrium": "red",
}


def print_report(scene: Scene, result: StaticsResult, console: Console) -> None:
    """Print the verdict, then one line for each component of a reaction that can be non-zero."""
    if scene.description:
        console.print(Text(scene.description))
    console.print(Text(result.explanation, style=f"bold {COLOURS[result.verdict]}"))
    if result.apart:
        console.print(Text(f"not touching: {_listed(result.apart)}", style="dim"))
    if not result.reactions:
        return
    table = Table(title="Reactions by the support on the body, world axes", title_justify="left")
    for heading in ("support", "kind", "on", "component"):
        table.add_column(heading, no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("range", no_wrap=True)
    scale = max(float(np.abs(r.force).max()) for r in result.reactions.values())
    for name, reaction in result.reactions.items():
        rows = list(_lines(reaction, result.ranges[name], scale))
        for i, (component, value, span) in enumerate(rows):
            head = (name, reaction.kind, _on(reaction)) if i == 0 else ("", "", "")
            table.add_row(*head, component, value, span, end_section=i == len(rows) - 1)
    console.print(table)
    console.print(Text(_closing_line(result), style="dim"))


def _listed(names: tuple[str, ...], most: int = 8) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _on(reaction: Reaction) -> str:
    return reaction.body if reaction.parent is None else f"{reaction.body} by {reaction.parent}"


def _lines(reaction: Reaction, span: ReactionRange, scale: float):
    """Yield (component, value, range) of each component that can be non-zero."""
    tiny = 1e-12 * scale
    if reaction.along is not None and span.along is not None:
        word = {"contact": "normal N", "string": "tension T"}.get(reaction.kind, "pull S")
        yield word, f"{_clean(reaction.along, tiny):.6g} N", _span_text(span.along, "N", tiny)
    for unit, letter, values, ranges in (
        ("N", "R", reaction.force, span.force),
        ("N m", "K", reaction.torque, span.torque),
    ):
        for axis, value, (low, high) in zip(AXES, values, ranges, strict=True):
            if abs(value) > tiny or low < -tiny or high > tiny:
                text = f"{_clean(value, tiny):.6g} {unit}"
                yield f"{letter}_{axis}", text, _span_text((low, high), unit, tiny)


def _span_text(span: Any, unit: str, tiny: float) -> str:
    low, high = (float(end) for end in span)
    if low == high:
        return ""
    if math.isnan(low):
        return "not unique"
    left = "unbounded" if math.isinf(low) else f"{_clean(low, tiny):.6g}"
    right = "unbounded" if math.isinf(high) else f"{_clean(high, tiny):.6g}"
    return f"{left} to {right} {unit}"


def _clean(value: float, tiny: float) -> float:
    return 0.0 if abs(value) <= tiny else value


def _closing_line(result: StaticsResult) -> str:
    worst = max((float(np.abs(force).max()) for force, _ in result.balance.values()), default=0.0)
    turn = max((float(np.abs(torque).max()) for _, torque in result.balance.values()), default=0.0)
    loose = "" if result.accuracy <= 1e-9 else f", ranges good to {result.accuracy:.1g} of it"
    return (
        f"self-stress states {result.indeterminacy}, motions left free {result.mobility}, "
        f"margin {result.margin:.3g} of the largest load{loose}, "
        f"balance closes to {worst:.1e} N and {turn:.1e} N m"
    )


def as_dict(scene: Scene, result: StaticsResult) -> dict[str, Any]:
    """The result in plain types; infinite and nan values become null."""
    return {
        "scene": scene.name,
        "description": scene.description,
        "verdict": result.verdict,
        "explanation": result.explanation,
        "indeterminacy": result.indeterminacy,
        "mobility": result.mobility,
        "margin": finite(result.margin),
        "tolerance": result.tolerance,
        "accuracy": result.accuracy,
        "not_touching": list(result.apart),
        "findings": [
            {"kind": f.kind, "name": f.name, "amount": finite(f.amount), "words": f.words}
            for f in result.findings
        ],
        "reactions": {
            name: _reaction(reaction, result.ranges[name])
            for name, reaction in result.reactions.items()
        },
        "balance": {
            name: {"force_N": force.tolist(), "torque_Nm": torque.tolist()}
            for name, (force, torque) in result.balance.items()
        },
    }


def _reaction(reaction: Reaction, span: ReactionRange) -> dict[str, Any]:
    plain: dict[str, Any] = {
        "kind": reaction.kind,
        "body": reaction.body,
        "parent": reaction.parent,
        "anchor_m": reaction.anchor.tolist(),
        "force_N": reaction.force.tolist(),
        "torque_Nm": reaction.torque.tolist(),
        "force_range_N": _ends(span.force),
        "torque_range_Nm": _ends(span.torque),
        "determinate": span.determinate,
    }
    if reaction.along is not None and span.along is not None:
        plain |= {"along_N": reaction.along, "along_range_N": _ends(span.along)}
    if reaction.friction_used is not None:
        plain["friction_used"] = finite(reaction.friction_used)
    return plain


def _ends(ranges: np.ndarray) -> list[Any]:
    return [_ends(row) if row.ndim else finite(float(row)) for row in ranges]
