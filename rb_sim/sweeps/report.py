"""What a sweep says: distributions, scatter matrix, Sobol indices, worst runs, basin maps.

One HTML file that opens offline (plotly's own JavaScript is inside), beside it a picture of each
output and the worst runs as scenes of their own.
"""

from __future__ import annotations

import html
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.errors import MissingExtraError, RbSimError
from rb_sim.sweeps import storage
from rb_sim.sweeps.one_run import OK, PlanRunner
from rb_sim.sweeps.plan import LoadedPlan
from rb_sim.sweeps.points import saltelli_problem
from rb_sim.sweeps.slopes import Slopes, slopes

if TYPE_CHECKING:
    import pyarrow

WORST = 3
"""Runs listed at either end of each output."""

MOST_IN_SCATTER = 6
"""Columns of the scatter matrix: beyond, nobody can read it."""

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
        return f"rb_sim run {self.scene} --out {self.scene.with_suffix('')}"


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

    Raises RbSimError where the folder holds no sweep, MissingExtraError without plotly.
    """
    try:
        import plotly  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("plotly", "sweep", "the report of a sweep") from error
    from rb_sim.sweeps import pictures

    where = Path(folder)
    table = storage.open_table(where, without=("scene_hash",))
    loaded = storage.plan_of(table)
    outputs = numeric_outputs(loaded, table)
    ok = _is_ok(table)
    good = table if ok.all() else table.filter(storage.arrow().array(ok))
    if not len(good):
        raise RbSimError(f"{where}: none of its {len(table)} runs came to an end; see `reason`")
    extremes = tuple(_extremes(loaded, good, outputs, where / "worst"))
    indices = sobol_indices(loaded, table, outputs)
    runner = PlanRunner(loaded)
    at_middle = slopes(runner, *_middle(loaded, table))
    drawn = pictures.save(loaded, good, outputs, where)
    sections = [
        _summary(loaded, table),
        pictures.distributions(good, outputs),
        pictures.scatter_matrix(good, [*loaded.plan.vary, *outputs][:MOST_IN_SCATTER], MOST_POINTS),
        pictures.index_bars(indices),
        _slopes_section(at_middle),
        pictures.maps_section(loaded, good, outputs),
        _extremes_section(extremes),
        _failures_section(table),
    ]
    path = where / "report.html"
    path.write_text(pictures.page(f"Sweep of {Path(loaded.scene_file).stem}", sections))
    failed = len(table) - len(good)
    return Report(path, tuple(drawn), len(table), failed, extremes, indices, at_middle)


def _middle(loaded: LoadedPlan, table: pyarrow.Table) -> tuple[dict[str, float], dict[str, float]]:
    """The median of each varied number, among its values, and its standard deviation."""
    columns = {name: column(table, name) for name in loaded.plan.vary}
    point = {n: float(np.quantile(c, 0.5, method="lower")) for n, c in columns.items()}
    return point, {name: float(values.std()) for name, values in columns.items()}


def numeric_outputs(loaded: LoadedPlan, table: pyarrow.Table) -> list[str]:
    """The plan's outputs; the final state where it has none."""
    named = list(loaded.plan.outputs)
    return named or [n for n in table.column_names if "." in n]


def column(table: pyarrow.Table, name: str) -> np.ndarray:
    """A column as floats, shape (rows,)."""
    return table.column(name).to_numpy(zero_copy_only=False).astype(float)


def _is_ok(table: pyarrow.Table) -> np.ndarray:
    """Which runs came to their end, shape (rows,)."""
    compute: Any = import_module("pyarrow.compute")
    found = compute.equal(table.column("status"), OK)
    return found.to_numpy(zero_copy_only=False).astype(bool)


