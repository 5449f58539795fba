# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The ladder, its table, its JSON and its picture, on the pendulum with its closed form."""

from __future__ import annotations

import functools
import io
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.colors import to_hex
from rich.console import Console

from rb_sim.accuracy.accuracy_tables import (
    as_dict,
    decades,
    diagrams,
    drawable,
    front,
    print_report,
    save_picture,
    target_line,
)
from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.ladder import OUT_OF_TIME, Accuracy, Ladder, Rung, climb
from rb_sim.accuracy.runs import Errors, Runner
from rb_sim.base.errors import RbSimError
from rb_sim.base.plain_data import json_text
from rb_sim.cli.verbs.accuracy import accuracy as accuracy_verb
from rb_sim.mechanics.methods import METHODS
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene

PENDULUM = Path(__file__).resolve().parents[2] / "config" / "pendulum.yaml"


@pytest.fixture(scope="module")
def climbed() -> Accuracy:
    """Of each rung one run is timed, not as many as make a good figure."""
    once = functools.partialmethod(Runner.measured_cost, budget=0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Runner, "measured_cost", once)
        return climb(load_scene(PENDULUM), budget=90.0)  # ends itself; long for a busy machine


def test_every_method_in_every_form_has_a_ladder(climbed: Accuracy) -> None:
    system = compile_scene(load_scene(PENDULUM)).system
    suited = [entry for entry in METHODS.values() if entry.suits(system)]
    forms = sum((entry.fixed is not None) + (entry.adaptive is not None) for entry in suited)
    assert {"dopri853", "taylor"} <= {name for name, e in METHODS.items() if e in suited}
    assert len(climbed.ladders) == forms
    assert all(ladder.rungs and ladder.end for ladder in climbed.ladders)


def test_every_rung_is_finer_than_the_one_before(climbed: Accuracy) -> None:
    for ladder in climbed.ladders:
        knobs = [rung.setting.knob for rung in ladder.rungs if rung.setting.step is not None]
        assert all(fine < coarse for coarse, fine in zip(knobs, knobs[1:], strict=False))


def test_reference_is_the_closed_form_and_its_check_is_stated(climbed: Accuracy) -> None:
    true = climbed.reference
    assert "closed form" in true.kind
    assert any(name in true.check for name in METHODS)
    assert true.agreement.pose < 1e-10
    assert 0.0 < true.floor < 1e-11
    assert 1e-13 < true.ulp_growth.pose < 1e-10  # 3 rad from hanging: errors grow by about 1e4
    assert "cannot be measured (round-off)" in true.words


def test_json_is_monotone_above_the_floor(climbed: Accuracy) -> None:
    data = json.loads(json_text(as_dict(climbed)))
    for quantity in ("pose", "reaction", "energy"):
        # above the rounding of a run: one ulp at the start grows to this much
        grown = getattr(climbed.reference.ulp_growth, quantity)
        floor = 30.0 * max(data["reference"]["floor"][quantity], grown)
        for ladder in data["ladders"]:
            errors = [rung[quantity] for rung in ladder["rungs"] if rung[quantity] is not None]
            # below 1e-3 the error law holds; a tolerance steers it less evenly than a step does
            slack = 3.0 if "adaptive" in ladder["name"] else 1.0
            above = [error for error in errors if floor < error < 1e-3]
            for coarse, fine in zip(above, above[1:], strict=False):
                assert fine < slack * coarse, (ladder["name"], quantity)


def test_decades_end_at_the_floor_and_name_the_cheapest(climbed: Accuracy) -> None:
    table = decades(climbed)
    assert [decade.error for decade in table[:3]] == [0.1, 0.01, 1e-3]
    assert table[-1].best is None and table[-1].error < climbed.reference.floor
    for decade in table[:-1]:
        assert decade.best is not None
        assert decade.best.errors.pose <= decade.error
        assert min(decade.factors.values()) == 1.0


def test_front_keeps_what_nothing_beats() -> None:
    points = [(1.0, 1.0), (0.1, 2.0), (0.5, 3.0), (math.inf, 0.1), (0.01, 2.0), (0.001, 9.0)]
    assert [points[i] for i in front(points)] == [(1.0, 1.0), (0.01, 2.0), (0.001, 9.0)]


