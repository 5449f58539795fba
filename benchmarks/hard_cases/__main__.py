# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The hard cases on MuJoCo, Drake and Exudyn beside rb_sim, in one run (extra peers).

    python -m benchmarks.hard_cases [--only NAME ...] [--quick] [--out DIR]

DIR gets what `rb_sim hard-cases --out DIR` writes, with a table of the engines, and their rows as
hard-cases-peers.json.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.hard_cases.compare import PeerRow, rows_on_peers, table_of
from rb_sim.base.plain_data import write_json
from rb_sim.cli.verbs.hard_cases import hard_cases, line
from rb_sim.sweeps.hard_cases import Case, Row, number


def on_peers(case: Case, rows: Sequence[Row]) -> list[PeerRow]:
    """The case on the other engines, printed. Raises RbSimError where one is not installed."""
    found = list(rows_on_peers(case, [row for row in rows if row.case == case.name]))
    for row in found:
        print(
            line(
                f"  {row.engine}", row.method, f"{row.step:.2g} s", row.check, number(row.figure),
                f"{row.bound:.2g}", number(row.bound / row.figure if row.figure else float("inf")),
                f"{row.seconds:.2g}", row.verdict,
            ),
            flush=True,
        )  # fmt: skip
    return found


def main() -> int:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hard_cases")
    parser.add_argument("--only", action="append", default=[], metavar="NAME")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    peers: list[PeerRow] = []
    code = hard_cases(
        None,
        given.only,
        given.out,
        given.quick,
        beside=lambda case, rows: peers.extend(on_peers(case, rows)),
        below=lambda: table_of(peers),
    )
    if given.out is not None:
        write_json([row._asdict() for row in peers], given.out / "hard-cases-peers.json")
    return code


if __name__ == "__main__":
    sys.exit(main())
