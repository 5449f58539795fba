# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Result of a bag analysis as plain data, aligned tables (CSV, Parquet), and an HTML report.

The report is one self-contained file below 2 MB even for many topics: curves are envelopes with at
most CURVE_BYTES, and spectra show the largest density in each of SPECTRAL_BANDS bands.
"""

from __future__ import annotations

import csv
import html
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rb_sim.bags.analysis.bodies import BodyFigures
from rb_sim.bags.analysis.figures import (
    COLUMNS,
    RESIDUAL,
    Figures,
    sizes_beside,
    sizes_of,
    unit_of,
)
from rb_sim.bags.info import linear
from rb_sim.bags.transforms import POSE
from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.base.palette import AXES, BAD, BLACK, BLUE, CYCLE, FAINT, GRID
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.io.motion_page import packed, save
from rb_sim.io.panels import LEAST_DRAWN
from rb_sim.io.sink import Envelope, Thinned

Reading = tuple[str, str, np.ndarray, np.ndarray]
"""Source, kind, times [s] of shape (n,), values of shape (n, number of columns of the kind)."""


@dataclass
class Analysis:
    """Result of an analysis; `figures` and `bodies` also give curves and spectra to plot."""

    name: str
    figures: dict[str, Figures] = field(default_factory=dict)
    bodies: dict[str, BodyFigures] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    """lines about what is wrong with the recording, or not known."""
    events: list[str] = field(default_factory=list)
    """lines about recorded impacts."""
    balances: dict[str, dict[str, Any]] = field(default_factory=dict)
    """energy and momentum balances, by scene or body."""
    constraints: dict[str, Any] | None = None
    """errors of the constraints, recomputed from the poses."""
    contacts: dict[str, Any] | None = None
    other_topics: dict[str, str] = field(default_factory=dict)
    length: float = 0.0
    """largest distance of a body's points from its origin [m]; 0 without a scene."""
    title: str = ""
    """title of the scene; "" without a scene."""
    facts: list[str] = field(default_factory=list)
    """lines about the recorded run."""
    bytes: int = 0
    messages: int = 0

    def add(self, name: str, kind: str, t: np.ndarray, values: np.ndarray) -> None:
        """Append readings of a source."""
        self.kinds[name] = kind
        self.figures.setdefault(name, Figures(COLUMNS[kind])).add(t, values)

    def begin_anew(self) -> None:
        """Mark a restart: later readings belong to another motion."""
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
            "events": self.events,
            "sources": {
                name: {
                    "kind": self.kinds[name],
                    **figures.as_dict(sizes_beside(name, figures, sizes)),
                }
                for name, figures in self.figures.items()
            },
            "bodies": {name: body.as_dict() for name, body in self.bodies.items()},
            "balances": self.balances,
            "constraints": self.constraints,
            "contacts": self.contacts,
            "other_topics": self.other_topics,
        }


# Table for CSV and Parquet: all sources interpolated to the times of the first one.


MOST_ROWS = 1_000_000
"""Maximum rows of a table; longer bags are thinned by powers of two."""
AT_ONCE = 1_000_000
"""Numbers converted to text at once, which bounds memory."""


class Aligned:
    """Collects sources for one table; keeps at most MOST_ROWS rows for each."""

    def __init__(self) -> None:
        self._sources: dict[str, tuple[tuple[str, ...], Thinned]] = {}

    def add(self, source: str, columns: tuple[str, ...], t: np.ndarray, values: np.ndarray) -> None:
        """Append readings of a source."""
        if source not in self._sources:
            self._sources[source] = (columns, Thinned(1 + len(columns), MOST_ROWS))
        self._sources[source][1].add(np.column_stack([t, values]))

    def columns(self) -> dict[str, np.ndarray]:
        """Columns t and SOURCE.COLUMN at the times of the first source.

        Other sources are interpolated linearly; NaN outside of their time span.
        """
        first = next(iter(self._sources.values()))[1].rows[:, 0]
        t = np.unique(first)
        found = {"t": t}
        for source, (names, thinned) in self._sources.items():
            own, index = np.unique(thinned.rows[:, 0], return_index=True)
            values = thinned.rows[index, 1:]
            if not np.array_equal(own, t):
                values = linear(t, own, values, outside=np.nan)
            found |= {f"{source}.{n}": column for n, column in zip(names, values.T, strict=True)}
        return found

    def units(self) -> dict[str, str]:
        """Unit of each column; "" for a dimensionless number."""
        found = {"t": "s"}
        for source, (names, _) in self._sources.items():
            found |= {f"{source}.{name}": unit_of(source, name) for name in names}
        return found

    def write_csv(self, path: Path) -> None:
        """Write CSV: names with units, then numbers in full precision. Raises SinkError."""
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
        """Write Parquet with units in the metadata of fields and schema.

        Raises SinkError, and MissingExtraError without pyarrow."""
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


