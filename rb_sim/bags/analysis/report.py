"""One HTML file that needs nothing else: a verdict, interactive plots, tables."""

from __future__ import annotations

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
from rb_sim.base.palette import AXES, CYCLE

STYLE = """body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;
color:#222}h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse}
td,th{padding:.15em .8em .15em 0;text-align:right;font-variant-numeric:tabular-nums}
table{display:block;overflow-x:auto}td:not(:first-child){white-space:nowrap}
td:first-child,th:first-child{text-align:left}th{border-bottom:1px solid #bbb}
.problems{color:#9a4a00}
.two{display:grid;grid-template-columns:1fr 1fr}.two div{min-width:0}
@media(max-width:45em){.two{grid-template-columns:1fr}}"""


LEAST, RESOLVED = 1e-17, 1e-9
"""Of residuals: where their axis begins, and up to where it goes at least: rounding lies below."""

MOST = 100
"""Sources and bodies that are drawn at most: a browser opens no page of thousands of plots."""


def write_report(found: Analysis, path: Path) -> None:
    """Write the report. Raises MissingExtraError without plotly, SinkError."""
    try:
        graph = import_module("plotly.graph_objects")
    except ImportError:
        raise MissingExtraError("plotly", "analysis", "report.html") from None
    parts = [_verdict(found)]
    parts += _figures(found, graph)
    parts += [_balances(found), _constraints(found), _bodies(found), _sources(found)]
    text = "\n".join(
        ["<!doctype html><html><head><meta charset='utf-8'>",
         f"<title>{html.escape(found.name)}</title><style>{STYLE}</style></head><body>",
         *parts, "</body></html>"]
    )  # fmt: skip
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SinkError(f"{path}: {error.strerror}") from None


BALANCED = 1e-3
"""Of what was exchanged: a balance that leaves no more is said to hold."""


def _verdict(found: Analysis) -> str:
    """What was recorded, what is wrong with it, and what balances."""
    count = sum(figures.rates.count for figures in found.figures.values())
    recorded = [*found.facts, f"{len(found.figures)} sources, {count} readings", found.name]
    gaps = [
        f"{name}: {rates['gaps']} gaps, the longest {rates['longest_gap']:.3g} s"
        for name, figures in found.figures.items()
        if (rates := figures.rates.as_dict())["gaps"]
    ]
    problems = [*found.notes, *gaps[:MOST]] or ["none found: no gaps, no notes"]
    balances = []
    for name, balance in ({"": found.balance} if found.balance else found.balances).items():
        momentum = balance["momentum"] or {}
        rows = {"energy": balance["energy"], "linear momentum": momentum.get("linear"),
                "angular momentum": momentum.get("angular")}  # fmt: skip
        for what, row in rows.items():
            if row is not None:
                doubt = max(row.get("quadrature") or 0.0, row.get("noise") or 0.0)
                holds = abs(row["error"]) <= max(BALANCED * row["scale"], doubt)
                balances.append(
                    f"{name} {what} {'balances' if holds else 'does NOT balance'}: "
                    f"{abs(row['error']):.2g} of {row['scale']:.3g} not accounted for".strip()
                )
    if not balances:
        balances = ["not judged: masses or forces are not known (--masses FILE)"]
    title = html.escape(found.title or Path(found.name).name)
    lists = (("Recorded", recorded), ("Problems", problems), ("Balances", balances))
    return f"<h1>{title}</h1>" + "".join(
        f'<p class="{head.lower()}"><b>{head}.</b> {"<br>".join(map(html.escape, lines))}</p>'
        for head, lines in lists
    )


LINKED = """<script>
const charts = [...document.querySelectorAll(".time .plotly-graph-div")];
let linking = false;
for (const chart of charts) chart.on("plotly_relayout", (event) => {
  if (linking) return;
  const low = event["xaxis.range[0]"], high = event["xaxis.range[1]"];
  const change = event["xaxis.autorange"] ? {"xaxis.autorange": true}
    : low === undefined ? null : {"xaxis.range": [low, high]};
  if (!change) return;
  linking = true;
  const others = charts.filter((other) => other !== chart);
  Promise.all(others.map((other) => Plotly.relayout(other, change)))
    .then(() => { linking = false; });
});
</script>"""
"""Zooms all time axes when one is zoomed."""


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
    # energy and reactions first; a stable order else
    first = sorted(found.figures.items(), key=lambda item: _order(item[0]))
    plots = first[:MOST]
    for name, body in list(found.bodies.items())[:MOST]:
        if body.known and body.wrench.rates.count:
            plots.append((f"{name}: total wrench by inverse dynamics", body.wrench))
            if body.recorded.rates.count:
                plots.append((f"{name}: total wrench recorded", body.recorded))
            plots.append((f"{name}: kinetic energy and momenta from poses", body.state))
    sizes = sizes_of(plots, found.length)
    texts = [f"<h2>Plots</h2>{_left_out(found)}"]
    constant: list[str] = []
    for name, figures in plots:
        made = _by_unit(graph, name, figures, sizes)
        # an axis has a range of its own where nothing moves on it
        still = [] if name == RESIDUAL else [f for f in made if f.layout.yaxis.range is not None]
        constant += [f"{name} {figure.layout.yaxis.title.text or ''}".strip() for figure in still]
        rows = [[figure for figure in made if figure not in still]]
        if name in found.figures and name != RESIDUAL:
            rows.append(_spectra(graph, name, figures, sizes))
        for kind, row in zip(("time", "spectrum"), rows, strict=False):
            if not row:
                continue
            parts = [_html(figure, len(texts) == 1 and not k) for k, figure in enumerate(row)]
            inner = "".join(f"<div>{part}</div>" for part in parts)
            texts.append(f'<div class="{kind} {"two" if len(row) > 1 else "one"}">{inner}</div>')
    if constant:
        texts.append(f"<p>Constant to rounding, not drawn: {html.escape(', '.join(constant))}</p>")
    return [*texts, LINKED]


def _order(name: str) -> int:
    """Energies before reactions, these before the rest."""
    return 0 if name == "energy" else 1 if name.startswith("reactions/") else 2


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
        axis = f"[({unit})²/Hz]" if unit else "[1/Hz]"
        figure.update_layout(xaxis_title="f [Hz]", yaxis_title=axis)
        figure.update_xaxes(type="log")
        figure.update_yaxes(type="log")
        made.append(figure)
    return made


def _lines(graph: Any, title: str, names: Sequence[str], x: np.ndarray, values: np.ndarray) -> Any:
    """A curve for each column of values."""
    figure = graph.Figure()
    for name, column in zip(names, values.T, strict=True):
        colour = AXES["xyzw".index(name[-1])] if name[-1] in "xyzw" else None
        figure.add_scatter(x=x, y=column, name=name, mode="lines", line_color=colour)
    figure.update_layout(title=title, title_font_size=14, height=330, template="plotly_white",
                         colorway=CYCLE,
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