def _extremes(
    loaded: LoadedPlan, good: pyarrow.Table, outputs: list[str], folder: Path
) -> list[Extreme]:
    """The runs at both ends of each output, their scenes written into `folder`."""
    runner, found = PlanRunner(loaded), []
    runs = good.column("run").to_numpy()
    for name in outputs[:MOST_IN_SCATTER]:
        values = column(good, name)
        order = np.argsort(values, kind="stable")
        order = order[np.isfinite(values[order])]
        ends = (("smallest", order[:WORST]), ("largest", order[::-1][:WORST]))
        for which, rows in ends:
            for row in rows.tolist():
                scene = folder / f"run_{runs[row]}.yaml"
                if not scene.exists():
                    point = {n: float(column(good, n)[row]) for n in loaded.plan.vary}
                    folder.mkdir(parents=True, exist_ok=True)
                    scene.write_text(runner.scene_text(point))
                found.append(Extreme(name, which, int(runs[row]), float(values[row]), scene))
    return found


def sobol_indices(
    loaded: LoadedPlan, table: pyarrow.Table, outputs: list[str]
) -> dict[str, dict[str, tuple[float, float]]]:
    """First-order and total Sobol indices of each output by each drawn name (Saltelli 2010).

    {} unless the plan's sampling is saltelli without a grid, and every run came to its end.
    """
    plan = loaded.plan
    complete = len(table) == plan.runs and bool(_is_ok(table).all())
    if plan.sampling != "saltelli" or plan.grid_shape or not complete:
        return {}
    from SALib.analyze import sobol

    names = list(plan.drawn)
    indices = {}
    for output in outputs:
        y = column(table, output)
        if not np.isfinite(y).all() or np.ptp(y) == 0.0:
            continue
        found = sobol.analyze(saltelli_problem(names), y, calc_second_order=False, seed=plan.seed)
        pairs = zip(found["S1"].tolist(), found["ST"].tolist(), strict=True)
        indices[output] = dict(zip(names, pairs, strict=True))
    return indices


def _summary(loaded: LoadedPlan, table: pyarrow.Table) -> str:
    plan = loaded.plan
    lines = [
        plan.description or "(no description)",
        f"scene {Path(loaded.scene_file).name}, {len(table)} of {plan.runs} runs",
        "varied: " + ", ".join(f"{n} [{v.unit or '-'}]" for n, v in plan.vary.items()),
    ]
    return "".join(f"<p>{html.escape(line)}</p>" for line in lines)


def _slopes_section(found: Slopes) -> str:
    """A table of derivatives, exact beside differences."""
    rows = "".join(
        f"<tr><td>{html.escape(output)}</td><td>{html.escape(name)}</td>"
        f"<td>{slope.exact:.9g}</td><td>{slope.difference:.9g}</td></tr>"
        for output, by_name in found.by_output.items()
        for name, slope in by_name.items()
    )
    if not rows:
        return ""
    at = ", ".join(f"{name} = {value:.6g}" for name, value in found.point.items())
    why = f"<p>No exact ones: {html.escape(found.why)}</p>" if found.why else ""
    head = "<tr><th>d</th><th>/ d</th><th>exact</th><th>difference of two runs</th></tr>"
    return f"<h2>Derivatives at {html.escape(at)}</h2>{why}<table>{head}{rows}</table>"


def _extremes_section(extremes: tuple[Extreme, ...]) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(e.output)}</td><td>{e.which}</td><td>{e.run}</td>"
        f"<td>{e.value:.6g}</td><td><code>{html.escape(e.command)}</code></td></tr>"
        for e in extremes
    )
    head = "<tr><th>output</th><th></th><th>run</th><th>value</th><th>alone</th></tr>"
    return f"<h2>Extreme runs</h2><table>{head}{rows}</table>"


def _failures_section(table: pyarrow.Table) -> str:
    """Runs that did not come to their end, by reason."""
    reasons: dict[str, int] = {}
    bad = table.select(["status", "reason"]).filter(storage.arrow().array(~_is_ok(table)))
    for status, reason in zip(*(column.to_pylist() for column in bad.columns), strict=True):
        reasons[f"{status}: {reason}"] = reasons.get(f"{status}: {reason}", 0) + 1
    if not reasons:
        return ""
    ranked = sorted(reasons.items(), key=lambda item: -item[1])[:20]
    rows = "".join(f"<tr><td>{n}</td><td>{html.escape(r)}</td></tr>" for r, n in ranked)
    return f"<h2>Runs that failed</h2><table><tr><th>runs</th><th>why</th></tr>{rows}</table>"
