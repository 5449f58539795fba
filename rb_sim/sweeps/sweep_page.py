# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Report of a sweep: distributions, scatter matrix, Sobol indices, extreme runs, maps.

One HTML file that opens offline (it contains plotly's JavaScript), a picture of each output, and
the extreme runs as scene files.
"""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import MissingExtraError, RbSimError
from rb_sim.base.palette import CYCLE
from rb_sim.sweeps import storage
from rb_sim.sweeps.one_run import OK, PlanRunner
from rb_sim.sweeps.plan import LoadedPlan, listed, saltelli_problem
from rb_sim.sweeps.slopes import Slopes, slopes

if TYPE_CHECKING:
    import pyarrow


# The table of a sweep, read one column at a time to bound memory.


class RunTable:
    """Rows of a sweep ordered by run; only the requested column is in memory.

    Raises RbSimError if the folder contains no sweep.
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
        """mask of the completed runs, shape (rows,)."""

    def __len__(self) -> int:
        return len(self.runs)

    @property
    def good_runs(self) -> np.ndarray:
        """Numbers of the completed runs, shape (good,)."""
        return self.runs[self.ok]

    def plan(self) -> LoadedPlan:
        """The plan of the table. Raises RbSimError if it contains none."""
        return storage.plan_of(self.schema)

    def label(self, name: str) -> str:
        """Name of a column with its unit."""
        about: Mapping[bytes, bytes] = self.schema.field(name).metadata or {}
        unit = about.get(b"unit", b"").decode()
        return f"{name} [{unit}]" if unit not in ("", "1") else name

    def column(self, name: str) -> np.ndarray:
        """A column of all runs as floats, shape (rows,)."""
        return self._read(name, lambda values: values.to_numpy().astype(float))[self._order]

    def good(self, name: str) -> np.ndarray:
        """A column of the completed runs, shape (good,)."""
        values = self.column(name)
        return values if self.ok.all() else values[self.ok]

    def failures(self) -> dict[str, int]:
        """Number of runs that did not complete, by "status: reason"."""
        counts: Counter[str] = Counter()
        if not self.ok.all():
            for table in self._tables(["status", "reason"]):
                rows = zip(*(column.to_pylist() for column in table.columns), strict=True)
                counts.update(f"{status}: {why}" for status, why in rows if status != OK)
        return dict(counts)

    def _read(self, name: str, convert: Callable[[Any], np.ndarray]) -> np.ndarray:
        """A column of all files, concatenated, each converted to an array by `convert`."""
        return np.concatenate([convert(table.column(0)) for table in self._tables([name])])

    def _tables(self, names: list[str]) -> Iterator[pyarrow.Table]:
        """Yield these columns of one file after the other, without reading ahead."""
        for file in self._files:
            yield storage.read(Path(file), names)


def _is_ok(status: Any) -> np.ndarray:
    compute: Any = import_module("pyarrow.compute")
    return compute.equal(status, OK).to_numpy().astype(bool)


# Pictures of the report: plotly for the page, matplotlib for PNG files.


STYLE = (
    "body{font-family:sans-serif;max-width:72em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:.2em .6em;text-align:left}"
)


def page(title: str, sections: list[str]) -> str:
    """A self-contained HTML page with plotly's JavaScript."""
    from plotly.offline import get_plotlyjs

    head = f"<meta charset='utf-8'><title>{html.escape(title)}</title><style>{STYLE}</style>"
    script = f"<script>{get_plotlyjs()}</script>"
    body = f"<h1>{html.escape(title)}</h1>" + "".join(sections)
    return f"<!doctype html><html><head>{head}{script}</head><body>{body}</body></html>"


def _figure(title: str, figure: Any) -> str:
    figure.update_layout(
        template="plotly_white", colorway=CYCLE, margin={"l": 70, "r": 20, "t": 50, "b": 50}
    )
    for axis in ("xaxis", "yaxis"):  # of the template: those of a scatter matrix exist later
        figure.layout.template.layout[axis].exponentformat = "power"
    shown = figure.to_html(full_html=False, include_plotlyjs=False)
    return f"<h2>{html.escape(title)}</h2>{shown}"


def distributions(table: RunTable, outputs: list[str]) -> str:
    """HTML with a histogram of each output; "" without outputs."""
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


def scatter_matrix(table: RunTable, names: list[str], columns: int) -> str:
    """HTML with a scatter plot of every pair of `names` (of `columns`), for MOST_POINTS runs."""
    from plotly import graph_objects as go

    picked = slice(None, None, max(1, len(table) // MOST_POINTS))
    dimensions = [{"label": table.label(n), "values": table.good(n)[picked]} for n in names]
    matrix = go.Splom(dimensions=dimensions, marker={"size": 3}, diagonal_visible=False)
    figure = go.Figure(matrix)
    figure.update_layout(height=160 * len(names) + 120)
    some = f" ({len(names)} of {columns} columns)" if len(names) < columns else ""
    return _figure(f"Scatter matrix{some}", figure)


def picked_columns(varied: list[str], outputs: list[str], most: int) -> list[str]:
    """At most `most` columns, both varied numbers and outputs."""
    left = max(most // 2, most - len(outputs))
    chosen = varied[:left]
    return [*chosen, *outputs[: most - len(chosen)]]


class Index(NamedTuple):
    """Sobol indices of an output for a varied number."""

    first: float
    total: float
    first_interval: float
    """half of the 95 % confidence interval, by bootstrap."""
    total_interval: float


def index_bars(indices: dict[str, dict[str, Index]]) -> str:
    """HTML with first-order and total Sobol indices; "" without indices."""
    from plotly import graph_objects as go

    sections = []
    for output, by_name in indices.items():
        names, found = list(by_name), list(by_name.values())
        bars = (
            ("first order", [i.first for i in found], [i.first_interval for i in found]),
            ("total", [i.total for i in found], [i.total_interval for i in found]),
        )
        figure = go.Figure(
            [go.Bar(name=n, x=names, y=y, error_y={"array": half}) for n, y, half in bars]
        )
        title = "Sobol index, 95 % interval"
        figure.update_layout(barmode="group", height=320, yaxis_title=title)
        sections.append(_figure(f"Sensitivity of {output}", figure))
    return "".join(sections)


class Axis(NamedTuple):
    """A listed number as an axis of a picture."""

    name: str
    values: np.ndarray
    """increasing, without repetition."""
    places: np.ndarray
    """index of each value in the plan."""


def grid_axes(loaded: LoadedPlan) -> list[Axis]:
    """Axes of a plan with one or two listed and no drawn numbers; else []."""
    plan = loaded.plan
    listing = [(name, listed(vary)) for name, vary in plan.vary.items() if not vary.random]
    if plan.drawn or len(listing) > 2:
        return []
    return [Axis(name, *np.unique(values, return_index=True)) for name, values in listing]


def grid_values(loaded: LoadedPlan, table: RunTable, output: str) -> np.ndarray:
    """An output on the grid; NaN if the run failed."""
    values = np.full(loaded.plan.grid_shape, np.nan)
    values.ravel()[table.good_runs] = table.good(output)
    return values[np.ix_(*(axis.places for axis in grid_axes(loaded)))]


def maps_section(loaded: LoadedPlan, table: RunTable, outputs: list[str]) -> str:
    """HTML with a map of each output over two listed numbers; else ""."""
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
    """Write a PNG of each output to `folder`: a map over two listed numbers, a curve over one, else
    a histogram. Returns the paths.
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
    z = grid_values(loaded, table, output).T
    mesh = axis.pcolormesh(xs, ys, z, shading="nearest")
    bar = figure.colorbar(mesh, label=table.label(output))
    if np.isin(z[np.isfinite(z)], (0.0, 1.0)).all():  # yes or no: two colours
        mesh.set(cmap=mesh.cmap.resampled(2), clim=(-0.5, 1.5))
        bar.set_ticks([0.0, 1.0], labels=["no", "yes"])
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
    axis.hist(values[np.isfinite(values)], bins=40, color=CYCLE[0], histtype="stepfilled")
    axis.set(xlabel=table.label(output), ylabel="runs")
    return "distribution"


WORST = 3
"""Number of runs listed at either end of each output."""

MOST_IN_SCATTER = 6
"""Maximum number of columns of the scatter matrix."""

MOST_WITH_EXTREMES = 40
"""Maximum number of outputs with listed extremes (final states have many columns)."""

MOST_POINTS = 5000
"""Maximum number of points in a scatter plot."""


class Extreme(NamedTuple):
    """A run at an end of an output's distribution, and how to reproduce it."""

    output: str
    which: str
    """largest or smallest."""
    run: int
    value: float
    scene: Path
    """its scene file (YAML)."""

    @property
    def command(self) -> str:
        """The command that runs it with bag, recording and plots."""
        scene, folder = (quote(str(path)) for path in (self.scene, self.scene.with_suffix("")))
        return f"rb_sim run {scene} --out {folder}"


class Report(NamedTuple):
    """Files of a report, and its figures."""

    html: Path
    pictures: tuple[Path, ...]
    runs: int
    failed: int
    extremes: tuple[Extreme, ...]
    indices: dict[str, dict[str, Index]]
    """output -> varied name -> Sobol indices; {} without saltelli."""
    slopes: Slopes


def report(folder: str | Path) -> Report:
    """Write report.html, pictures and extreme runs of the sweep in `folder`.

    Raises RbSimError if the folder contains no sweep or cannot be written, MissingExtraError
    without plotly.
    """
    try:
        import plotly  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("plotly", "sweep", "the report of a sweep") from error
    where = Path(folder)
    try:
        return _written(where)
    except OSError as error:
        why = error.strerror or error
        raise RbSimError(f"{error.filename or where}: cannot be written: {why}") from None


def _written(where: Path) -> Report:
    """Write the report of the sweep in that folder."""
    table = RunTable(where)
    loaded = table.plan()
    outputs = numeric_outputs(loaded, table)
    if not table.ok.any():
        raise RbSimError(f"{where}: none of its {len(table)} runs came to an end; see `reason`")
    extremes = tuple(_extremes(loaded, table, outputs, where / "worst"))
    indices = sobol_indices(loaded, table, outputs)
    runner = PlanRunner(loaded)
    at_middle = slopes(runner, *_middle(loaded, table))
    varied = list(loaded.plan.vary)
    scattered = picked_columns(varied, outputs, MOST_IN_SCATTER)
    drawn = save(loaded, table, outputs, where)
    sections = [
        _summary(loaded, table),
        distributions(table, outputs),
        scatter_matrix(table, scattered, len(varied) + len(outputs)),
        index_bars(indices),
        _slopes_section(at_middle, table),
        maps_section(loaded, table, outputs),
        _extremes_section(extremes, table, len(outputs)),
        _failures_section(table),
    ]
    path = where / "report.html"
    path.write_text(page(f"Sweep of {Path(loaded.scene_file).stem}", sections))
    failed = int((~table.ok).sum())
    return Report(path, tuple(drawn), len(table), failed, extremes, indices, at_middle)


def _middle(loaded: LoadedPlan, table: RunTable) -> tuple[dict[str, float], dict[str, float]]:
    """Median (an actual value) and standard deviation of each varied number."""
    columns = {name: table.column(name) for name in loaded.plan.vary}
    point = {n: float(np.quantile(c, 0.5, method="lower")) for n, c in columns.items()}
    return point, {name: float(values.std()) for name, values in columns.items()}


def numeric_outputs(loaded: LoadedPlan, table: RunTable) -> list[str]:
    """The plan's outputs; the final state if it has none."""
    named = list(loaded.plan.outputs)
    return named or [n for n in table.schema.names if "." in n]


def _extremes(
    loaded: LoadedPlan, table: RunTable, outputs: list[str], folder: Path
) -> list[Extreme]:
    """Runs at both ends of each output, with scenes written into `folder`."""
    runs, found = table.good_runs, []
    rows_found: list[int] = []
    for name in outputs[:MOST_WITH_EXTREMES]:
        values = table.good(name)
        order = np.argsort(values, kind="stable")
        order = order[np.isfinite(values[order])]
        ends = (("smallest", order[:WORST]), ("largest", order[::-1][:WORST]))
        for which, rows in ends:
            for row in rows.tolist():
                scene = folder / f"run_{runs[row]}.yaml"
                found.append(Extreme(name, which, int(runs[row]), float(values[row]), scene))
                rows_found.append(row)
    _write_scenes(loaded, table, rows_found, folder)
    return found


def _write_scenes(loaded: LoadedPlan, table: RunTable, rows: list[int], folder: Path) -> None:
    """Write the scenes of these rows of completed runs, as run_NUMBER.yaml."""
    runner = PlanRunner(loaded)
    folder.mkdir(parents=True, exist_ok=True)
    columns = {name: table.good(name)[rows] for name in loaded.plan.vary}
    for k, run in enumerate(table.good_runs[rows]):
        point = {name: float(values[k]) for name, values in columns.items()}
        (folder / f"run_{run}.yaml").write_text(runner.scene_text(point))


def sobol_indices(
    loaded: LoadedPlan, table: RunTable, outputs: list[str]
) -> dict[str, dict[str, Index]]:
    """First-order and total Sobol indices of each output for each drawn name (Saltelli 2010).

    {} unless the sampling is saltelli without a grid, and all runs completed.
    """
    plan = loaded.plan
    complete = len(table) == plan.runs and bool(table.ok.all())
    if plan.sampling != "saltelli" or plan.grid_shape or not complete:
        return {}
    from SALib.analyze import sobol

    names = list(plan.drawn)
    indices = {}
    for output in outputs:
        y = table.column(output)
        if not np.isfinite(y).all() or np.ptp(y) == 0.0:
            continue
        found = sobol.analyze(saltelli_problem(names), y, calc_second_order=False, seed=plan.seed)
        columns = (found[key].tolist() for key in ("S1", "ST", "S1_conf", "ST_conf"))
        each = (Index(*row) for row in zip(*columns, strict=True))
        indices[output] = dict(zip(names, each, strict=True))
    return indices


def _summary(loaded: LoadedPlan, table: RunTable) -> str:
    plan = loaded.plan
    lines = [
        plan.description or "(no description)",
        f"scene {Path(loaded.scene_file).name}, {len(table)} of {plan.runs} runs",
        "varied: " + ", ".join(f"{n} [{v.unit or '-'}]" for n, v in plan.vary.items()),
    ]
    return "".join(f"<p>{html.escape(line)}</p>" for line in lines)


SLOPE_HEADS = ("derivative of", "by", "exact", "difference of two runs")


def _slopes_section(found: Slopes, table: RunTable) -> str:
    """HTML table of derivatives, exact and by differences."""
    rows = [
        (table.label(output), table.label(name), *slope.texts())
        for output, by_name in found.by_output.items()
        for name, slope in by_name.items()
    ]
    if not rows:
        return ""
    at = ", ".join(f"{name} = {value:.6g}" for name, value in found.point.items())
    why = f"<p>No exact derivatives: {html.escape(found.why)}</p>" if found.why else ""
    shown = _table(SLOPE_HEADS, rows)
    return f"<h2>Derivatives at {html.escape(at)}</h2>{why}{shown}"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """HTML table of text rows, which are escaped."""
    cells = [("th", heads), *(("td", row) for row in rows)]
    lines = ("".join(f"<{tag}>{html.escape(c)}</{tag}>" for c in row) for tag, row in cells)
    return "<table>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"


def _extremes_section(extremes: tuple[Extreme, ...], table: RunTable, outputs: int) -> str:
    """HTML table of the extreme runs of each output; "" without outputs."""
    if not extremes:
        return ""
    rows = [
        (table.label(e.output), e.which, str(e.run), f"{e.value:.6g}", e.command) for e in extremes
    ]
    shown = f" of the first {MOST_WITH_EXTREMES} of {outputs} outputs"
    title = "Extreme runs" + (shown if outputs > MOST_WITH_EXTREMES else "")
    return f"<h2>{title}</h2>{_table(('output', '', 'run', 'value', 'to see it alone'), rows)}"


def _failures_section(table: RunTable) -> str:
    """HTML table of the runs that did not complete, by reason."""
    reasons = table.failures()
    if not reasons:
        return ""
    ranked = sorted(reasons.items(), key=lambda item: -item[1])[:20]
    return "<h2>Runs that failed</h2>" + _table(("runs", "why"), ((str(n), r) for r, n in ranked))
