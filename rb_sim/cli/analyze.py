"""`rb_sim analyze`: what a recorded bag tells, as table, JSON, CSV, Parquet and report."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.errors import MissingExtraError, RbSimError

if TYPE_CHECKING:
    from rich.table import Table

    from rb_sim.analysis.analyze import Analysis


@dataclass(frozen=True)
class AnalyzeOptions:
    """What the command line says."""

    bag: Path
    out: Path | None = None
    topics: tuple[str, ...] = ()
    masses: str | None = None
    parquet: bool = False
    screenshot: bool = True
    as_json: bool = False


def analyze(options: AnalyzeOptions) -> int:
    """Analyze, print, write; 0. Raises RbSimError."""
    from rb_sim.analysis.analyze import UNITS
    from rb_sim.analysis.analyze import analyze as read
    from rb_sim.analysis.masses import masses_of
    from rb_sim.analysis.table import Aligned
    from rb_sim.cli.outputs import make_folder
    from rb_sim.cli.replay import warn
    from rb_sim.cli.summary import finite

    if options.parquet and options.out is None:
        raise RbSimError("--parquet: give the folder of the results as --out DIR")
    masses = None if options.masses is None else masses_of(options.masses)
    table = None if options.out is None else Aligned(UNITS)
    if options.out is not None:
        make_folder(options.out)
    topics = frozenset(options.topics) or None
    found = read(options.bag, topics=topics, masses=masses, table=table)
    told = finite(found.as_dict())
    if options.as_json:
        print(json.dumps(told, indent=2, allow_nan=False))
    else:
        _print(told)
    warn(found.notes)
    if options.out is not None and table is not None:
        text = json.dumps(told, indent=2, allow_nan=False) + "\n"
        (options.out / "analysis.json").write_text(text, encoding="utf-8")
        table.write_csv(options.out / "samples.csv")
        if options.parquet:
            table.write_parquet(options.out / "samples.parquet")
        _report(found, options)
        print(f"wrote {', '.join(sorted(str(path) for path in options.out.glob('*.*')))}")
    return 0


def _report(found: Analysis, options: AnalyzeOptions) -> None:
    from rb_sim.analysis.report import write_report
    from rb_sim.cli.replay import convert
    from rb_sim.sinks.bag_reader import BagReader
    from rb_sim.sinks.rerun_screenshot import save_screenshot

    assert options.out is not None
    try:
        with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
            picture: Path | None = Path(folder) / "scene.png"
            try:
                if not options.screenshot or found.balance is None:
                    picture = None
                else:
                    recording = Path(folder) / "scene.rrd"
                    convert(BagReader(options.bag, unfinished=True), recording)
                    save_screenshot(recording, picture)
            except RbSimError as error:  # no Rerun, no Vulkan, no driver: the rest of it stands
                found.notes.append(f"no picture of the scene: {error}")
                picture = None
            write_report(found, options.out / "report.html", picture)
    except MissingExtraError as error:
        print(f"note: no report.html: {error}")


def _print(told: dict[str, Any]) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    heads = ("source", "readings", "rate [Hz]", "gaps", "back")
    rates = [
        (name, str(of["count"]), _g(of["rate"], 6), str(of["gaps"]), str(of["backwards"]))
        for name, of in told["sources"].items()
    ]
    console.print(_columns(heads, rates))
    heads = ("source", "value", "least", "largest", "RMS", "peak [Hz]")
    keys = ("least", "largest", "rms", "peak_frequency")
    rows = [
        (name if not k else "", value, *(_g(row[key], 4) for key in keys))
        for name, source in told["sources"].items()
        for k, (value, row) in enumerate(source["values"].items())
    ]
    console.print(_columns(heads, rows))
    for name, body in told["bodies"].items():
        if "apart" in body:
            apart = body["apart"]
            print(f"{name}: inverse dynamics ({body['filter']}) and recorded wrenches: RMS apart "
                  f"{apart['force']:.3g} N, {apart['torque']:.3g} N m")  # fmt: skip
        elif "note" in body:
            print(f"{name}: {body['note']}")
    _print_balance(told)


def _columns(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    """A table in which names may be folded, numbers never."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in heads:
        left = name in ("source", "value")
        table.add_column(
            name, justify="left" if left else "right", overflow="fold", no_wrap=not left
        )
    for row in rows:
        table.add_row(*row)
    return table


def _print_balance(told: dict[str, Any]) -> None:
    energy = (told["balance"] or {}).get("energy")
    if energy:
        print(f"energy balance: {energy['error']:.2g} J of {energy['scale']:.3g} J")
    momentum = (told["balance"] or {}).get("momentum")
    for name, unit in (("linear", "N s"), ("angular", "N m s")):
        if momentum:
            print(f"{name} momentum balance: {momentum[name]['error']:.2g} {unit}")
    if told["contacts"]:
        counts = ", ".join(f"{n} {kind}" for kind, n in told["contacts"]["events"].items())
        print(f"contacts: work {told['contacts']['work']:.6g} J; events: {counts or 'none'}")


def _g(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}g}"
