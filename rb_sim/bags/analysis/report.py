"""One HTML file that needs nothing else: facts, notes, interactive plots, a picture of the bag."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.bags.analysis.figures import (
    RESIDUAL,
    ROUNDING,
    Figures,
    sizes_beside,
    sizes_of,
    unit_of,
)
from rb_sim.bags.analysis.result import Analysis
from rb_sim.base.errors import MissingExtraError, SinkError

STYLE = """body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;
color:#222}h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse}
td,th{padding:.15em .8em .15em 0;text-align:right;font-variant-numeric:tabular-nums}
table{display:block;overflow-x:auto}td:not(:first-child){white-space:nowrap}
td:first-child,th:first-child{text-align:left}th{border-bottom:1px solid #bbb}
.note{color:#9a4a00}img{max-width:100%}
.two{display:grid;grid-template-columns:1fr 1fr}.two div{min-width:0}
@media(max-width:45em){.two{grid-template-columns:1fr}}"""


LEAST, RESOLVED = 1e-17, 1e-9
"""Of residuals: where their axis begins, and up to where it goes at least: rounding lies below."""

MOST = 100
"""Sources and bodies that are drawn at most: a browser opens no page of thousands of plots."""


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
    title = "Inverse dynamics against recorded wrenches: RMS difference"
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
                numbers.append(f"{row['noise']:.3g}" if "noise" in row else "")
                rows.append(_row([f"{name} {what}".strip(), *numbers]))
    heads = ["balance", "left", "of", "sampling error", "noise up to"]
    return _table("Balance errors", heads, rows) if rows else ""


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
    plots = list(found.figures.items())[:MOST]
    for name, body in list(found.bodies.items())[:MOST]:
        if body.known and body.wrench.rates.count:
            plots.append((f"{name}: total wrench by inverse dynamics", body.wrench))
            if body.recorded.rates.count:
                plots.append((f"{name}: total wrench recorded", body.recorded))
            plots.append((f"{name}: kinetic energy and momenta from poses", body.state))
    sizes = sizes_of(plots, found.length)
    texts = [f"<h2>Plots</h2>{_left_out(found)}"]
    for name, figures in plots:
        rows = [_by_unit(graph, name, figures, sizes)]
        if name in found.figures and name != RESIDUAL:
            rows.append(_spectra(graph, name, figures, sizes))
        for row in filter(None, rows):
            parts = [_html(figure, len(texts) == 1 and not k) for k, figure in enumerate(row)]
            inner = "".join(f"<div>{part}</div>" for part in parts)
            texts.append(f'<div class="{"two" if len(row) > 1 else "one"}">{inner}</div>')
    return texts


def _left_out(found: Analysis) -> str:
    """A line where not all sources are drawn; or ""."""
    count = len(found.figures)
    if count <= MOST:
        return ""
    return f"<p>Of {MOST} of {count} sources; <code>--topic NAME</code> chooses others.</p>"


def _groups(name: str, figures: Figures) -> dict[str, list[int]]:
    """The columns of each unit: what is 150 rad/s would hide what is 1 m/s."""
    groups: dict[str, list[int]] = {}
    for k, column in enumerate(figures.names):
        groups.setdefault(unit_of(name, column), []).append(k)
    return groups


def _by_unit(graph: Any, name: str, figures: Figures, sizes: dict[str, float]) -> list[Any]:
    """Curves over time, a figure for each unit."""
    t, values = figures.curves()
    made = []
    for unit, which in _groups(name, figures).items():
        names = [figures.names[k] for k in which]
        figure = _lines(graph, name, names, t, values[:, which])
        axis = f"[{unit}]" if unit else None
        figure.update_layout(xaxis_title="t [s]", yaxis_title=axis)
        if name == RESIDUAL:
            _residual_axis(figure, values)
        else:
            _level_axis(figure, values[:, which], sizes_beside(name, figures, sizes)[which].max())
        made.append(figure)
    return made


def _spectra(graph: Any, name: str, figures: Figures, sizes: dict[str, float]) -> list[Any]:
    """Power densities over frequency, a figure for each unit; none of what is rounding, and no
    axis that goes below the density of noise as large as that."""
    found, rate = figures.spectrum(), figures.rates.as_dict()["rate"]
    if found is None or rate is None:
        return []
    made = []
    for unit, which in _groups(name, figures).items():
        rounding = ROUNDING * sizes_beside(name, figures, sizes)[which].max()
        moving = [k for k in which if figures.spread[k] > rounding]
        if not moving:
            continue
        frequency, density = (
            found[0][1:],
            np.maximum(found[1][1:, moving], 2.0 * rounding**2 / rate),
        )
        names = [figures.names[k] for k in moving]
        figure = _lines(graph, f"{name}: spectrum", names, frequency, density)
        axis = f"[({unit})^2/Hz]" if unit else "[1/Hz]"
        figure.update_layout(xaxis_title="f [Hz]", yaxis_title=axis)
        figure.update_xaxes(type="log")
        figure.update_yaxes(type="log")
        made.append(figure)
    return made


def _lines(graph: Any, title: str, names: Sequence[str], x: np.ndarray, values: np.ndarray) -> Any:
    """A curve for each column of values."""
    figure = graph.Figure()
    for name, column in zip(names, values.T, strict=True):
        figure.add_scatter(x=x.tolist(), y=column.tolist(), name=name, mode="lines")
    figure.update_layout(title=title, title_font_size=14, height=330, template="plotly_white",
                         showlegend=len(names) > 1,
                         margin={"l": 60, "r": 20, "t": 45, "b": 45})  # fmt: skip
    figure.update_yaxes(exponentformat="power")
    return figure


def _residual_axis(figure: Any, values: np.ndarray) -> None:
    """A logarithmic axis that does not end below RESOLVED."""
    decades = math.log10(max(float(values.max(initial=0.0)), RESOLVED))
    figure.update_traces(y=np.maximum(values[:, 0], LEAST).tolist())
    figure.update_yaxes(type="log", range=[math.log10(LEAST), decades + 1.0])


def _level_axis(figure: Any, values: np.ndarray, size: float) -> None:
    """Round-off is no motion: what changes by less than makes a difference is drawn as constant."""
    spread = float(np.ptp(values)) if len(values) else 0.0
    if 0.0 < size and spread < ROUNDING * size:
        middle = float(values.mean()) if len(values) else 0.0
        figure.update_yaxes(range=[middle - 0.1 * size, middle + 0.1 * size])


def _html(figure: Any, first: bool) -> str:
    config = {"responsive": True, "displaylogo": False}
    return figure.to_html(full_html=False, include_plotlyjs=first, config=config)
