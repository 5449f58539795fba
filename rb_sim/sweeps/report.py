"""What a sweep says: distributions, scatter matrix, Sobol indices, worst runs, basin maps.

One HTML file that opens offline (plotly's own JavaScript is inside), beside it a picture of each
output and the worst runs as scenes of their own.
"""

from __future__ import annotations

import html
from pathlib import Path
from shlex import quote
from typing import NamedTuple

import numpy as np

from rb_sim.base.errors import MissingExtraError, RbSimError
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.sweeps.pictures import RunTable
from rb_sim.sweeps.plan import LoadedPlan, saltelli_problem
from rb_sim.sweeps.slopes import Slopes, slopes

WORST = 3
"""Runs listed at either end of each output."""

MOST_IN_SCATTER = 6
"""Columns of the scatter matrix: beyond, nobody can read it."""

MOST_WITH_EXTREMES = 40
"""Outputs whose worst runs are listed; the final state of many bodies has more columns."""

MOST_POINTS = 5000
"""Drawn in one scatter matrix."""


class Extreme(NamedTuple):
    """A run at an end of an output's distribution, and how to see it alone."""

    output: str
    which: str
    """largest or smallest."""
    run: int
    value: float
    scene: Path
    """YAML file that runs it."""

    @property
    def command(self) -> str:
        """The command that runs it alone, with bag, recording and plots."""
        scene, folder = (quote(str(path)) for path in (self.scene, self.scene.with_suffix("")))
        return f"rb_sim run {scene} --out {folder}"


class Report(NamedTuple):
    """What has been written, and the figures in it."""

    html: Path
    pictures: tuple[Path, ...]
    runs: int
    failed: int
    extremes: tuple[Extreme, ...]
    indices: dict[str, dict[str, tuple[float, float]]]
    """output -> varied name -> (first-order, total Sobol index); {} without saltelli."""
    slopes: Slopes


def report(folder: str | Path) -> Report:
    """Write report.html, pictures and worst runs of the sweep in `folder`.

    Raises RbSimError where the folder holds no sweep or cannot be written, MissingExtraError
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
    """The report of the sweep in that folder."""
    from rb_sim.sweeps import pictures

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
    scattered = pictures.picked_columns(varied, outputs, MOST_IN_SCATTER)
    drawn = pictures.save(loaded, table, outputs, where)
    sections = [
        _summary(loaded, table),
        pictures.distributions(table, outputs),
        pictures.scatter_matrix(table, scattered, len(varied) + len(outputs), MOST_POINTS),
        pictures.index_bars(indices),
        _slopes_section(at_middle, table),
        pictures.maps_section(loaded, table, outputs),
        _extremes_section(extremes, table, len(outputs)),
        _failures_section(table),
    ]
    path = where / "report.html"
    path.write_text(pictures.page(f"Sweep of {Path(loaded.scene_file).stem}", sections))
    failed = int((~table.ok).sum())
    return Report(path, tuple(drawn), len(table), failed, extremes, indices, at_middle)


def _middle(loaded: LoadedPlan, table: RunTable) -> tuple[dict[str, float], dict[str, float]]:
    """The median of each varied number, among its values, and its standard deviation."""
    columns = {name: table.column(name) for name in loaded.plan.vary}
    point = {n: float(np.quantile(c, 0.5, method="lower")) for n, c in columns.items()}
    return point, {name: float(values.std()) for name, values in columns.items()}


def numeric_outputs(loaded: LoadedPlan, table: RunTable) -> list[str]:
    """The plan's outputs; the final state where it has none."""
    named = list(loaded.plan.outputs)
    return named or [n for n in table.schema.names if "." in n]


def _extremes(
    loaded: LoadedPlan, table: RunTable, outputs: list[str], folder: Path
) -> list[Extreme]:
    """The runs at both ends of each output, their scenes written into `folder`."""
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
    """Write the scenes of these rows of the good runs, as run_NUMBER.yaml."""
    runner = PlanRunner(loaded)
    folder.mkdir(parents=True, exist_ok=True)
    columns = {name: table.good(name)[rows] for name in loaded.plan.vary}
    for k, run in enumerate(table.good_runs[rows]):
        point = {name: float(values[k]) for name, values in columns.items()}
        (folder / f"run_{run}.yaml").write_text(runner.scene_text(point))


def sobol_indices(
    loaded: LoadedPlan, table: RunTable, outputs: list[str]
) -> dict[str, dict[str, tuple[float, float]]]:
    """First-order and total Sobol indices of each output by each drawn name (Saltelli 2010).

    {} unless the plan's sampling is saltelli without a grid, and every run came to its end.
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
        pairs = zip(found["S1"].tolist(), found["ST"].tolist(), strict=True)
        indices[output] = dict(zip(names, pairs, strict=True))
    return indices


def _summary(loaded: LoadedPlan, table: RunTable) -> str:
    plan = loaded.plan
    lines = [
        plan.description or "(no description)",
        f"scene {Path(loaded.scene_file).name}, {len(table)} of {plan.runs} runs",
        "varied: " + ", ".join(f"{n} [{v.unit or '-'}]" for n, v in plan.vary.items()),
    ]
    return "".join(f"<p>{html.escape(line)}</p>" for line in lines)


def _slopes_section(found: Slopes, table: RunTable) -> str:
    """A table of derivatives, exact beside differences."""
    rows = "".join(
        f"<tr><td>{html.escape(table.label(output))}</td><td>{html.escape(table.label(name))}</td>"
        f"<td>{slope.exact:.9g}</td><td>{slope.difference:.9g}</td></tr>"
        for output, by_name in found.by_output.items()
        for name, slope in by_name.items()
    )
    if not rows:
        return ""
    at = ", ".join(f"{name} = {value:.6g}" for name, value in found.point.items())
    why = f"<p>Not exact: {html.escape(found.why)}</p>" if found.why else ""
    head = "<tr><th>d</th><th>/ d</th><th>exact</th><th>difference of two runs</th></tr>"
    return f"<h2>Derivatives at {html.escape(at)}</h2>{why}<table>{head}{rows}</table>"


def _extremes_section(extremes: tuple[Extreme, ...], table: RunTable, outputs: int) -> str:
    """A table of the runs at the ends of each output; nothing where there are no outputs."""
    if not extremes:
        return ""
    rows = "".join(
        f"<tr><td>{html.escape(table.label(e.output))}</td><td>{e.which}</td><td>{e.run}</td>"
        f"<td>{e.value:.6g}</td><td><code>{html.escape(e.command)}</code></td></tr>"
        for e in extremes
    )
    head = "<tr><th>output</th><th></th><th>run</th><th>value</th><th>to see it alone</th></tr>"
    shown = f" of the first {MOST_WITH_EXTREMES} of {outputs} outputs"
    title = "Extreme runs" + (shown if outputs > MOST_WITH_EXTREMES else "")
    return f"<h2>{title}</h2><table>{head}{rows}</table>"


def _failures_section(table: RunTable) -> str:
    """Runs that did not come to their end, by reason."""
    reasons = table.failures()
    if not reasons:
        return ""
    ranked = sorted(reasons.items(), key=lambda item: -item[1])[:20]
    rows = "".join(f"<tr><td>{n}</td><td>{html.escape(r)}</td></tr>" for r, n in ranked)
    return f"<h2>Runs that failed</h2><table><tr><th>runs</th><th>why</th></tr>{rows}</table>"
