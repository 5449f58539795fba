# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Hard cases: loaded from files, run with each of their settings, judged, and reported.

The report consists of JSON, a Markdown page, and a picture.
"""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field, Strict, model_validator

from rb_sim.accuracy.checks.check import effort_of
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.accuracy.runs import pose_gaps
from rb_sim.base.errors import RbSimError
from rb_sim.base.names import one_of
from rb_sim.base.palette import BAD, FAINT, GOOD, NARROW, TEXT
from rb_sim.base.plain_data import write_json
from rb_sim.catalogue.spec import Spec, refuse, refuse_at
from rb_sim.scene.listing import find_scene
from rb_sim.scene.load import load_scene
from rb_sim.scene.schema import METHODS
from rb_sim.scene.yaml_reader import parse, read_text, validated
from rb_sim.simulation.simulation import Simulation
from rb_sim.simulation.trajectory import Trajectory
from rb_sim.sweeps.expressions import Expression

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout


# A case: a scene, its runs, checks with bounds, and why it is hard; one YAML file each.


SUFFIX = ".yaml"


class Setting(Spec):
    """Settings of one run of the scene."""

    method: Literal[METHODS]  # type: ignore[valid-type]
    step: float | None = Field(default=None, gt=0.0)
    tolerance: float | None = Field(default=None, gt=0.0)
    duration: float | None = Field(default=None, gt=0.0)
    """instead of the scene's, if the method needs more steps [s]."""


class Check(Spec):
    """A check of every run.

    Figures: energy: (change of energy - work) / energy exchanged. momentum: the worse of both
    balances. residual: constraint violation. formula: largest absolute value of a formula over the
    samples. against: largest pose difference from another setting. warned: 0 if a check warns or
    the run is refused, else 1. refused: 0 if the run ends with an error, else 1.
    """

    figure: Literal["energy", "momentum", "residual", "formula", "against", "warned", "refused"]
    formula: str = ""
    against: Setting | None = None
    words: str = ""
    """pattern that the message must match, for refused and warned."""
    bound: float = Field(default=0.5, gt=0.0)
    because: str = ""
    """derivation of the bound from order, step and conditioning."""

    @model_validator(mode="after")
    def _complete(self) -> Check:
        needed = {"formula": self.formula, "against": self.against}
        if not needed.get(self.figure, "nothing"):
            allowed = refuse(f"given for figure {self.figure}")
            raise refuse_at(((self.figure,), needed[self.figure], allowed))
        return self


def _some(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if not values:
        raise refuse("a list that is not empty")
    return values


class Case(Spec):
    """One hard case."""

    title: str
    theme: str = "other"
    """group in the picture."""
    why: str
    """why it is hard."""
    engines: Mapping[str, str] = {}
    """engines known to fail it, and how; or known to pass it."""
    quick: bool = False
    """whether it is cheap enough for `--quick` and for every test run."""
    limit: str = ""
    """bound that does not hold at present, and why: failures then count as a known limit."""
    scene: Mapping[str, Any] | str
    """as in a scene file, or the name of a shipped scene."""
    runs: Annotated[tuple[Setting, ...], Strict(False), AfterValidator(_some)]
    checks: Annotated[tuple[Check, ...], Strict(False), AfterValidator(_some)]
    name: str = ""


def load_case(path: Path) -> Case:
    """The case in a file. Raises RbSimError in one line if it is not valid."""
    mapping = parse(read_text(path), str(path))
    if not isinstance(mapping, Mapping):
        raise RbSimError(f"{path}: a case must be a mapping with title, why, scene, runs, checks")
    return validated(Case, {**mapping, "name": path.stem}, str(path))


def load_cases(folder: Path, only: Sequence[str] = ()) -> list[Case]:
    """The cases of a folder whose names contain one of the parts `only`; all if it is empty.

    Raises RbSimError if there are none, or none for one of the parts.
    """
    paths = sorted(folder.glob(f"*{SUFFIX}"))
    names = [path.stem for path in paths]
    if not paths:
        raise RbSimError(f"{folder}: has no case (a file *{SUFFIX})")
    for part in only:
        if not any(part in name for name in names):
            raise RbSimError(f"{part}: no case has it in its name; must be {one_of(part, names)}")
    wanted = [path for path in paths if not only or any(part in path.stem for part in only)]
    return [load_case(path) for path in wanted]


# Formulas over the samples of a run.
#
# Expressions as in sweeps. Names: t; for each body B: B_x B_y B_z, B_vx B_vy B_vz (centre of
# mass, world), B_wx B_wy B_wz (body axes), B_qx B_qy B_qz B_qw; for each reaction R: R_fx R_fy
# R_fz, R_tx R_ty R_tz; energy, kinetic, potential, residual; pi.


FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, name) for name in ("cosh", "sinh", "tanh", "hypot")},
    **{"atan": np.arctan, "max": np.maximum},
}
"""Functions in addition to those of expressions; max takes two arguments."""


