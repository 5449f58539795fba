"""What the hard cases showed: JSON, a page in Markdown, and a picture."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rb_sim.hard_cases.judge import FAILS, LIMIT, Case, Row

HEAD = """# Hard cases

Made by `rb_sim hard-cases --out DIR` (`hard-cases.md`, with `hard-cases.json` and
`hard-cases.png` beside it). Each case is a file in `config/hard_cases`; a folder of your own does
as well. The figure must stay below the bound; *limit* marks what does not hold today, said in its
case. CPU times are of one run on one machine, kernels %s.
%s
![Figure over bound of every case](pictures/hard-cases.png)

| case | method | step or tolerance | figure | is | bound | margin | CPU [s] | verdict |
|---|---|---|---|---|---|---|---|---|
"""


QUICK = """
What takes longer than some seconds is not in the table: it is that of `--quick`.
"""

PEERS = """
## Beside other engines

Made by `python -m benchmarks.hard_cases` in the same run: each engine with its best and its default
method (%s) over a ladder of steps, from one to a sample to 1024; the row is the best of the ladder.
Judged by the same formulas, or by the energy of the states it gives; what needs reactions or words
has no row, nor have cases with a part that an engine's description here lacks. *Better* and *equal*
compare the figure with rb_sim's own, which goes no further than its case asks for.

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
    picture(rows, paths[2])
    return paths


def write_json(path: Path, entries: Sequence[Mapping[str, Any]]) -> None:
    plain = [{key: finite(value) for key, value in entry.items()} for entry in entries]
    path.write_text(json.dumps(plain, indent=2) + "\n", encoding="utf-8")


def finite(value: object) -> object:
    """The value, or None for a number that JSON does not have."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def number(value: float) -> str:
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
            parts.append(f"\nBound {check.bound:.2g} of {what}: {sentence(check.because)}\n")
    if case.limit:
        parts.append(f"\nLimit: {sentence(case.limit)}\n")
    for engine, what in case.engines.items():
        parts.append(f"\n{engine}: {sentence(what)}\n")
    return "".join(parts)


def sentence(text: str) -> str:
    """One line that ends in a full stop."""
    line = " ".join(text.split())
    return line if line.endswith((".", ":")) else f"{line}."


def picture(rows: Sequence[Row], path: Path) -> None:
    """Figure over bound of every row, on a logarithmic axis."""
    from matplotlib.figure import Figure

    shown = [row for row in rows if row.check not in ("told", "refused")]
    figure = Figure(figsize=(9.0, 1.2 + 0.17 * len(shown)), layout="constrained")
    axes = figure.add_subplot()
    colours = {FAILS: "#c0392b", LIMIT: "#d68910"}
    for place, row in enumerate(shown):
        share = min(max(row.figure / row.bound, 1e-12), 1e6)
        axes.plot([1e-12, share], [place, place], color="0.88", lw=1.0, zorder=1)
        axes.plot(share, place, "o", ms=4, color=colours.get(row.verdict, "#1f618d"), zorder=2)
    axes.axvline(1.0, color="0.3", lw=1.0)
    axes.set_xscale("log")
    axes.set_yticks(range(len(shown)))
    axes.set_yticklabels([f"{row.case}, {row.method} ({row.check})" for row in shown], fontsize=6)
    axes.set_ylim(len(shown) - 0.3, -0.7)
    axes.set_xlabel("figure over bound (left of 1 holds; 1e-12 and below at the left edge)")
    axes.set_title("Hard cases: what is left of each bound", loc="left", fontsize=10)
    figure.savefig(path, dpi=130)
