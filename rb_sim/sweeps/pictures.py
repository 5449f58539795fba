"""The pictures of a sweep's report: plotly for the page, matplotlib for the maps as PNG."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.palette import CYCLE
from rb_sim.sweeps import storage
from rb_sim.sweeps.one_run import OK
from rb_sim.sweeps.plan import LoadedPlan, listed

if TYPE_CHECKING:
    import pyarrow


# The table of a sweep, read a column at a time: a report of a million runs stays small.


class RunTable:
    """The rows of a sweep ordered by run; only the column that is asked for is in memory.

    Raises RbSimError where the folder holds no sweep.
    """

    def __init__(self, folder: Path) -> None:
        dataset = storage.open_dataset(folder)
        self.schema: pyarrow.Schema = dataset.schema
        self._files: list[str] = dataset.files
        runs = self._read("run", lambda values: values.to_numpy())
        in_order = bool((np.diff(runs) > 0).all())
        self._order = slice(None) if in_order else np.argsort(runs, kind="stable")
        self.runs = runs[self._order]
        """numbers of all runs, shape (rows,)."""
        self.ok = self._read("status", _is_ok)[self._order]
        """which runs came to their end, shape (rows,)."""

    def __len__(self) -> int:
        return len(self.runs)

    @property
    def good_runs(self) -> np.ndarray:
        """Numbers of the runs that came to their end, shape (good,)."""
        return self.runs[self.ok]

    def plan(self) -> LoadedPlan:
        """The plan that the table was made by. Raises RbSimError where it names none."""
        return storage.plan_of(self.schema)

    def label(self, name: str) -> str:
        """The name of a column with its unit."""
        about: Mapping[bytes, bytes] = self.schema.field(name).metadata or {}
        unit = about.get(b"unit", b"").decode()
        return f"{name} [{unit}]" if unit not in ("", "1") else name

    def column(self, name: str) -> np.ndarray:
        """A column of all runs as floats, shape (rows,)."""
        return self._read(name, lambda values: values.to_numpy().astype(float))[self._order]

    def good(self, name: str) -> np.ndarray:
        """A column of the runs that came to their end, shape (good,)."""
        values = self.column(name)
        return values if self.ok.all() else values[self.ok]

    def failures(self) -> dict[str, int]:
        """How many runs did not come to their end, by "status: reason"."""
        counts: Counter[str] = Counter()
        if not self.ok.all():
            for table in self._tables(["status", "reason"]):
                rows = zip(*(column.to_pylist() for column in table.columns), strict=True)
                counts.update(f"{status}: {why}" for status, why in rows if status != OK)
        return dict(counts)

    def _read(self, name: str, convert: Callable[[Any], np.ndarray]) -> np.ndarray:
        """A column of all files one after the other, each made an array by `convert`."""
        return np.concatenate([convert(table.column(0)) for table in self._tables([name])])

    def _tables(self, names: list[str]) -> Iterator[pyarrow.Table]:
        """These columns of one file after the other: to read ahead would outweigh them."""
        for file in self._files:
            yield storage.read(Path(file), names)


def _is_ok(status: Any) -> np.ndarray:
    compute: Any = import_module("pyarrow.compute")
    return compute.equal(status, OK).to_numpy().astype(bool)


STYLE = (
    "body{font-family:sans-serif;max-width:72em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:.2em .6em;text-align:left}"
)


def page(title: str, sections: list[str]) -> str:
    """A self-contained HTML page; plotly's JavaScript is in it once."""
    from plotly.offline import get_plotlyjs

    head = f"<meta charset='utf-8'><title>{html.escape(title)}</title><style>{STYLE}</style>"
    script = f"<script>{get_plotlyjs()}</script>"
    body = f"<h1>{html.escape(title)}</h1>" + "".join(sections)
    return f"<!doctype html><html><head>{head}{script}</head><body>{body}</body></html>"


def _figure(title: str, figure: Any) -> str:
    figure.update_layout(
        template="plotly_white", colorway=CYCLE, margin={"l": 70, "r": 20, "t": 50, "b": 50}
    )
    figure.update_xaxes(exponentformat="power")
    figure.update_yaxes(exponentformat="power")
    shown = figure.to_html(full_html=False, include_plotlyjs=False)
    return f"<h2>{html.escape(title)}</h2>{shown}"