def largest(formula: str, block: SampleBlock, layout: SampleLayout) -> float:
    """Largest absolute value of the formula over the samples; infinite if it is not finite.

    Raises RbSimError for an invalid formula or unknown names.
    """
    found = np.asarray(Expression(formula, "formula").value(columns(block, layout), FUNCTIONS))
    if found.dtype.kind not in "bif" or found.ndim > 1:
        raise RbSimError(f"formula {formula!r}: must be a number at each sample")
    return float(np.nan_to_num(abs(found.astype(float)), nan=np.inf, posinf=np.inf).max())


def columns(block: SampleBlock, layout: SampleLayout) -> dict[str, Any]:
    """Names and values allowed in a formula."""
    names: dict[str, Any] = {"t": block.t, "pi": np.pi, "residual": block.residual}
    names |= {"energy": block.energy, "kinetic": block.kinetic_energy}
    names["potential"] = block.potential_energy
    for i, body in enumerate(layout.bodies):
        names |= components(f"{body}_", block.position[:, i], "xyz")
        names |= components(f"{body}_v", block.linear_velocity[:, i], "xyz")
        names |= components(f"{body}_w", block.angular_velocity[:, i], "xyz")
        names |= components(f"{body}_q", block.orientation[:, i], "xyzw")
    for i, reaction in enumerate(layout.reactions):
        names |= components(f"{reaction}_f", block.reaction_force[:, i], "xyz")
        names |= components(f"{reaction}_t", block.reaction_torque[:, i], "xyz")
    return names


def components(start: str, values: Array, letters: str) -> dict[str, Array]:
    """Components by name."""
    return {f"{start}{letter}": values[:, k] for k, letter in enumerate(letters)}


# Runs and figures of a case.


HOLDS, FAILS, LIMIT = "holds", "FAILS", "limit"
"""Verdicts; limit: the bound does not hold, as documented in the case."""

MOST_STEPS = 5e7
"""Number of steps between two samples above which a run is abandoned as stuck."""


class Row(NamedTuple):
    """One line of the table."""

    case: str
    method: str
    knob: str
    """the step or the tolerance."""
    check: str
    figure: float
    bound: float
    seconds: float
    """CPU time of the run."""
    verdict: str
    message: str
    """message of an error or a check, or ""."""

    @property
    def margin(self) -> float:
        """Bound divided by figure."""
        return self.bound / self.figure if self.figure > 0.0 else float("inf")


class Outcome(NamedTuple):
    """Result of one run."""

    run: Trajectory | None
    check_list: CheckList | None
    error: str
    seconds: float


def rows_of(case: Case) -> Iterator[Row]:
    """Yield the rows of a case as they are measured."""
    for setting in case.runs:
        outcome = run(case, setting)
        for check in case.checks:
            figure, message = measure(case, check, outcome)
            holds = figure <= check.bound
            verdict = HOLDS if holds else LIMIT if case.limit else FAILS
            knob = f"{setting.step:g} s" if setting.step is not None else f"{setting.tolerance:g}"
            yield Row(
                case.name, setting.method, knob, check.figure, figure, check.bound,
                outcome.seconds, verdict, message,
            )  # fmt: skip