STATE = "kinetic energy and momenta"
STATES = {"J": "kinetic energy", "N s": "momentum", "N m s": "angular momentum"}
"""Name of the columns of a body's state, by unit."""

MOST = 100
"""Maximum number of sources and of bodies plotted: browsers cannot handle thousands of plots."""
CURVE_BYTES, FEWEST = 800_000, 100
"""Size of all time curves together [bytes]; minimum number of points of a curve."""
SPECTRAL_BANDS = 200
"""Number of bands of a plotted spectrum, equally wide on a logarithmic axis."""


def write_report(found: Analysis, path: Path) -> None:
    """Write the HTML report to `path`. Raises SinkError."""
    page = _Page(found)
    parts = [
        _verdict(found),
        page.section("energy", "Energy over time"),
        _section("Paths", page.paths()),
        page.section("time", "Over time", page.left_out()),
        _section("Recorded times", recorded_times(found)),
        page.section("spectra", "Power spectral densities"),
        *(_html(*table) for table in tables(found)),
    ]
    save(page.data(), path, "report", "\n".join(parts))


def _section(title: str, inner: str) -> str:
    return f"<h2>{title}</h2>{inner}" if inner else ""


BALANCED = 1e-3
"""Largest relative error of a balance that counts as balanced."""


def _verdict(found: Analysis) -> str:
    """HTML: the recording, its problems, and whether the balances hold."""
    count = sum(figures.rates.count for figures in found.figures.values())
    sources = f"{len(found.figures)} sources, {count} readings"
    recorded = [*found.facts, *found.events[:MOST], sources, found.name]
    gaps = [
        f"{name}: {rates['gaps']} gaps, the longest {rates['longest_gap']:.3g} s"
        for name, figures in found.figures.items()
        if (rates := figures.rates.as_dict())["gaps"]
    ]
    problems = [*found.notes, *gaps[:MOST]] or ["none found: no gaps, no notes"]
    balances = []
    for what, unit, row in judged(found):
        uncertainty = max(row.get("quadrature") or 0.0, row.get("noise") or 0.0)
        holds = abs(row["error"]) <= max(BALANCED * row["scale"], uncertainty)
        verdict = "balances" if holds else "does NOT balance"
        rest = f"{abs(row['error']):.2g} of {row['scale']:.3g} {unit} not accounted for"
        balances.append(f"{what} {verdict}: {rest}")
    known = bool(balances)
    if not known:
        balances = ["not judged: masses or forces are not known (--masses FILE)"]
    title = html.escape(_title(found))
    wrong = any("NOT" in line for line in balances)
    lists = (
        ("", "Recorded", recorded),
        ("bad" if found.notes or gaps else "good", "Problems", problems),
        ("bad" if wrong else "good" if known else "", "Balances", balances),
    )
    return f"<h1>{title}</h1>" + "".join(
        f'<p class="verdict {kind}"><b>{head}.</b> {"<br>".join(map(html.escape, lines))}</p>'
        for kind, head, lines in lists
    )


