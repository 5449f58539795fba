"""The report's plots: axes that show motion, not rounding, and no more plots than can be opened."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rb_sim.bags.analysis import report
from rb_sim.bags.analysis.figures import COLUMNS, Figures, sizes_of
from rb_sim.bags.analysis.result import Analysis

graph = pytest.importorskip("plotly.graph_objects")
RATE, COUNT = 50.0, 400
T = np.arange(COUNT) / RATE


def figures_of(kind: str, **columns: np.ndarray) -> Figures:
    """Of one source; columns that are not given stand still at 0."""
    names = COLUMNS[kind]
    zero = np.zeros(COUNT)
    figures = Figures(names)
    figures.add(T, np.column_stack([columns.get(name, zero) for name in names]))
    return figures


def spectra(figures: Figures, **others: Figures):
    plots = [("x", figures), *others.items()]
    sizes = sizes_of(plots, 0.0)
    return report._spectra(graph, "x", figures, sizes)


def test_what_stands_still_has_no_curve_in_a_spectrum() -> None:
    """A number that is constant to rounding would draw the axis down by thirty decades."""
    still = 0.3 + 1e-16 * np.cos(40.0 * T)
    (figure,) = spectra(figures_of("twist", vx=np.sin(30.0 * T), vy=still))
    assert [curve.name for curve in figure.data] == ["vx"]


def test_a_spectrum_ends_where_rounding_begins() -> None:
    """Beside what is a million times faster 1e-3 m/s is rounding: the axis ends at the density of
    noise of that size, which lies above what a tone leaves elsewhere."""
    tone = np.cos(2.0 * np.pi * 10.0 * T)
    (figure,) = spectra(figures_of("twist", vx=tone), fast=figures_of("twist", vx=1e6 * tone))
    assert min(figure.data[0].y) == pytest.approx(2.0 * 1e-3**2 / RATE, rel=1e-3, abs=0.0)
    assert max(figure.data[0].y) > 1e-2


def test_numbers_without_a_unit_are_not_compared_with_other_topics() -> None:
    """A counter up to 1e7 says nothing of how far a quaternion of another topic turns."""
    turns = figures_of("pose", qx=1e-3 * np.sin(30.0 * T), qw=np.ones(COUNT))
    count = figures_of("scalar", value=1e7 * T)
    sizes = sizes_of([("x", turns), ("/count", count)], 0.0)
    _, attitude = report._by_unit(graph, "x", turns, sizes)
    assert attitude.layout.yaxis.range is None
    assert len(spectra(turns, **{"/count": count})) == 1


def test_thousands_of_sources_are_not_all_drawn(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(report, "MOST", 3)
    found = Analysis("bag")
    for k in range(5):
        found.figures[f"/f{k}"] = figures_of("scalar", value=np.sin(30.0 * T))
        found.kinds[f"/f{k}"] = "scalar"
    report.write_report(found, tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    assert "Of 3 of 5 sources; <code>--topic NAME</code> chooses others." in text
    drawn = set(re.findall(r'"text":"(/f\d)"', text.replace("\\u002f", "/")))
    assert drawn == {"/f0", "/f1", "/f2"}
    assert all(f"<td>/f{k}</td>" in text for k in range(5))
