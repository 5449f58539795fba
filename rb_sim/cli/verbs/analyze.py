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

from rb_sim.base.errors import RbSimError
from rb_sim.base.plain_data import finite, json_text, write_json
from rb_sim.cli.options import AnalyzeOptions
from rb_sim.cli.plain import columns, plain_console, warn

SHOWN = 100
"""Most sources, bodies and notes in the terminal."""
ELSEWHERE = " (all with --json or --out DIR)"


def analyze(options: AnalyzeOptions) -> int:
    """Analyze a bag, print and write the results; returns 0. Raises RbSimError."""
    from rb_sim.bags.analysis.analysis_page import Aligned, write_report
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
        _print(summary)
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


def _print(summary: dict[str, Any]) -> None:
    console = plain_console(highlight=False)
    sources = dict(islice(summary["sources"].items(), SHOWN))
    heads = ("source", "readings", "rate [Hz]", "gaps", "back")
    rates = [
        (name, str(of["count"]), _g(of["rate"], 6), str(of["gaps"]), str(of["backwards"]))
        for name, of in sources.items()
    ]
    console.print(columns(heads, rates, names=("source",)))
    heads = ("source", "value", "least", "largest", "RMS", "peak [Hz]")
    keys = ("least", "largest", "rms", "peak_frequency")
    rows = [
        (name if not k else "", value, *(_g(row[key], 4) for key in keys))
        for name, source in sources.items()
        for k, (value, row) in enumerate(source["values"].items())
    ]
    console.print(columns(heads, rows, names=("source", "value")))
    if len(summary["sources"]) > SHOWN:
        print(f"and {len(summary['sources']) - SHOWN} more sources{ELSEWHERE}")
    for line in _first(_body_lines(summary), "bodies"):
        print(line)
    for line in _first(summary["events"], "lines about impacts"):
        print(line)
    _print_balance(summary)


def _body_lines(summary: dict[str, Any]) -> list[str]:
    """Result of inverse dynamics for each body, or why there is none."""
    lines = []
    for name, body in summary["bodies"].items():
        if "apart" in body:
            apart = body["apart"]
            lines.append(f"{name}: inverse dynamics ({body['filter']}) and recorded wrenches: RMS "
                         f"apart {apart['force']:.3g} N, {apart['torque']:.3g} N m")  # fmt: skip
        elif "note" in body:
            lines.append(f"{name}: {body['note']}")
    return lines


def _first(lines: Sequence[str], what: str) -> list[str]:
    """The first SHOWN lines, and the number of further ones."""
    more = len(lines) - SHOWN
    return [*lines[:SHOWN], *([f"and {more} more {what}{ELSEWHERE}"] if more > 0 else [])]


def _print_balance(summary: dict[str, Any]) -> None:
    balances = {"": summary["balance"]} if summary["balance"] else summary["balances"]
    for name, balance in balances.items():
        of = f"{name}: " if name else ""
        energy, momentum = balance.get("energy"), balance.get("momentum")
        if "wrenches" in balance and not (balance["wrenches"] or balance["effects"]):
            print(f"{of}balances not available: no wrench on it is recorded; give a scene with its "
                  "effects by --masses")  # fmt: skip
            continue
        if energy:
            print(f"{of}energy error: {energy['error']:.2g} J of {energy['scale']:.3g} J"
                  f"{_uncertainty(energy, 'J')}")  # fmt: skip
        for kind, unit in (("linear", "N s"), ("angular", "N m s")):
            if momentum:
                row = momentum[kind]
                print(f"{of}{kind} momentum error: {row['error']:.2g} {unit} of "
                      f"{row['scale']:.3g} {unit}{_uncertainty(row, unit)}")  # fmt: skip
        if lacks := balance.get("momentum_lacks_reactions_of"):
            print(f"{of}momentum error not available: no reactions of {', '.join(lacks)} are "
                  "recorded")  # fmt: skip
        if "wrenches" in balance:
            acted = " and ".join(["the scene's effects", *balance["wrenches"]])
            print(f"  {of}change minus {acted}; includes forces that were not recorded")
    _print_constraints(summary["constraints"])
    if summary["contacts"]:
        counts = ", ".join(f"{n} {kind}" for kind, n in summary["contacts"]["events"].items())
        print(f"contacts: work {summary['contacts']['work']:.6g} J; events: {counts or 'none'}")


def _uncertainty(row: dict[str, Any], unit: str) -> str:
    """Sampling error of an integral, if it is not small, and noise of the recording; else ""."""
    uncertainty, noise = row.get("quadrature") or 0.0, row.get("noise") or 0.0
    notes = [f"sampling error {uncertainty:.2g} {unit}"] * (uncertainty > 0.1 * abs(row["error"]))
    notes += [f"noise of the recording up to {noise:.2g} {unit}"] * (
        noise > 0.01 * abs(row["error"])
    )
    return f" ({'; '.join(notes)})" if notes else ""


def _print_constraints(summary: dict[str, Any] | None) -> None:
    if not summary:
        return
    print(f"max constraint violation, from the poses: {summary['relative']:.2g} (relative)")
    for name, velocity in summary["velocity"].items():
        position = summary["position"].get(name)
        parts = [] if position is None else [_worst(position, "m or rad")]
        print(f"  {name}: {', '.join([*parts, _worst(velocity, 'm/s or rad/s')])}")
    for name, overlap in summary["overlap"].items():
        kind = (
            "closed; largest overlap" if overlap["touches"] else "open at all samples; smallest gap"
        )
        size = abs(max(overlap["largest"], 0.0) if overlap["touches"] else overlap["largest"])
        print(f"  {name}: {kind} {_worst({**overlap, 'largest': size}, 'm')}")


def _worst(row: dict[str, Any], unit: str) -> str:
    when = "" if row["at"] is None else f" (t = {row['at']:.6g} s)"
    return f"{row['largest']:.2g} {unit}{when}"


def _g(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}g}"
