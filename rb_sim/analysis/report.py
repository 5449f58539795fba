"""One HTML file that needs nothing else: facts, notes, interactive plots, a picture of the bag."""

from __future__ import annotations

import base64
import html
import math
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.analysis.analyze import UNITS, Analysis
from rb_sim.analysis.figures import Figures
from rb_sim.errors import MissingExtraError, SinkError

STYLE = """body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;
color:#222}h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse}
td,th{padding:.15em .8em .15em 0;text-align:right;font-variant-numeric:tabular-nums}
td:first-child,th:first-child{text-align:left}th{border-bottom:1px solid #bbb}
.note{color:#9a4a00}img{max-width:100%}"""

RESIDUAL = "residual"
"""The source whose numbers are violations of constraints, relative to the scene's scale."""

LEAST, RESOLVED = 1e-17, 1e-9
"""Of residuals: where their axis begins, and up to where it goes at least: rounding lies below."""


def write_report(found: Analysis, path: Path, picture: Path | None = None) -> None:
    """Write the report. picture: a PNG to show first. MissingExtraError without plotly."""
    try:
        graph = import_module("plotly.graph_objects")
    except ImportError:
        raise MissingExtraError("plotly", "analysis", "report.html") from None
    parts = [f"<h1>{html.escape(found.name)}</h1>"]
    parts += [f'<p class="note">{html.escape(note)}</p>' for note in found.notes]
    if picture is not None:
        data = base64.b64encode(picture.read_bytes()).decode()
        parts.append(f'<img alt="the scene in Rerun" src="data:image/png;base64,{data}">')
    parts += [_sources(found), _bodies(found), _balances(found), _constraints(found)]
    parts += _figures(found, graph)
    text = "\n".join(
        ["<!doctype html><html><head><meta charset='utf-8'>",
         f"<title>{html.escape(found.name)}</title><style>{STYLE}</style></head><body>",
         *parts, "</body></html>"]
    )  # fmt: skip
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SinkError(f"{path}: {error.strerror}") from None


def _table(title: str, heads: list[str], rows: list[str]) -> str:
    return f"<h2>{title}</h2><table>{_row(heads, 'th')}{''.join(rows)}</table>"


def _row(cells: list[str], tag: str = "td") -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"


def _sources(found: Analysis) -> str:
    heads = ["source", "kind", "readings", "rate [Hz]", "jitter [ms]", "gaps", "longest [s]"]
    rows = []
    for name, figures in found.figures.items():
        rates = figures.rates.as_dict()
        rate = "" if rates["rate"] is None else f"{rates['rate']:.6g}"
        jitter = f"{1e3 * rates['jitter']:.3g}" if rates["jitter"] > 1e-9 else "0"
        rows.append(_row([name, found.kinds[name], str(rates["count"]), rate, jitter,
                          str(rates["gaps"]), f"{rates['longest_gap']:.4g}"]))  # fmt: skip
    return _table("Sources", heads, rows)


def _bodies(found: Analysis) -> str:
    rows = []
    for name, body in found.bodies.items():
        apart = body.as_dict().get("apart")
        if apart is not None:
            rows.append(_row([name, f"{apart['force']:.3g}", f"{apart['torque']:.3g}"]))
    title = "Inverse dynamics from the poses against recorded wrenches, RMS apart"
    return _table(title, ["body", "force [N]", "torque [N m]"], rows) if rows else ""


def _balances(found: Analysis) -> str:
    """Change less supply of energy and momenta, as in the terminal."""
    rows = []
    balances = {"": found.balance} if found.balance else found.balances
    for name, balance in balances.items():
        momentum = balance["momentum"] or {}
        parts = {"energy [J]": balance["energy"], "linear momentum [N s]": momentum.get("linear"),
                 "angular momentum [N m s]": momentum.get("angular")}  # fmt: skip
        for what, row in parts.items():
            if row is not None:
                numbers = [f"{abs(row[key]):.3g}" for key in ("error", "scale", "quadrature")]
                rows.append(_row([f"{name} {what}".strip(), *numbers]))
    heads = ["balance", "left", "of", "half the samples change it by"]
    return _table("Change less what is known to have acted", heads, rows) if rows else ""


def _constraints(found: Analysis) -> str:
    """Largest errors by constraint."""
    told = found.constraints
    if told is None:
        return ""
    rows = []
    for kind, unit in (("position", "m or rad"), ("velocity", "m/s or rad/s"), ("overlap", "m")):
        for name, worst in told[kind].items():
            when = "" if worst["at"] is None else f"{worst['at']:.6g}"
            rows.append(_row([name, f"{kind} [{unit}]", f"{worst['largest']:.3g}", when]))
    heads = ["constraint", "error of", "largest", "at [s]"]
    return _table("Constraints, recomputed from the poses", heads, rows)


def _figures(found: Analysis, graph: Any) -> list[str]:
    plots = list(found.figures.items())
    for name, body in found.bodies.items():
        if body.known and body.wrench.rates.count:
            plots.append((f"{name}: total wrench by inverse dynamics", body.wrench))
            if body.recorded.rates.count:
                plots.append((f"{name}: total wrench recorded", body.recorded))
            plots.append((f"{name}: kinetic energy and momenta from poses", body.state))
    texts = []
    for k, (name, figures) in enumerate(plots):
        t, values = figures.curves()
        texts.append(_html(_lines(graph, name, figures, t, values, "t [s]"), k == 0))
        spectrum = figures.spectrum()
        if spectrum is not None and name in found.figures:
            frequency, density = spectrum
            figure = _lines(graph, f"{name}: spectrum", figures, frequency[1:],
                            np.maximum(density[1:], 1e-30), "f [Hz]")  # fmt: skip
            figure.update_xaxes(type="log")
            figure.update_yaxes(type="log")
            texts.append(_html(figure, False))
    return texts


def _lines(graph: Any, name: str, figures: Figures, x: np.ndarray, values: np.ndarray, axis: str):
    figure = graph.Figure()
    for k, column in enumerate(figures.names):
        unit = UNITS.get(column, "")
        label = f"{column} [{unit}]" if unit else column
        figure.add_scatter(x=x.tolist(), y=values[:, k].tolist(), name=label, mode="lines")
    figure.update_layout(title=name, xaxis_title=axis, height=330, template="plotly_white",
                         margin={"l": 60, "r": 20, "t": 45, "b": 45})  # fmt: skip
    figure.update_yaxes(exponentformat="power")
    if name == RESIDUAL:
        decades = math.log10(max(float(values.max(initial=0.0)), RESOLVED))
        figure.update_traces(y=np.maximum(values[:, 0], LEAST).tolist())
        figure.update_yaxes(type="log", range=[math.log10(LEAST), decades + 1.0])
        return figure
    spread = float(np.ptp(values)) if len(values) else 0.0
    size = float(np.abs(values).max()) if len(values) else 0.0
    if 0.0 < size and spread < 1e-9 * size:  # round-off is no motion: drawn as constant
        middle = float(values.mean())
        figure.update_yaxes(range=[middle - 0.1 * size, middle + 0.1 * size])
    return figure


def _html(figure: Any, first: bool) -> str:
    return figure.to_html(full_html=False, include_plotlyjs=first)
