# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The quick shipped cases hold; what a user writes wrongly is told in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure
from typer.testing import CliRunner

from rb_sim.base import palette
from rb_sim.base.errors import RbSimError
from rb_sim.cli.main import app
from rb_sim.cli.verbs.hard_cases import hard_cases, shipped
from rb_sim.mechanics.samples import SampleLayout, empty_block
from rb_sim.sweeps import hard_cases as report
from rb_sim.sweeps.hard_cases import Case, Row, largest, load_case, load_cases, rows_of

CASES = {case.name: case for case in load_cases(shipped())}
OSCILLATOR = """
title: an oscillator
why: a test has it
scene:
  bodies:
    bob: {mass: 1.0, inertia: [1.0, 1.0, 1.0], position: [1.0, 0.0, 0.0]}
  effects: {spring: {type: spring, body: bob, stiffness: 100.0}}
  simulation: {duration: 1.0, rate: 10.0}
runs:
  - {method: rk4, step: 0.05}
checks:
  - {figure: formula, formula: bob_x - cos(10*t), bound: %s}
"""


def measured(name: str) -> list[Row]:
    return list(rows_of(CASES[name]))


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.quick])
def test_a_quick_case_holds(name: str) -> None:
    for row in measured(name):
        assert row.verdict == "holds", row


def test_every_bound_of_a_figure_is_explained() -> None:
    for case in CASES.values():
        for check in case.checks:
            assert check.because or check.figure in ("warned", "refused"), case.name


def run_folder(folder: str, out: str) -> int:
    return hard_cases(Path(folder), (), Path(out), False)


def written(tmp_path: Path, bound: float) -> tuple[int, Any, str]:
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "own.yaml").write_text(OSCILLATOR % bound)
    code = run_folder(str(tmp_path / "cases"), str(tmp_path / "out"))
    rows = json.loads((tmp_path / "out" / "hard-cases.json").read_text())
    return code, rows, (tmp_path / "out" / "hard-cases.md").read_text()


def test_a_folder_of_ones_own_is_run_and_written(tmp_path: Path) -> None:
    code, (row,), page = written(tmp_path, 1e-1)
    assert code == 0 and row["verdict"] == "holds"
    assert 1e-5 < row["figure"] < 1e-1 and row["margin"] == row["bound"] / row["figure"]
    assert "| own | rk4 | 0.05 s | formula |" in page
    assert (tmp_path / "out" / "hard-cases.png").stat().st_size > 1000


def test_a_case_that_does_not_hold_fails_the_command(tmp_path: Path) -> None:
    code, (row,), _ = written(tmp_path, 1e-9)
    assert code == 1 and row["verdict"] == "FAILS"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("title: [", "line"),
        ("- 1", "must be a mapping"),
        (OSCILLATOR % 0.0, "bound"),
        (OSCILLATOR.replace("rk4", "magic") % 1.0, "method"),
        (
            OSCILLATOR.replace("formula: bob_x - cos(10*t), ", "") % 1.0,
            "must be given for figure formula",
        ),
    ],
)
def test_a_file_that_is_no_case_is_reported_in_one_line(
    text: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(RbSimError) as caught:
        load_case(path)
    assert str(path) in str(caught.value) and said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_name_that_no_case_has_is_answered_with_the_nearest() -> None:
    result = CliRunner().invoke(app, ["hard-cases", "--only", "seperatrix"])
    assert result.exit_code == 2
    assert "must be separatrix, or one of" in result.output and len(result.output) < 600


def test_the_picture_groups_by_theme_and_marks_a_narrow_margin(tmp_path: Path, monkeypatch) -> None:
    """The least margin of a case decides its place and its colour; words are no margin."""

    def case(name: str, theme: str) -> Case:
        text = yaml.safe_load(OSCILLATOR % 1.0)
        return Case.model_validate({**text, "name": name, "theme": theme})

    def row(name: str, check: str, figure: float) -> Row:
        return Row(name, "rk4", "0.1 s", check, figure, 1.0, 0.1, "holds", "")

    cases = [case("wide", "tops"), case("close", "tops"), case("warns", "tops"), case("b", "heaps")]
    rows = [row("wide", "energy", 1e-6), row("close", "energy", 1e-3), row("close", "formula", 0.2),
            row("warns", "warned", 0.0), row("b", "energy", 1e-2)]  # fmt: skip
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: figures.append(self))
    report.picture(cases, rows, tmp_path / "x.png")
    tops, heaps = figures[0].axes
    assert [label.get_text() for label in tops.get_yticklabels()] == ["close", "wide", "warns"]
    assert [label.get_text() for label in heaps.get_yticklabels()] == ["b"]
    texts = [text.get_text() for text in tops.texts]
    assert texts == ["tops", "5.0×", "warned, as it must be"]
    large = [line for line in tops.get_lines() if line.get_markersize() == report.MARKER]
    dots = {line.get_ydata()[0]: line.get_color() for line in large if line.get_marker() == "o"}
    assert dots == {1: palette.NARROW, 2: palette.GOOD}


def test_every_shipped_case_has_a_theme() -> None:
    assert all(case.theme != "other" for case in CASES.values())
    assert len({case.theme for case in CASES.values()}) < 8


# Formulas of cases: arithmetic on the samples, and nothing else of Python.


LAYOUT = SampleLayout(("bob",), ("pin",), ("bob",), ())


@pytest.fixture
def block():
    base = empty_block(3, LAYOUT)
    force = np.zeros((3, 1, 3))
    force[:, 0, 1] = [1.0, -4.0, 2.0]
    return replace(base, t=np.array([0.0, 1.0, 2.0]), reaction_force=force)


@pytest.mark.parametrize(
    ("formula", "value"),
    [
        ("t", 2.0),
        ("-t**2 + 1", 3.0),
        ("pin_fy", 4.0),
        ("hypot(pin_fx, pin_fy)", 4.0),
        ("max(abs(bob_x - 3), t)", 3.0),
        ("cos(pi*t) - 1", 2.0),
        ("where(t > 1.5, 10, 0)", 10.0),
        ("1/bob_x", np.inf),
        ("log(-t)", np.inf),
    ],
)
def test_the_largest_size_over_the_samples(formula: str, value: float, block) -> None:
    assert largest(formula, block, LAYOUT) == pytest.approx(value)


@pytest.mark.parametrize(
    "formula",
    ["bill_x", "t +", "__import__('os')", "t.real", "(lambda: 1)()", "'t'", "[t]", "eval(t)"],
)
def test_anything_else_is_refused(formula: str, block) -> None:
    with pytest.raises(RbSimError, match="formula"):
        largest(formula, block, LAYOUT)