def judged(found: Analysis) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """(name, unit, balance) of each energy and momentum balance of which the forces are known."""
    for name, balance in found.balances.items():
        own = f"{name} " * (len(found.balances) > 1)
        if has_forces(balance):
            momentum = balance["momentum"] or {}
            for what, unit, row in (
                ("energy", "J", balance["energy"]),
                ("linear momentum", "N s", momentum.get("linear")),
                ("angular momentum", "N m s", momentum.get("angular")),
            ):
                if row is not None:
                    yield f"{own}{what}", unit, row


def has_forces(balance: dict[str, Any]) -> bool:
    """Whether forces are known that act on the bodies of a balance."""
    return "wrenches" not in balance or bool(balance["wrenches"] or balance["effects"])


def _title(found: Analysis) -> str:
    return found.title or Path(found.name).name


# Tables of the report and of the terminal.


class Table(NamedTuple):
    """Rows of text. names: number of columns with names, which stand first."""

    title: str
    heads: list[str]
    rows: list[list[str]]
    names: int = 1


def tables(found: Analysis) -> list[Table]:
    """Balances, constraints, inverse dynamics and sources, of the first MOST sources and bodies;
    without tables that would be empty."""
    sources = []
    for name, figures in islice(found.figures.items(), MOST):
        rates = figures.rates.as_dict()
        jitter = f"{1e3 * rates['jitter']:.3g}" if rates["jitter"] > 1e-9 else "0"
        numbers = [str(rates["count"]), digits(rates["rate"], 6), jitter, str(rates["gaps"])]
        last = [f"{rates['longest_gap']:.4g}", str(rates["backwards"])]
        sources.append([name, found.kinds[name], *numbers, *last])
    apart = [
        [name, f"{off['force']:.3g}", f"{off['torque']:.3g}"]
        for name, body in islice(found.bodies.items(), MOST)
        if (off := body.as_dict().get("apart"))
    ]
    balances = [
        [
            f"{what} [{unit}]",
            *(f"{abs(row[key]):.3g}" for key in ("error", "scale", "quadrature")),
            digits(row.get("noise"), 3),
        ]
        for what, unit, row in judged(found)
    ]
    heads = ["source", "kind", "readings", "rate [Hz]", "jitter [ms]", "gaps", "longest [s]"]
    about_balances = ["balance", "error", "relative to", "sampling error", "noise"]
    dynamics = "Inverse dynamics against recorded wrenches: RMS difference"
    about_errors = ["constraint", "error of", "largest", "at [s]"]
    made = [
        Table("Balance errors", about_balances, balances),
        Table("Constraints, recomputed from the poses", about_errors, _violations(found), 2),
        Table(dynamics, ["body", "force [N]", "torque [N m]"], apart),
        Table("Sources", [*heads, "back"], sources, 2),
    ]
    return [table for table in made if table.rows]


def _violations(found: Analysis) -> list[list[str]]:
    """Largest error of each constraint; of a contact its overlap, or its smallest gap."""
    shown, rows = found.constraints or {}, []
    for kind, unit in (("position", "m or rad"), ("velocity", "m/s or rad/s"), ("overlap", "m")):
        for name, worst in shown.get(kind, {}).items():
            what, size = kind, worst["largest"]
            if kind == "overlap":
                touches = worst["touches"]
                what = "overlap, closed" if touches else "gap, open at all samples"
                size = abs(max(size, 0.0) if touches else size)
            rows.append([name, f"{what} [{unit}]", f"{size:.3g}", digits(worst["at"], 6)])
    return rows


def digits(value: float | None, count: int) -> str:
    """A number with so many digits; "" for None."""
    return "" if value is None else f"{value:.{count}g}"


