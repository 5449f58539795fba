# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the hard cases showed: JSON, a page in Markdown, and a picture."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rb_sim.base.palette import BAD, FAINT, GOOD, NARROW, TEXT
from rb_sim.hard_cases.judge import FAILS, LIMIT, Case, Row

HEAD = """---
search: {exclude: true}
hide: [toc]
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

PEERS = """
## Beside other engines

Made by `python -m benchmarks.hard_cases` in the same run: each engine with its best and its default
method (%s) at steps of a sample period down to 1/1024 of it; the row is the best step.
Judged by the same formulas, or by the energy of the states it gives; checks of reactions or
messages have no row, nor have cases with a part that an engine's description here lacks. *Better*
and *equal* compare the figure with rb_sim's own, which is only as accurate as its case needs.

| case | engine | figure | method | step [s] | is | bound | rb_sim | CPU [s] | verdict |
|---|---|---|---|---|---|---|---|---|---|
"""


class PeerRow(NamedTuple):
    """The best that an engine gave for one check of a case."""

    case: str
    engine: str
    check: str
    method: str
    step: float
    figure: float
    bound: float
    ours: float
    """the best figure of rb_sim's rows."""
    seconds: float
    """CPU time of that run."""
    verdict: str


def write(
    folder: Path,
    cases: Sequence[Case],
    rows: Sequence[Row],
    peers: Sequence[PeerRow] = (),
    quick: bool = False,
) -> list[Path]:
    """Write the three files into the folder, four with rows of peers. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"hard-cases.{kind}" for kind in ("json", "md", "png")]
    write_json(paths[0], [{**row._asdict(), "margin": row.margin} for row in rows])
    paths[1].write_text(markdown(cases, rows, peers, quick), encoding="utf-8")
    if peers:
        paths.append(folder / "hard-cases-peers.json")
        write_json(paths[-1], [row._asdict() for row in peers])
    picture(cases, rows, paths[2])
    return paths


def write_json(path: Path, entries: Sequence[Mapping[str, Any]]) -> None:
    """Write the entries as a JSON list; numbers that are not finite become null."""
    plain = [{key: finite(value) for key, value in entry.items()} for entry in entries]
    path.write_text(json.dumps(plain, indent=2) + "\n", encoding="utf-8")


def finite(value: object) -> object:
    """The value, or None for a number that JSON does not have."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def number(value: float) -> str:
    """Two significant digits; "-" if not finite."""
    return f"{value:.2g}" if math.isfinite(value) else "-"


def markdown(
    cases: Sequence[Case], rows: Sequence[Row], peers: Sequence[PeerRow] = (), quick: bool = False
) -> str:
    """The tables, and what each case is, why its bound is what it is, and who fails it."""
    lines = [
        f"| {row.case} | {row.method} | {row.knob} | {row.check} | {number(row.figure)} "
        f"| {row.bound:.2g} | {number(row.margin)} | {row.seconds:.2g} | {row.verdict} |\n"
        for row in rows
    ]
    plain = os.environ.get("RB_SIM_INTERPRETED") == "1"
    how = "as plain Python (RB_SIM_INTERPRETED=1)" if plain else "compiled before"
    head = HEAD % (how, QUICK if quick else "")
    return head + "".join([*lines, beside(peers), *map(described, cases)])


def beside(peers: Sequence[PeerRow]) -> str:
    """The table of the other engines; "" without rows."""
    if not peers:
        return ""
    engines = dict.fromkeys(row.engine for row in peers)
    lines = [
        f"| {row.case} | {row.engine} | {row.check} | {row.method} | {row.step:.2g} "
        f"| {number(row.figure)} | {row.bound:.2g} | {number(row.ours)} | {row.seconds:.2g} "
        f"| {row.verdict} |\n"
        for row in peers
    ]
    return PEERS % ", ".join(engines) + "".join(lines)


def described(case: Case) -> str:
    """The section of one case."""
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
    """One line that begins with a capital, but for names like rk4, and ends in a full stop."""
    line = " ".join(text.split())
    if line.partition(" ")[0].isalpha():
        line = line[:1].upper() + line[1:]
    return line if line.endswith((".", ":")) else f"{line}."


WIDE = 10.0
"""Margin below which a case is marked."""

FARTHEST = 1e8
"""Margins are drawn up to here."""

COLUMNS = 3
MARKER = 5.0
"""Diameter of the dot of a case's least margin [points]."""


def picture(cases: Sequence[Case], rows: Sequence[Row], path: Path) -> None:
    """The margins of every case, bound over figure: a line a case, grouped by theme, the least
    first; on one page."""
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
    """The groups, a theme and its names each, in COLUMNS of about one height; the longest first.
    A line is a text and whether it is a theme; an empty one is between groups."""
    columns: list[list[tuple[str, bool]]] = [[] for _ in range(min(COLUMNS, len(groups)))]
    for theme, *names in sorted(groups, key=lambda group: -len(group)):
        column = min(columns, key=len)
        column += [("", False)] * bool(column) + [(theme, True)]
        column += [(name, False) for name in names]
    return columns


def is_words(row: Row) -> bool:
    """Whether what must come is a message, not a figure."""
    return row.check in ("warned", "refused")


def least_margin(rows: Sequence[Row]) -> float:
    """The least of a case; beyond all others without a figure."""
    return min((row.margin for row in rows if not is_words(row)), default=math.inf)


def colour_of(row: Row) -> str:
    """That of its margin, or of its verdict where it does not hold."""
    return BAD if row.verdict in (FAILS, LIMIT) else NARROW if row.margin < WIDE else GOOD


def draw_case(axes: Any, place: int, rows: Sequence[Row]) -> None:
    """A dot for each check of each run, large that with the least margin; words as words."""
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
    """What the dots mean."""
    from matplotlib.lines import Line2D

    for colour, face, label in (
        (GOOD, GOOD, f"margin {WIDE:g} or more"),
        (NARROW, NARROW, f"margin below {WIDE:g}"),
        (BAD, BAD, "fails"),
        (BAD, "white", "known limit"),
    ):
        yield Line2D([], [], marker="o", ls="", ms=MARKER, color=colour, markerfacecolor=face,
                     label=label)  # fmt: skip
