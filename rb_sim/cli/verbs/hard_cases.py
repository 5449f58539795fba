# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim hard-cases`: run the catalogue of hard cases and print the margin of each bound."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rb_sim.base.errors import RbSimError

if TYPE_CHECKING:
    from rb_sim.sweeps.hard_cases import Case, Row

FOLDER = "hard_cases"


def shipped() -> Path:
    """Folder of the shipped hard cases. Raises RbSimError if it is not installed."""
    from rb_sim.scene.listing import scene_folders

    for folder in scene_folders():
        if (folder / FOLDER).is_dir():
            return folder / FOLDER
    raise RbSimError("the shipped hard cases are not installed; give a folder of cases")


def hard_cases(
    folder: Path | None,
    only: Sequence[str] | None,
    out: Path | None,
    quick: bool,
    beside: Callable[[Case, Sequence[Row]], None] | None = None,
    below: Callable[[], str] = str,
) -> int:
    """Run the cases and print one row each; returns 1 if one fails. Raises RbSimError for bad
    cases.

    beside: called with each case and all rows so far; below: Markdown below the table of results.
    """
    from rb_sim.simulation.outputs import writing
    from rb_sim.sweeps.hard_cases import FAILS, load_cases, rows_of, write

    if folder is not None and not folder.is_dir():
        raise RbSimError(
            f"{folder}: is no folder; FOLDER must hold cases (YAML), or omit it for those of rb_sim"
        )
    cases = load_cases(folder or shipped(), only or ())
    cases = [case for case in cases if case.quick or not quick]
    if not cases:
        raise RbSimError("--quick: none of these cases is a quick one")
    rows: list[Row] = []
    print(
        line("case", "method", "step/tol.", "figure", "is", "bound", "margin", "CPU [s]", "verdict")
    )
    for case in cases:
        for row in rows_of(case):
            rows.append(row)
            print(row_text(row), flush=True)
        if beside is not None:
            beside(case, rows)
    failed = [row for row in rows if row.verdict == FAILS]
    for row in failed:
        print(f"fails: {row.case}, {row.method}: {row.message or row.check}", file=sys.stderr)
    if out is not None:
        with writing(out):
            print(f"wrote {', '.join(map(str, write(out, cases, rows, quick, below())))}")
    print(
        f"{len(rows) - len(failed)} of {len(rows)} rows are within their bound or are "
        "documented limits"
    )
    return 1 if failed else 0


def row_text(row: Row) -> str:
    """Text of one printed row."""
    from rb_sim.sweeps.hard_cases import number

    return line(
        row.case, row.method, row.knob, row.check, number(row.figure), f"{row.bound:.2g}",
        number(row.margin), f"{row.seconds:.2g}", row.verdict,
    )  # fmt: skip


def line(*cells: str) -> str:
    """Cells in columns of fixed width."""
    widths = (31, 14, 9, 9, 8, 8, 8, 8, 7)
    return " ".join(f"{cell:<{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()
