# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The report's plots: axes that show motion, not rounding, and no more plots than can be opened."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rb_sim.bags.analysis import analysis_page
from rb_sim.bags.analysis.analysis_page import Analysis, _Page
from rb_sim.bags.analysis.figures import COLUMNS, Figures, unit_of
from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.base.palette import BAD
from tests.bags.scenes import PUSHED, record_run
from tests.browser import ask
from tests.io.test_page import numbers

RATE, COUNT = 50.0, 400
T = np.arange(COUNT) / RATE


def figures_of(kind: str, **columns: np.ndarray) -> Figures:
    """Of one source; columns that are not given stand still at 0."""
    names = COLUMNS[kind]
    zero = np.zeros(COUNT)
    figures = Figures(names)
    figures.add(T, np.column_stack([columns.get(name, zero) for name in names]))
    return figures


def plots_of(length: float = 0.0, **sources: Figures) -> list[dict]:
    """The plots of the page of these sources."""
    kinds = dict.fromkeys(sources, "scalar")
    return _Page(Analysis("bag", figures=sources, kinds=kinds, length=length)).data()["plots"]


def spectra(figures: Figures, **others: Figures) -> list[dict]:
    plots = plots_of(x=figures, **others)
    return [plot for plot in plots if plot["section"] == "spectra" and plot["title"] == "x"]


def test_what_stands_still_has_no_curve_in_a_spectrum() -> None:
    """A number that is constant to rounding would draw the axis down by thirty decades."""
    still = 0.3 + 1e-16 * np.cos(40.0 * T)
    (plot,) = spectra(figures_of("twist", vx=np.sin(30.0 * T), vy=still))
    assert [line["name"] for line in plot["lines"]] == ["vx"]


def test_a_spectrum_ends_where_rounding_begins() -> None:
    """Beside what is a million times faster 1e-3 m/s is rounding: the axis ends at the density of
    noise of that size, which lies above what a tone leaves elsewhere."""
    tone = np.cos(2.0 * np.pi * 10.0 * T)
    (plot,) = spectra(figures_of("twist", vx=tone), fast=figures_of("twist", vx=1e6 * tone))
    density = 10.0 ** numbers(plot["lines"][0]["y"]).astype(float)
    assert density.min() == pytest.approx(2.0 * 1e-3**2 / RATE, rel=1e-3, abs=0.0)
    assert density.max() > 1e-2


def test_a_peak_stays_where_frequencies_are_joined() -> None:
    """A tone between many frequencies has the height that all of them have."""
    t = np.arange(8192) / 1000.0
    figures = Figures(("value",))
    figures.add(t, (np.sin(2.0 * np.pi * 377.0 * t))[:, None])
    (plot,) = spectra(figures)
    found = figures.spectrum()
    assert found is not None
    shown = numbers(plot["lines"][0]["y"])
    assert len(shown) < len(found[0]) and shown.max() == pytest.approx(np.log10(found[1].max()))


def test_numbers_without_a_unit_are_not_compared_with_other_topics() -> None:
    """A counter up to 1e7 says nothing of how far a quaternion of another topic turns."""
    turns = figures_of("pose", qx=1e-3 * np.sin(30.0 * T), qw=np.ones(COUNT))
    count = figures_of("scalar", value=1e7 * T)
    plots = plots_of(x=turns, count=count)
    assert any(plot["section"] == "time" and plot["title"] == "x" for plot in plots)
    assert len(spectra(turns, count=count)) == 1


@pytest.mark.parametrize("worst", [0.0, 1e-15, 1e-3])
def test_rounding_of_residuals_is_not_enlarged(worst: float) -> None:
    """Their axis goes from 1e-17 to 1e-8 at least, and to what is more."""
    (plot,) = plots_of(residual=figures_of("scalar", value=np.where(T == T[3], worst, 0.0)))
    assert plot["logarithmic"] == "y" and plot["bounds"] == [-17.0, -8.0]
    curve = numbers(plot["lines"][0]["y"])
    assert curve.min() == -17.0 and curve.max() == pytest.approx(np.log10(max(worst, 1e-17)))


def test_rounding_beside_the_scene_is_no_motion() -> None:
    """A tip that stands still to 1e-13 m/s, on a body that reaches 1 m; at 1e-3 m/s it moves."""
    for speed, units in ((1e-13, ["rad/s"]), (1e-3, ["m/s", "rad/s"])):
        moves = figures_of("twist", vx=speed * np.sin(30.0 * T), wz=3.0 * np.cos(30.0 * T))
        plots = plots_of(1.0, x=moves)
        assert [plot["unit"] for plot in plots if plot["section"] == "time"] == units
        densities = [plot["unit"] for plot in plots if plot["section"] == "spectra"]
        assert densities == [f"({unit})²/Hz" for unit in units]


def test_a_power_of_rounding_is_not_drawn() -> None:
    """Beside 1 N at 1 m/s."""
    wave = np.sin(np.arange(COUNT))
    moving = {"f": figures_of("wrench", fx=wave), "v": figures_of("twist", vx=wave)}
    for size, drawn in ((1e-14, False), (1e-3, True)):
        power = Figures(["value"])
        power.add(T, size * wave[:, None])
        kinds = {"f": "wrench", "v": "twist", "power": "scalar"}
        found = Analysis("bag", figures=moving | {"power": power}, kinds=kinds)
        titles = [plot["title"] for plot in _Page(found).data()["plots"]]
        assert ("power" in titles) == drawn