def _html(title: str, heads: list[str], rows: list[list[str]], _: int) -> str:
    def line(cells: list[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<h2>{title}</h2><table>{line(heads, 'th')}{body}</table>"


class _Page:
    """Plots of the report, by section."""

    def __init__(self, found: Analysis) -> None:
        self._found = found
        self._plots = list(found.figures.items())[:MOST]
        self._own = len(self._plots)
        """number of plots with a spectrum; later ones are computed from poses."""
        for name, body in list(found.bodies.items())[:MOST]:
            if body.known and body.wrench.rates.count:
                self._plots.append((f"{name}: total wrench by inverse dynamics", body.wrench))
                if body.recorded.rates.count:
                    self._plots.append((f"{name}: total wrench recorded", body.recorded))
                self._plots.append((f"{name}: {STATE} from poses", body.state))
        self._sizes = sizes_of(self._plots, found.length)
        columns = sum(len(figures.names) for _, figures in self._plots)
        self._points = max(FEWEST, int(CURVE_BYTES / (5.4 * max(columns, 1))))
        self._across: list[dict[str, Any]] = []
        self._specs: list[dict[str, Any]] = []
        self._constant: list[str] = []
        for k, (name, figures) in enumerate(self._plots):
            self._specs += self._over_time(name, figures)
            if k < self._own and name != RESIDUAL:
                self._specs += self._spectra(name, figures)
        self._specs.sort(key=lambda spec: not spec["title"].startswith("reactions/"))

    def data(self) -> dict[str, Any]:
        """Data for the scripts of the page."""
        return {"title": _title(self._found), "across": self._across, "plots": self._specs}

    def section(self, key: str, title: str, note: str = "") -> str:
        """HTML of a section with its placeholder for plots; only `note` if it has no plots."""
        constant = ", ".join(self._constant) if key == "time" else ""
        note += f"<p>Constant to rounding, not drawn: {html.escape(constant)}</p>" * bool(constant)
        if not any(spec["section"] == key for spec in self._specs):
            return note
        return f'<h2>{title}</h2>{note}<div class="plots" id="{key}"></div>'

    def left_out(self) -> str:
        """HTML note if not all sources are plotted; else ""."""
        count = len(self._found.figures)
        if count <= MOST:
            return ""
        return f"<p>Of {MOST} of {count} sources; <code>--topic NAME</code> chooses others.</p>"

    def paths(self) -> str:
        """HTML with top and side views of the path of each body that translates."""
        drawn = []
        for name, figures in self._plots[: self._own]:
            if self._found.kinds[name] == POSE and len(drawn) < MOST_PATHS:
                _, values = figures.curves()
                least = WRITTEN_ROUNDING * self._sizes.get("m", 0.0)
                if np.ptp(values[:, :3], axis=0).max(initial=0.0) > least:
                    drawn.append(path_of(name, values[:, :3]))
        return f'<div class="plots">{"".join(drawn)}</div>' if drawn else ""

    def _over_time(self, name: str, figures: Figures) -> Iterator[dict[str, Any]]:
        """Yield one plot for each unit, without columns that are constant to rounding."""
        t, values = figures.curves()
        if not len(t):
            return
        thinned = Envelope(values.shape[1], self._points // 4)  # it keeps up to 4 times that
        thinned.add(t, values)
        across, values = _broken(*thinned.curves(), figures)
        axis = None
        for unit, which in _groups(name, figures).items():
            size = float(sizes_beside(name, figures, self._sizes)[which].max())
            if name != RESIDUAL and figures.spread[which].max() <= WRITTEN_ROUNDING * size:
                self._constant.append(f"{name} [{unit}]" if unit else name)
                continue
            axis = self._axis(across) if axis is None else axis
            curves = values[:, which]
            title = name.replace(STATE, STATES.get(unit, STATE))
            spec = _spec("energy" if unit == "J" else "time", title, unit, axis, size)
            if name == RESIDUAL:
                curves = np.log10(np.maximum(curves, LEAST_DRAWN))
                bounds = [math.log10(LEAST_DRAWN), math.log10(WRITTEN_ROUNDING) + 1.0]
                spec |= {"logarithmic": "y", "bounds": bounds, "scale": 1.0}
            yield spec | {"lines": _lines([figures.names[k] for k in which], curves)}

    def _spectra(self, name: str, figures: Figures) -> Iterator[dict[str, Any]]:
        """Yield one spectrum for each unit, without columns that are constant to rounding.

        The axis ends at the density of white noise of the size of rounding."""
        found, rate = figures.spectrum(), figures.rates.as_dict()["rate"]
        if found is None or rate is None:
            return
        frequency, density = _banded(found[0][1:], found[1][1:])
        axis = None
        for unit, which in _groups(name, figures).items():
            rounding = WRITTEN_ROUNDING * sizes_beside(name, figures, self._sizes)[which].max()
            moving = [k for k in which if figures.spread[k] > rounding]
            if not moving:
                continue
            axis = self._axis(np.log10(frequency)) if axis is None else axis
            least = max(2.0 * rounding**2 / rate, 1e-300)
            curves = np.log10(np.maximum(density[:, moving], least))
            spec = _spec("spectra", name, _density_unit(unit), axis, 1.0, "xy")
            yield spec | {"lines": _lines([figures.names[k] for k in moving], curves)}

    def _axis(self, values: np.ndarray) -> int:
        self._across.append(packed(values, "float64"))
        return len(self._across) - 1


def _spec(
    section: str, title: str, unit: str, across: int, scale: float, logarithmic: str = ""
) -> dict[str, Any]:
    """A plot for the scripts of the page, still without its curves."""
    about = {"section": section, "title": title, "unit": unit, "across": across, "scale": scale}
    return {**about, "logarithmic": logarithmic, "bounds": None}


def _density_unit(unit: str) -> str:
    squared = f"({unit})²" if " " in unit or "/" in unit else f"{unit}²" if unit else "1"
    return f"{squared}/Hz"


def _banded(frequency: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest density in each frequency band; bands with one frequency keep it."""
    edges = np.geomspace(frequency[0], frequency[-1] * (1.0 + 1e-9), SPECTRAL_BANDS + 1)
    starts = np.unique(np.searchsorted(frequency, edges[:-1]))
    return frequency[starts], np.maximum.reduceat(density, starts, axis=0)


def _groups(name: str, figures: Figures) -> dict[str, list[int]]:
    """Column indices by unit, for separate plots: a column in rad/s would hide one in m/s."""
    groups: dict[str, list[int]] = {}
    for k, column in enumerate(figures.names):
        groups.setdefault(unit_of(name, column), []).append(k)
    return groups


def _broken(t: np.ndarray, values: np.ndarray, figures: Figures) -> tuple[np.ndarray, np.ndarray]:
    """The curves with a row of NaN in each gap, over which the page draws no line."""
    gaps = figures.rates.as_dict()["first_gaps"]
    middles = np.array([gap["after"] + 0.5 * gap["seconds"] for gap in gaps])
    at = np.searchsorted(t, middles)
    return np.insert(t, at, middles), np.insert(values, at, np.nan, axis=0)


def _lines(names: list[str], values: np.ndarray) -> list[dict[str, Any]]:
    """One plotted curve for each column of values."""
    lines = []
    for k, (name, column) in enumerate(zip(names, values.T, strict=True)):
        color = AXES["xyzw".index(name[-1])] if name[-1] in "xyzw" else CYCLE[k % len(CYCLE)]
        shown = "" if name == "value" else name  # the title says what it is
        lines.append({"name": shown, "color": color, "y": packed(column)})
    return lines


# Static pictures: paths, and the recorded times of each source.


MOST_PATHS = 12
WIDE, HIGH, EDGE = 560, 340, 42
"""Width, height and margin of the picture of a path [pixels]."""
PATH_POINTS = 1000


def path_of(name: str, position: np.ndarray) -> str:
    """SVG of a path (n, 3) [m]: top view and side view (of the longer horizontal axis), at one
    scale; a filled dot marks its start, a hollow one its end."""
    if len(position) > 2 * PATH_POINTS:
        position = position[:: len(position) // PATH_POINTS]
    low, ranges = position.min(axis=0), np.ptp(position, axis=0)
    side = int(ranges[1] > ranges[0])
    views = [(0, 1), (side, 2)]
    size = max(*(float(ranges[list(view)].max()) for view in views), 1e-300)
    room = 0.5 * WIDE - 2 * EDGE
    step = 10.0 ** math.floor(math.log10(size))
    step *= 0.5 if size < 2.0 * step else 1.0
    parts = []
    for k, (x, y) in enumerate(views):
        left, floor = EDGE + 0.5 * WIDE * k, HIGH - EDGE
        scale = room / size
        across = left + scale * (position[:, x] - low[x]) + 0.5 * scale * (size - ranges[x])
        up = floor - scale * (position[:, y] - low[y]) - 0.5 * scale * (size - ranges[y])
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up, strict=True))
        parts.append(
            f'<rect x="{left}" y="{floor - room}" width="{room}" height="{room}" fill="none" '
            f'stroke="{GRID}"/><polyline points="{points}" fill="none" stroke="{BLUE}" '
            f'stroke-width="1.5"/><circle cx="{across[0]:.1f}" cy="{up[0]:.1f}" r="4" '
            f'fill="{BLACK}"/><circle cx="{across[-1]:.1f}" cy="{up[-1]:.1f}" r="4" fill="white" '
            f'stroke="{BLACK}"/><text x="{left + 0.5 * room}" y="{floor + 16}" fill="{AXES[x]}" '
            f'text-anchor="middle">{"xyz"[x]}</text><text x="{left - 10}" '
            f'y="{floor - 0.5 * room}" fill="{AXES[y]}" text-anchor="end">{"xyz"[y]}</text>'
        )
    end = EDGE + step * room / size
    parts.append(
        f'<path d="M{EDGE} {HIGH - 14}H{end:.1f}" stroke="{FAINT}" stroke-width="3"/>'
        f'<text x="{end + 8:.1f}" y="{HIGH - 10}" fill="{FAINT}">{step:g} m; &#9679; begin, '
        "&#9675; end</text>"
    )
    return _drawing(f"path of {name}: from above, and from the side", WIDE, HIGH, parts)


def recorded_times(found: Analysis) -> str:
    """SVG of the time span of each source and its gaps."""
    rates = {name: figures.rates.as_dict() for name, figures in found.figures.items()}
    rates = {name: rate for name, rate in rates.items() if rate["first"] is not None}
    if not rates:
        return ""
    first = min(rate["first"] for rate in rates.values())
    last = max(rate["last"] for rate in rates.values())
    names, left, wide = 220, 230, 900
    scale = wide / ((last - first) or 1.0)
    parts, row = [], 0
    for name, rate in list(rates.items())[:MOST]:
        y = 16 * row + 30
        begin, end = (left + scale * (rate[key] - first) for key in ("first", "last"))
        label = name if len(name) <= 32 else f"...{name[-30:]}"
        parts.append(
            f'<text x="{names}" y="{y + 9}" text-anchor="end">{html.escape(label)}</text>'
            f'<rect x="{begin:.1f}" y="{y}" width="{max(end - begin, 1.0):.1f}" height="9" '
            f'fill="{BLUE}"/>'
        )
        for gap in rate["first_gaps"]:
            at = left + scale * (gap["after"] - first)
            width = max(scale * gap["seconds"], 2.0)
            parts.append(
                f'<rect x="{at:.1f}" y="{y - 2}" width="{width:.1f}" height="13" fill="{BAD}"/>'
            )
        row += 1
    gaps = any(rate["gaps"] for rate in rates.values())
    shown = "blue: readings; red: gaps" if gaps else "blue: readings; no source has a gap"
    parts.append(
        f'<text x="{left}" y="{16 * row + 42}" fill="{FAINT}">{first:.6g} s</text>'
        f'<text x="{left + wide}" y="{16 * row + 42}" text-anchor="end" fill="{FAINT}">'
        f"{last:.6g} s</text>"
    )
    return _drawing(shown, left + wide + 20, 16 * row + 52, parts)


def _drawing(title: str, width: float, height: float, parts: list[str]) -> str:
    return (
        f'<svg class="drawn" viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
        f'<text x="8" y="17" font-weight="600">{html.escape(title)}</text>{"".join(parts)}</svg>'
    )
