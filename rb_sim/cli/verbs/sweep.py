# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim sweep PLAN [--out DIR]` runs a plan; `rb_sim sweep report DIR` prints its results."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from rb_sim.base.errors import AccuracyWarning, RbSimError
from rb_sim.cli.plain import plain_console, warn
from rb_sim.sweeps.plan import load_plan, shipped_plans
from rb_sim.sweeps.sweep import sweep as run_plan


def of_arguments(plan: str, folder: Path | None, out: Path | None, **options: Any) -> int:
    """`sweep` with these options, or another form of the verb: `list`, `report DIR`."""
    if plan == "list":
        return sweep_plans()
    if plan == "report":
        if folder is None:
            raise RbSimError("report: got no folder; must be the folder of a sweep (its --out)")
        return sweep_report(folder)
    if folder is not None:
        raise RbSimError(f"got {str(folder)!r}; give the folder of the results as --out {folder}")
    return sweep(plan, out, **options)


def sweep(
    plan: str,
    out: Path | None,
    workers: int | None,
    scheduler: str | None,
    batch: int | None,
    lanes: bool = True,
) -> int:
    """Run all runs of a plan that `out` does not contain yet; returns the exit code 0.

    Raises RbSimError for an invalid plan, option or folder; KeyboardInterrupt on Ctrl-C: finished
    batches are kept, and the same command continues.
    """
    loaded = load_plan(plan)
    folder = out or Path("out") / f"sweep_{Path(loaded.file).stem}"
    print(f"{loaded.plan.runs} runs of {Path(loaded.scene_file).stem} into {folder}")
    try:
        with _bar(loaded.plan.runs) as show, warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)  # printed below
            result = run_plan(
                loaded,
                folder,
                workers=workers,
                scheduler=scheduler,
                batch=batch,
                lanes=lanes,
                progress=show,
            )
    except KeyboardInterrupt:
        print(f"interrupted; finished runs are in {folder}; repeat the command to continue")
        raise
    if result.reused:
        print(f"{result.reused} runs were already done")
    if result.failed:
        print(f"{result.failed} runs failed; the column `reason` says why")
    if result.lost:
        bad = len({lost.run for lost in result.lost})
        warn(
            [
                f"{bad} of {result.looked_at} checked runs failed an accuracy check",
                *map(str, result.lost),
            ]
        )
    print(f"wrote {folder / 'runs'} (Parquet); rb_sim sweep report {quote(str(folder))}")
    return 0


@contextmanager
def _bar(runs: int) -> Iterator[Callable[[int, int, int], None]]:
    """Progress bar of finished runs; yields the function that updates it."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=plain_console(), transient=True) as bar:
        task = bar.add_task("starting", total=runs, rate="")

        def show(done: int, total: int, failed: int) -> None:
            speed = bar.tasks[0].speed
            rate = f"{speed:.0f} runs/s" if speed else ""
            what = f"{failed} failed" if failed else "running"
            bar.update(task, completed=done, total=total, description=what, rate=rate)

        yield show


def sweep_report(folder: Path) -> int:
    """Write the report of a sweep and print its main figures; returns the exit code 0."""
    from rb_sim.sweeps.sweep_page import SLOPE_HEADS, report

    result = report(folder)
    console = plain_console()
    print(f"{result.runs} runs, {result.failed} of them failed")
    table = Table("output", "", "run", "value")
    for extreme in result.extremes:
        table.add_row(extreme.output, extreme.which, str(extreme.run), f"{extreme.value:.6g}")
    console.print(table)
    if result.indices:
        indices = Table("output", "varied", "first order", "total")
        for output, by_name in result.indices.items():
            for name, index in by_name.items():
                first = f"{index.first:.3f} ± {index.first_interval:.3f}"
                total = f"{index.total:.3f} ± {index.total_interval:.3f}"
                indices.add_row(output, name, first, total)
        console.print(indices)
    if any(result.slopes.by_output.values()):
        slopes = Table(*SLOPE_HEADS)
        for output, by_name in result.slopes.by_output.items():
            for name, slope in by_name.items():
                slopes.add_row(output, name, *slope.texts())
        console.print(slopes)
        if result.slopes.why:
            print(f"no exact derivatives: {result.slopes.why}")
    for path in (result.html, *result.pictures):
        print(f"wrote {path}")
    return 0


def sweep_plans() -> int:
    """Print the shipped plans; returns the exit code 0."""

    for name, path in shipped_plans().items():
        loaded = load_plan(path)
        print(f"{name:24} {loaded.plan.runs:8d} runs  {loaded.plan.description}")
    return 0
