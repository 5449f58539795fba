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
