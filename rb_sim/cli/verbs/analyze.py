# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim analyze`: analysis of a recorded bag as table, JSON, CSV, Parquet and report."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import Any

from rb_sim.bags.analysis.analysis_page import (
    MOST,
    Aligned,
    Analysis,
    Table,
    digits,
    has_forces,
    tables,
    write_report,
)
from rb_sim.base.errors import RbSimError
from rb_sim.base.plain_data import finite, json_text, write_json
from rb_sim.cli.options import AnalyzeOptions
from rb_sim.cli.plain import columns, plain_console, warn

ELSEWHERE = " (all with --json or --out DIR)"


def analyze(options: AnalyzeOptions) -> int:
    """Analyze a bag, print and write the results; returns 0. Raises RbSimError."""
    from rb_sim.bags.analysis.bodies import masses_of, scene_of
    from rb_sim.bags.analysis.recorded_run import analyze as read
    from rb_sim.simulation.outputs import make_folder, writing

    if options.parquet and options.out is None:
        raise RbSimError("--parquet: give the folder of the results as --out DIR")
    scene = None if options.masses is None else scene_of(options.masses)
    masses = None if options.masses is None else masses_of(options.masses)
    table = None if options.out is None else Aligned()
    if options.out is not None:
        make_folder(options.out)
    topics = frozenset(options.topic or ()) or None
    found = read(options.bag, topics=topics, masses=masses, scene=scene, table=table)
    summary = finite(found.as_dict())
    if options.as_json:
        print(json_text(summary))
    else:
        _print(found, summary)
    warn(_first(found.notes, "notes"))
    if options.out is not None and table is not None:
        with writing(options.out):
            write_json(summary, options.out / "analysis.json")
            table.write_csv(options.out / "samples.csv")
            if options.parquet:
                table.write_parquet(options.out / "samples.parquet")
            write_report(found, options.out / "report.html")
        print(f"wrote {', '.join(sorted(str(path) for path in options.out.glob('*.*')))}")
    return 0


def _print(found: Analysis, summary: dict[str, Any]) -> None:
    console = plain_console(highlight=False)
    keys = ("least", "largest", "rms", "peak_frequency")
    rows = [
        [name if not k else "", value, *(digits(row[key], 4) for key in keys)]
        for name, source in islice(summary["sources"].items(), MOST)
        for k, (value, row) in enumerate(source["values"].items())
    ]
    values = ["source", "value", "least", "largest", "RMS", "peak [Hz]"]
    *others, sources = tables(found)
    for table in (sources, Table("Values", values, rows, 2), *others):
        console.print(table.title, style="bold")
        console.print(columns(table.heads, table.rows, names=table.heads[: table.names]))
    for line in _remarks(found, summary):
        print(line)


def _remarks(found: Analysis, summary: dict[str, Any]) -> list[str]:
    """Lines below the tables: what they leave out, and what is not in them."""
    notes = [f"{n}: {b['note']}" for n, b in summary["bodies"].items() if "note" in b]
    more = len(found.figures) - MOST
    lines = [f"and {more} more sources{ELSEWHERE}"] if more > 0 else []
    lines += [*_first(notes, "bodies"), *_first(found.events, "lines about impacts")]
    for name, balance in found.balances.items():
        if not has_forces(balance):
            lines.append(f"{name}: balances not available: no wrench on it is recorded; give a "
                         "scene with its effects by --masses")  # fmt: skip
            continue
        if lacks := balance.get("momentum_lacks_reactions_of"):
            lines.append(f"{name}: momentum error not available: no reactions of "
                         f"{', '.join(lacks)} are recorded")  # fmt: skip
        if "wrenches" in balance:
            acted = " and ".join(["the scene's effects", *balance["wrenches"]])
            lines.append(f"{name}: change minus {acted}; includes forces that were not recorded")
    if found.constraints:
        worst = found.constraints["relative"]
        lines.append(f"max constraint violation, from the poses: {worst:.2g} (relative)")
    if found.contacts:
        counts = ", ".join(f"{n} {kind}" for kind, n in found.contacts["events"].items())
        lines.append(f"contacts: work {found.contacts['work']:.6g} J; events: {counts or 'none'}")
    return lines


def _first(lines: Sequence[str], what: str) -> list[str]:
    """The first MOST lines, and the number of further ones."""
    more = len(lines) - MOST
    return [*lines[:MOST], *([f"and {more} more {what}{ELSEWHERE}"] if more > 0 else [])]