def run(case: Case, setting: Setting) -> Outcome:
    """Run the case with one setting, with all checks."""
    from rb_sim.motion.motion import Limits

    given = {
        name: value
        for name in ("method", "step", "tolerance", "duration")
        if (value := getattr(setting, name)) is not None
    }
    source: Any = find_scene(case.scene) if isinstance(case.scene, str) else case.scene
    began = time.process_time()
    check_list = blocks = None
    try:
        simulation = Simulation(load_scene(source, **given))
        simulation.warm()
        began = time.process_time()
        options = simulation.scene.simulation
        blocks = []
        check_list = CheckList(simulation.scene, simulation.layout, simulation.compiled)
        limits = Limits(steps=MOST_STEPS)
        with np.errstate(all="ignore"):
            for block in simulation.blocks(options.duration, options.rate, limits=limits):
                check_list.add(block, partial(effort_of, simulation))
                blocks.append(block)
        seconds = time.process_time() - began
    except (RbSimError, ZeroDivisionError) as error:
        # plain Python raises on division by zero, compiled code continues with infinity and NaN
        return Outcome(None, check_list, str(error) or "division", time.process_time() - began)
    from rb_sim.mechanics.samples import concatenate

    whole = concatenate(blocks, simulation.layout)
    return Outcome(Trajectory(whole, simulation.layout), check_list, "", seconds)


def measure(hard: Case, check: Check, outcome: Outcome) -> tuple[float, str]:
    """(figure, message); infinite if the run did not complete."""
    findings = outcome.check_list.findings if outcome.check_list is not None else ()
    lines = [outcome.error] if outcome.error else [str(finding) for finding in findings]
    message = lines[0] if lines else ""
    if check.figure in ("warned", "refused"):
        spoken = lines if outcome.error or check.figure == "warned" else []
        found = [line for line in spoken if re.search(check.words, line)]
        return (0.0, found[0]) if found else (1.0, message)
    if outcome.run is None or outcome.check_list is None:
        return float("inf"), message
    ledger = outcome.check_list.ledger
    match check.figure:
        case "energy":
            figure = (ledger.energy() or {"relative": None})["relative"] or 0.0
        case "momentum":
            relative = [b["relative"] or 0.0 for b in (ledger.momentum() or {}).values()]
            figure = max(relative, default=float("inf"))
        case "residual":
            figure = outcome.run.residual.max()
        case "formula":
            figure = largest(check.formula, outcome.run.block, outcome.run.layout)
        case _:
            figure = _apart(hard, check, outcome.run)
    return float(figure), message


def _apart(hard: Case, check: Check, own: Trajectory) -> float:
    """Largest pose difference [m, rad] from the run with another setting."""
    assert check.against is not None
    other = run(hard, check.against).run
    if other is None or len(other) != len(own):
        return float("inf")
    poses = (np.dstack([r.block.position, r.block.orientation]) for r in (own, other))
    return float(max(gap.max() for gap in pose_gaps(*poses)))


HEAD = """---
search: {exclude: true}
hide: [toc, navigation]
---

# Hard cases

Made by `rb_sim hard-cases --out DIR` (`hard-cases.md`, with `hard-cases.json` and
`hard-cases.png` beside it). Each case is a file in `config/hard_cases`; the command also takes a
folder of your own cases. A case holds if the figure (column *is*) stays below the bound; *margin*
is bound over figure. *Limit* marks a bound that does not hold today; the case states why. CPU times
are of one run on one machine, kernels %s.
%s
![Margin of every case](pictures/hard-cases.png)

| case | method | step or tolerance | figure | is | bound | margin | CPU [s] | verdict |
|---|---|---|---|---|---|---|---|---|
"""


QUICK = """
The table is that of `--quick`: cases that take more than some seconds are not in it.
"""


