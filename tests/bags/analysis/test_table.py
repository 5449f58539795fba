# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table of aligned samples."""

from __future__ import annotations

import csv
import tracemalloc

import numpy as np

from rb_sim.bags.analysis import result as table


def test_text_is_made_piece_by_piece(tmp_path, monkeypatch) -> None:
    """Numbers as Python has them take four times their room: never those of a whole table."""
    monkeypatch.setattr(table, "AT_ONCE", 4_000)
    t = np.arange(20_000) / 100.0
    values = np.column_stack([np.sin(k * t) for k in range(7)])
    made = table.Aligned()
    made.add("/body", table_columns(), t, values)
    size = 8 * values.size
    tracemalloc.start()
    try:
        made.write_csv(tmp_path / "samples.csv")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * size
    with (tmp_path / "samples.csv").open() as file:
        _, *rows = csv.reader(file)
    np.testing.assert_array_equal(np.array(rows, float), np.column_stack([t, values]))


def table_columns() -> tuple[str, ...]:
    from rb_sim.bags.analysis.figures import COLUMNS

    return COLUMNS["pose"]