def distributions(table: RunTable, outputs: list[str]) -> str:
    """A histogram of each output; nothing where there are none."""
    if not outputs:
        return ""
    from plotly import graph_objects as go
    from plotly.subplots import make_subplots

    rows = (len(outputs) + 1) // 2
    titles = [table.label(name) for name in outputs]
    figure = make_subplots(rows=rows, cols=2, subplot_titles=titles)
    for i, name in enumerate(outputs):
        values = table.good(name)
        counts, edges = np.histogram(values[np.isfinite(values)], bins=40)
        bar = go.Bar(x=0.5 * (edges[1:] + edges[:-1]), y=counts, width=np.diff(edges))
        figure.add_trace(bar, row=i // 2 + 1, col=i % 2 + 1)
    figure.update_yaxes(title="runs", col=1)
    figure.update_layout(showlegend=False, bargap=0, height=280 * rows)
    return _figure("Distributions", figure)


def scatter_matrix(table: RunTable, names: list[str], columns: int, most: int) -> str:
    """Every pair of these of so many columns, of at most `most` runs evenly picked."""
    from plotly import graph_objects as go

    picked = slice(None, None, max(1, len(table) // most))
    dimensions = [{"label": table.label(n), "values": table.good(n)[picked]} for n in names]
    matrix = go.Splom(dimensions=dimensions, marker={"size": 3}, diagonal_visible=False)
    figure = go.Figure(matrix)
    figure.update_layout(height=160 * len(names) + 120)
    some = f" ({len(names)} of {columns} columns)" if len(names) < columns else ""
    return _figure(f"Scatter matrix{some}", figure)


def picked_columns(varied: list[str], outputs: list[str], most: int) -> list[str]:
    """At most so many columns, of both sorts as far as there are any."""
    left = max(most // 2, most - len(outputs))
    chosen = varied[:left]
    return [*chosen, *outputs[: most - len(chosen)]]


def index_bars(indices: dict[str, dict[str, tuple[float, float]]]) -> str:
    """First-order and total Sobol indices side by side; nothing where there are none."""
    from plotly import graph_objects as go

    sections = []
    for output, by_name in indices.items():
        names = list(by_name)
        figure = go.Figure(
            [
                go.Bar(name="first order", x=names, y=[by_name[n][0] for n in names]),
                go.Bar(name="total", x=names, y=[by_name[n][1] for n in names]),
            ]
        )
        figure.update_layout(barmode="group", height=320, yaxis_title="Sobol index")
        sections.append(_figure(f"Sensitivity of {output}", figure))
    return "".join(sections)


class Axis(NamedTuple):
    """A listed number as an axis of a picture."""

    name: str
    values: np.ndarray
    """in rising order, each once."""
    places: np.ndarray
    """where each of them stands in the plan."""


def grid_axes(loaded: LoadedPlan) -> list[Axis]:
    """The listed numbers of a plan that draws none and lists one or two; else []."""
    plan = loaded.plan
    listing = [(name, listed(vary)) for name, vary in plan.vary.items() if not vary.random]
    if plan.drawn or len(listing) > 2:
        return []
    return [Axis(name, *np.unique(values, return_index=True)) for name, values in listing]


def grid_values(loaded: LoadedPlan, table: RunTable, output: str) -> np.ndarray:
    """An output over the axes of the grid, NaN where its run failed."""
    values = np.full(loaded.plan.grid_shape, np.nan)
    values.ravel()[table.good_runs] = table.good(output)
    return values[np.ix_(*(axis.places for axis in grid_axes(loaded)))]


def maps_section(loaded: LoadedPlan, table: RunTable, outputs: list[str]) -> str:
    """A map of each output over the two numbers that vary on a grid."""
    from plotly import graph_objects as go

    axes = grid_axes(loaded)
    if len(axes) != 2:
        return ""
    (x, xs, _), (y, ys, _) = axes
    sections = []
    for output in outputs:
        z = grid_values(loaded, table, output).T
        figure = go.Figure(go.Heatmap(x=xs, y=ys, z=z, colorscale="Viridis"))
        figure.update_layout(xaxis_title=table.label(x), yaxis_title=table.label(y), height=560)
        sections.append(_figure(table.label(output), figure))
    return "".join(sections)


def save(loaded: LoadedPlan, table: RunTable, outputs: list[str], folder: Path) -> list[Path]:
    """A PNG of each output in `folder`: over a grid of two numbers a map, of one a curve.

    Where anything is drawn it is a histogram.
    """
    from matplotlib.figure import Figure

    axes = grid_axes(loaded)
    written = []
    for output in outputs:
        figure = Figure(figsize=(7.5, 5.5), dpi=120, layout="constrained")
        axis = figure.add_subplot()
        if len(axes) == 2:
            kind = _draw_map(figure, axis, loaded, table, output)
        elif len(axes) == 1:
            kind = _draw_curve(axis, loaded, table, output)
        else:
            kind = _draw_histogram(axis, table, output)
        axis.set_title(f"{Path(loaded.scene_file).stem}: {output}")
        path = folder / f"{kind}_{output}.png"
        figure.savefig(path)
        written.append(path)
    return written


def _scale(loaded: LoadedPlan, name: str) -> str:
    grid = loaded.plan.vary[name].grid
    return grid.spacing if grid else "linear"


def _draw_map(figure: Any, axis: Any, loaded: LoadedPlan, table: RunTable, output: str) -> str:
    (x, xs, _), (y, ys, _) = grid_axes(loaded)
    mesh = axis.pcolormesh(xs, ys, grid_values(loaded, table, output).T, shading="nearest")
    figure.colorbar(mesh, label=table.label(output))
    axis.set(xlabel=table.label(x), ylabel=table.label(y))
    axis.set(xscale=_scale(loaded, x), yscale=_scale(loaded, y))
    return "map"


def _draw_curve(axis: Any, loaded: LoadedPlan, table: RunTable, output: str) -> str:
    ((x, xs, _),) = grid_axes(loaded)
    axis.plot(xs, grid_values(loaded, table, output), ".-", color=CYCLE[0])
    axis.set(xlabel=table.label(x), ylabel=table.label(output), xscale=_scale(loaded, x))
    axis.grid(alpha=0.3)
    return "curve"


def _draw_histogram(axis: Any, table: RunTable, output: str) -> str:
    values = table.good(output)
    axis.hist(values[np.isfinite(values)], bins=40, color=CYCLE[0])
    axis.set(xlabel=table.label(output), ylabel="runs")
    return "distribution"