def write(
    folder: Path,
    cases: Sequence[Case],
    rows: Sequence[Row],
    quick: bool = False,
    beside: str = "",
) -> list[Path]:
    """Write the three files into the folder. beside: Markdown below the table. Raises OSError."""
    paths = [folder / f"hard-cases.{kind}" for kind in ("json", "md", "png")]
    write_json([{**row._asdict(), "margin": row.margin} for row in rows], paths[0])
    paths[1].write_text(markdown(cases, rows, quick, beside), encoding="utf-8")
    picture(cases, rows, paths[2])
    return paths


def number(value: float) -> str:
    """Two significant digits; "-" if not finite."""
    return f"{value:.2g}" if math.isfinite(value) else "-"


def markdown(
    cases: Sequence[Case], rows: Sequence[Row], quick: bool = False, beside: str = ""
) -> str:
    """The Markdown page: the table, `beside`, and for each case its description, bounds and failing
    engines."""
    lines = [
        f"| {row.case} | {row.method} | {row.knob} | {row.check} | {number(row.figure)} "
        f"| {row.bound:.2g} | {number(row.margin)} | {row.seconds:.2g} | {row.verdict} |\n"
        for row in rows
    ]
    plain = os.environ.get("RB_SIM_INTERPRETED") == "1"
    how = "as plain Python (RB_SIM_INTERPRETED=1)" if plain else "compiled before"
    head = HEAD % (how, QUICK if quick else "")
    return head + "".join([*lines, beside, *map(described, cases)])


def described(case: Case) -> str:
    """Markdown section of one case."""
    parts = [f"\n## {case.name}\n\n{sentence(case.title)} {sentence(case.why)}\n"]
    for check in case.checks:
        if check.because:
            what = f"`{check.formula}`" if check.formula else check.figure
            parts.append(f"\nBound {check.bound:.2g} of {what}. {sentence(check.because)}\n")
    if case.limit:
        parts.append(f"\nLimit: {sentence(case.limit)}\n")
    for engine, what in case.engines.items():
        parts.append(f"\n{engine}: {sentence(what)}\n")
    return "".join(parts)


def sentence(text: str) -> str:
    """One line that starts with a capital (except names like rk4) and ends with a full stop."""
    line = " ".join(text.split())
    if line.partition(" ")[0].rstrip(",:").replace("-", "").isalpha():
        line = line[:1].upper() + line[1:]
    return line if line.endswith((".", ":")) else f"{line}."


WIDE = 10.0
"""Margin below which a case is marked."""

FARTHEST = 1e8
"""Largest margin drawn; larger ones are clipped."""

COLUMNS = 3
MARKER = 5.0
"""Diameter of the dot for a case's smallest margin [points]."""


def picture(cases: Sequence[Case], rows: Sequence[Row], path: Path) -> None:
    """Draw the margins (bound divided by figure), one line per case, grouped by theme, smallest
    first, on one page."""
    from matplotlib.figure import Figure

    groups: dict[str, list[str]] = {}
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.case, []).append(row)
    for case in cases:
        if case.name in found:
            groups.setdefault(case.theme, []).append(case.name)
    for names in groups.values():
        names.sort(key=lambda name: (least_margin(found[name]), name))
    columns = balanced([(theme, *names) for theme, names in groups.items()])
    height = max(len(column) for column in columns)
    figure = Figure(figsize=(4.7 * len(columns), 1.5 + 0.2 * height), layout="constrained")
    for axes, column in zip(figure.subplots(1, len(columns), squeeze=False)[0], columns,
                            strict=True):  # fmt: skip
        for place, (name, is_theme) in enumerate(column):
            if is_theme:
                axes.text(0.0, place, name, transform=axes.get_yaxis_transform(), fontsize=9,
                          fontweight="bold", va="center", ha="left", color=TEXT,
                          bbox={"facecolor": "white", "edgecolor": "none", "pad": 2})  # fmt: skip
            elif name:
                draw_case(axes, place, found[name])
        axes.set_xscale("log")
        axes.set_xlim(0.1, FARTHEST)
        axes.axvline(1.0, color=TEXT, lw=1.0, zorder=1)
        axes.axvspan(0.1, 1.0, color="0.93", lw=0, zorder=0)
        axes.set_yticks([k for k, (name, is_theme) in enumerate(column) if name and not is_theme])
        axes.set_yticklabels([name for name, is_theme in column if name and not is_theme],
                             fontsize=7)  # fmt: skip
        axes.set_ylim(height - 0.4, -0.8)
        axes.set_xlabel("bound over error (at the right edge: 1e8 or more)", fontsize=8)
        axes.tick_params(labelsize=7, length=0)
        axes.spines[["top", "right", "left"]].set_visible(False)
    figure.suptitle("Hard cases: margin to the bound of each check (large: least of its case)",
                    x=0.01, ha="left", fontsize=11, color=TEXT)  # fmt: skip
    figure.legend(
        handles=[*legend()], loc="outside lower center", ncols=5, frameon=False, fontsize=8
    )
    figure.savefig(path, dpi=110)