def test_a_plot_for_each_unit_in_its_section() -> None:
    """150 rad/s beside 1 m/s; energies are first, their densities in J² per Hz."""
    waves = {name: np.sin((k + 1) * T) for k, name in enumerate(COLUMNS["twist"])}
    twist, energy = figures_of("twist", **waves), figures_of("scalar", value=np.sin(9.0 * T))
    shown = [
        (plot["section"], plot["title"], plot["unit"], [line["name"] for line in plot["lines"]])
        for plot in plots_of(top=twist, energy=energy)
    ]
    assert ("time", "top", "m/s", ["vx", "vy", "vz"]) in shown
    assert ("time", "top", "rad/s", ["wx", "wy", "wz"]) in shown
    assert ("energy", "energy", "J", [""]) in shown
    assert ("spectra", "energy", "J²/Hz", [""]) in shown
    assert unit_of("/somebody/energy", "value") == ""


def test_balances_have_units_and_each_quantity_its_name(tmp_path) -> None:
    found = analyze(record_run(PUSHED, tmp_path))
    titles = {plot["unit"]: plot["title"] for plot in _Page(found).data()["plots"]
              if "from poses" in plot["title"]}  # fmt: skip
    assert titles["J"].endswith(": kinetic energy from poses")
    assert titles["N s"].endswith(": momentum from poses")
    lines = re.findall(r"[^>]* not accounted for", analysis_page._verdict(found))
    assert [re.search(r" ([A-Z][ A-Za-z]*) not", line)[1] for line in lines] == [
        "J",
        "N s",
        "N m s",
    ]


def test_the_page_is_light_and_its_time_axes_are_one(tmp_path) -> None:
    """Thirty poses at 20,000 instants in less than 2 MB; zooming one plot zooms all over time."""
    rng = np.random.default_rng(0)
    found = Analysis("bag")
    for k in range(30):
        figures = Figures(COLUMNS["pose"])
        figures.add(np.arange(20000) / 100.0, rng.normal(size=(20000, 7)).cumsum(axis=0))
        found.figures[f"/f{k}"], found.kinds[f"/f{k}"] = figures, "pose"
    page = tmp_path / "r.html"
    analysis_page.write_report(found, page)
    assert page.stat().st_size < 2e6
    spans = ask(page, """
        const { s, Hz } = rb_sim.shared;
        s.plots[0].zoom(3, 5);
        return [s.plots.map((p) => [p.from, p.to]), Hz.plots.map((p) => p.from), s.plots.length];
    """)  # fmt: skip
    assert spans[0] == [[3, 5]] * 60 and spans[2] == 60
    assert all(start < 0.0 for start in spans[1])  # decades of 100/2048 Hz: none was touched


def test_gaps_and_paths_are_drawn(tmp_path) -> None:
    """A circle of 2 m, recorded with a gap of 3 s."""
    t = np.concatenate([np.arange(100) / 50.0, 5.0 + np.arange(100) / 50.0])
    figures = Figures(COLUMNS["pose"])
    still = np.tile([0.0, 0.0, 0.0, 1.0], (200, 1))
    angle = 0.01 * np.pi * np.arange(200)
    figures.add(t, np.c_[np.cos(angle), np.sin(angle), 0.0 * t, still])
    found = Analysis("bag", figures={"/b": figures}, kinds={"/b": "pose"})
    analysis_page.write_report(found, tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    assert "/b: 1 gaps, the longest 3.02 s" in text and 'class="verdict bad"' in text
    assert text.count(f'height="13" fill="{BAD}"/>') == 1
    page = _Page(found).data()
    (x,) = (plot["lines"][0]["y"] for plot in page["plots"] if plot["unit"] == "m")
    broken = np.flatnonzero(np.isnan(numbers(x)))
    assert np.array(numbers(page["across"][0]))[broken] == pytest.approx([3.49], abs=0.01)
    drawn = re.search(r'path of /b.*?points="([^"]*)"', text)
    assert drawn is not None
    x, y = np.array([p.split(",") for p in drawn[1].split()], float).T
    radius = np.hypot(x - 0.5 * (x.min() + x.max()), y - 0.5 * (y.min() + y.max()))
    assert np.ptp(x) == pytest.approx(np.ptp(y), rel=0.03) and np.ptp(radius) < 0.2 * radius.mean()


def test_thousands_of_sources_are_not_all_drawn(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(analysis_page, "MOST", 3)
    found = Analysis("bag")
    for k in range(5):
        found.figures[f"/f{k}"] = figures_of("scalar", value=np.sin(30.0 * T))
        found.kinds[f"/f{k}"] = "scalar"
    analysis_page.write_report(found, tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    assert "Of 3 of 5 sources; <code>--topic NAME</code> chooses others." in text
    drawn = set(re.findall(r'"title":"(/f\d)"', text))
    assert drawn == {"/f0", "/f1", "/f2"}
    assert re.findall(r"<td>(/f\d)</td>", text) == ["/f0", "/f1", "/f2"]