def test_table_says_what_each_decade_costs_and_what_ends_the_ladder(climbed: Accuracy) -> None:
    text = io.StringIO()
    print_report(climbed, Console(file=text, width=140), target=1e-6)
    shown = " ".join(text.getvalue().split())
    assert "1e-06" in shown and "radau5" in shown and "taylor tol" in shown and "×" in shown
    assert "cannot be measured (round-off)" in shown
    assert "method: auto, tolerance: 1e-06" in shown
    assert "below the smallest error measurable" in target_line(climbed, 1e-16)
    assert as_dict(climbed, 1e-6)["target"] == 1e-6


def test_table_fits_80_columns_whatever_the_methods_are_called(climbed: Accuracy) -> None:
    *others, last = climbed.ladders
    stepped = [  # also the cheapest, with a long name and a long step
        replace(rung, setting=Setting("time_stepping", step=0.00156), cost=1e-3 * rung.cost)
        for rung in last.rungs
    ]
    ladders = (*others, replace(last, name="time_stepping", rungs=tuple(stepped)))
    assert len(ladders) >= 6
    shown = []
    for width in (80, 160):
        text = io.StringIO()
        print_report(replace(climbed, ladders=ladders), Console(file=text, width=width))
        table = text.getvalue().split("s: fixed")[0]
        shown.append([line.rstrip() for line in table.splitlines()])
    assert shown[0] == shown[1]
    assert "…" not in "".join(shown[0])


def test_a_method_that_reaches_no_decade_has_a_line_and_no_column(climbed: Accuracy) -> None:
    cut = replace(climbed.ladders[0], name="nothing", rungs=(), end=OUT_OF_TIME)
    text = io.StringIO()
    print_report(replace(climbed, ladders=(cut, *climbed.ladders[1:])), Console(file=text))
    assert text.getvalue().count("nothing") == 1
    assert f"nothing did not run: {OUT_OF_TIME}" in text.getvalue()


def test_picture_is_written(climbed: Accuracy, tmp_path: Path) -> None:
    path = tmp_path / "accuracy.png"
    save_picture(climbed, path, target=1e-6)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 30_000


def test_verb_writes_both_files_and_refuses_a_bad_budget(tmp_path: Path) -> None:
    for budget in (1e-3, 0.3):  # also where no method gets its turn
        out = tmp_path / f"out_{budget}"
        assert accuracy_verb(PENDULUM, out, target=1e-3, budget=budget) == 0
        assert {path.name for path in out.iterdir()} == {"accuracy.json", "accuracy.png"}
    with pytest.raises(RbSimError, match="budget: got -1"):
        accuracy_verb(PENDULUM, budget=-1.0)


def colours(accuracy: Accuracy) -> dict[str, set[str]]:
    """By method, the colours of its curves in the picture."""
    found: dict[str, set[str]] = {}
    for axis in diagrams(accuracy).axes:
        for line in axis.get_lines():
            label = str(line.get_label())
            if not label.startswith("_"):
                found.setdefault(label.split()[0], set()).add(to_hex(line.get_color()))
    return found


def test_a_method_has_one_colour_in_the_pictures_of_two_scenes(climbed: Accuracy) -> None:
    """Whichever other methods integrate them."""
    one = colours(climbed)
    other = colours(replace(climbed, ladders=climbed.ladders[2:]))
    shared = one.keys() & other.keys()
    assert len(shared) >= 3 and one.keys() != other.keys()
    for name in shared:
        assert len(one[name]) == 1 and one[name] == other[name], name
    assert len(set.union(*one.values())) == len(one)


def test_a_curve_begins_where_a_run_shows_something_and_ends_on_the_floor() -> None:
    setting = Setting("rk4", step=0.1)
    errors = (3.14, 3.14, 3.1, 0.5, 1e-6, 1e-15, 0.0, 1e-16)
    rungs = tuple(
        Rung(setting, 10, Errors(error, error, error), float(cost))
        for cost, error in enumerate(errors, start=1)
    )
    found = drawable(Ladder("rk4", rungs, ""), "pose", 1e-13)
    assert found == [(3.1, 3.0), (0.5, 4.0), (1e-6, 5.0), (1e-13, 6.0)]
    assert drawable(Ladder("euler", rungs[:3], ""), "pose", 1e-13) == []