def balanced(groups: Sequence[Sequence[str]]) -> list[list[tuple[str, bool]]]:
    """The groups (theme and its names) in COLUMNS columns of similar height, longest first.

    A line is a text and whether it is a theme; groups are separated by an empty line."""
    columns: list[list[tuple[str, bool]]] = [[] for _ in range(min(COLUMNS, len(groups)))]
    for theme, *names in sorted(groups, key=lambda group: -len(group)):
        column = min(columns, key=len)
        column += [("", False)] * bool(column) + [(theme, True)]
        column += [(name, False) for name in names]
    return columns


def is_words(row: Row) -> bool:
    """Whether the check expects a message, not a figure."""
    return row.check in ("warned", "refused")


def least_margin(rows: Sequence[Row]) -> float:
    """Smallest margin of a case; infinite without a figure."""
    return min((row.margin for row in rows if not is_words(row)), default=math.inf)


def colour_of(row: Row) -> str:
    """Colour by margin, or by verdict if the bound does not hold."""
    return BAD if row.verdict in (FAILS, LIMIT) else NARROW if row.margin < WIDE else GOOD


def draw_case(axes: Any, place: int, rows: Sequence[Row]) -> None:
    """Draw a dot for each check, large for the smallest margin; message checks as text."""
    figures = sorted((row for row in rows if not is_words(row)), key=lambda row: row.margin)
    axes.plot([0.1, FARTHEST], [place, place], color="0.92", lw=0.6, zorder=1)
    for k, row in reversed([*enumerate(figures)]):
        axes.plot(
            min(max(row.margin, 0.12), 0.8 * FARTHEST), place, "o", zorder=3 if k else 4,
            ms=0.5 * MARKER if k else MARKER, color=colour_of(row), alpha=0.45 if k else 1.0,
            markerfacecolor="white" if row.verdict == LIMIT else colour_of(row), clip_on=False,
        )  # fmt: skip
    if figures and figures[0].margin < WIDE:
        axes.text(min(1.7 * max(figures[0].margin, 0.12), FARTHEST), place,
                  f"{figures[0].margin:.1f}×", fontsize=7, va="center", color=colour_of(figures[0]),
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
                  zorder=5)  # fmt: skip
    words = [row for row in rows if is_words(row)]
    if words:
        missed = any(row.verdict == FAILS for row in words)
        kind = "refused" if all(row.check == "refused" for row in words) else "warned"
        axes.text(1.6, place, f"not {kind}" if missed else f"{kind}, as it must be", fontsize=7,
                  va="center", style="italic", color=BAD if missed else FAINT,
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})  # fmt: skip


def legend() -> Iterator[Any]:
    """Legend of the dots."""
    from matplotlib.lines import Line2D

    for colour, face, label in (
        (GOOD, GOOD, f"margin {WIDE:g} or more"),
        (NARROW, NARROW, f"margin below {WIDE:g}"),
        (BAD, BAD, "fails"),
        (BAD, "white", "known limit"),
    ):
        yield Line2D([], [], marker="o", ls="", ms=MARKER, color=colour, markerfacecolor=face,
                     label=label)  # fmt: skip
