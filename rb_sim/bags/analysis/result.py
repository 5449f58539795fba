# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What an analysis of a bag found, as plain data too."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.bags.analysis.bodies import BodyFigures
from rb_sim.bags.analysis.figures import COLUMNS, Figures, sizes_beside, sizes_of, unit_of
from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.io.sink import Thinned

Reading = tuple[str, str, np.ndarray, np.ndarray]
"""Source, kind, times [s] of shape (n,) and numbers of shape (n, size of the kind)."""


@dataclass
class Analysis:
    """What was found; `figures` and `bodies` also give curves and spectra to draw."""

    name: str
    figures: dict[str, Figures] = field(default_factory=dict)
    bodies: dict[str, BodyFigures] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    balance: dict[str, Any] | None = None
    """of a run of ours."""
    balances: dict[str, dict[str, Any]] = field(default_factory=dict)
    """of somebody else's poses, by what they are of."""
    constraints: dict[str, Any] | None = None
    """errors of the constraints, recomputed from the poses."""
    contacts: dict[str, Any] | None = None
    other_topics: dict[str, str] = field(default_factory=dict)
    length: float = 0.0
    """how far the scene's bodies reach from their origins [m]; 0 where no scene is known."""
    title: str = ""
    """of the scene; "" where none is known."""
    facts: list[str] = field(default_factory=list)
    """lines about the run that was recorded."""
    bytes: int = 0
    messages: int = 0

    def add(self, name: str, kind: str, t: np.ndarray, values: np.ndarray) -> None:
        """The next readings of a source."""
        self.kinds[name] = kind
        self.figures.setdefault(name, Figures(COLUMNS[kind])).add(t, values)

    def begin_anew(self) -> None:
        """What comes is another motion."""
        for figures in self.figures.values():
            figures.begin_anew()
        for body in self.bodies.values():
            body.finish()

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        sizes = sizes_of(self.figures.items(), self.length)
        return {
            "bag": self.name,
            "notes": self.notes,
            "sources": {
                name: {
                    "kind": self.kinds[name],
                    **figures.as_dict(sizes_beside(name, figures, sizes)),
                }
                for name, figures in self.figures.items()
            },
            "bodies": {name: body.as_dict() for name, body in self.bodies.items()},
            "balance": self.balance,
            "balances": self.balances,
            "constraints": self.constraints,
            "contacts": self.contacts,
            "other_topics": self.other_topics,
        }


# Samples of all sources on the times of the first one: for CSV and Parquet.


MOST_ROWS = 1_000_000
"""Of a table; of longer bags every second, fourth ... sample is taken."""
AT_ONCE = 1_000_000
"""Numbers that are made text of at once."""


class Aligned:
    """Collects sources; memory is bounded by MOST_ROWS for each."""

    def __init__(self) -> None:
        self._sources: dict[str, tuple[tuple[str, ...], Thinned]] = {}

    def add(self, source: str, columns: tuple[str, ...], t: np.ndarray, values: np.ndarray) -> None:
        """The next readings of a source."""
        if source not in self._sources:
            self._sources[source] = (columns, Thinned(1 + len(columns), MOST_ROWS))
        self._sources[source][1].add(np.column_stack([t, values]))

    def columns(self) -> dict[str, np.ndarray]:
        """t and SOURCE.COLUMN, all on the times of the first source; NaN outside of a source.

        Between two readings the numbers are linear.
        """
        first = next(iter(self._sources.values()))[1].rows[:, 0]
        t = np.unique(first)
        found = {"t": t}
        for source, (names, thinned) in self._sources.items():
            rows = thinned.rows
            own, index = np.unique(rows[:, 0], return_index=True)
            same = np.array_equal(own, t)
            for k, name in enumerate(names):
                values = rows[index, 1 + k]
                found[f"{source}.{name}"] = (
                    values if same else np.interp(t, own, values, left=np.nan, right=np.nan)
                )
        return found

    def units(self) -> dict[str, str]:
        """Unit of each column, "" for a number without one."""
        found = {"t": "s"}
        for source, (names, _) in self._sources.items():
            found |= {f"{source}.{name}": unit_of(source, name) for name in names}
        return found

    def write_csv(self, path: Path) -> None:
        """A header of names with their units, then numbers to the last digit."""
        columns, units = self.columns(), self.units()
        rows = max(1, AT_ONCE // len(columns))
        heads = [f"{name} [{units[name]}]" if units[name] else name for name in columns]
        try:
            with path.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(heads)
                for first in range(0, len(columns["t"]), rows):
                    part = [values[first : first + rows] for values in columns.values()]
                    writer.writerows(np.column_stack(part).tolist())
        except OSError as error:
            raise SinkError(f"{path}: {error.strerror}") from None

    def write_parquet(self, path: Path) -> None:
        """Columns with their units in the fields' metadata, and all of them in the schema's."""
        try:
            arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
        except ImportError:
            raise MissingExtraError("pyarrow", "analysis", "--parquet") from None
        columns, units = self.columns(), self.units()
        fields = [arrow.field(n, arrow.float64(), metadata={"unit": units[n]}) for n in columns]
        schema = arrow.schema(fields, metadata={"units": json.dumps(units)})
        table = arrow.table([arrow.array(values) for values in columns.values()], schema=schema)
        try:
            parquet.write_table(table, path)
        except OSError as error:
            raise SinkError(f"{path}: {error}") from None
