# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim explain`: what a scene calls for, and what each part costs."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from rb_sim.accuracy import costs
from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.costs import (
    EDGE,
    Cost,
    Events,
    Explanation,
    Item,
    RunCost,
    cost_of_events,
    explain,
    longest_stretch,
    steps_of_a_run,
    survey,
    typical_step,
)
from rb_sim.accuracy.runs import Runner
from rb_sim.catalogue.effects import SPECS
from rb_sim.cli.verbs.explain import counted, notes, print_explanation
from rb_sim.cli.verbs.explain import explain as explain_verb
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene, scene_from_mapping
from tests.contact.scenes import G, ball, scene, touch

CONFIG = Path(__file__).resolve().parents[2] / "config"


@pytest.mark.slow
def test_rolling_sphere_is_explained() -> None:
    result = explain(load_scene(CONFIG / "rolling_sphere.yaml"))
    assert result.bodies == (("ball", 2.0),)
    assert [(c.name, c.type, c.on, c.rows) for c in result.constraints] == [
        ("floor", "rolling", "ball", 3)
    ]
    assert [(e.name, e.type) for e in result.effects] == [("weight", "gravity"), ("push", "wrench")]
    assert (result.rows, result.degrees_of_freedom, result.indeterminate) == (3, 3, ())
    assert "RollingBody" in result.coordinates
    assert set(result.absent_effects) == set(SPECS) - {"gravity", "wrench"}
    # rolling costs its rotations and a solve; that is above any noise
    (floor,) = result.constraints
    assert floor.cost is not None and 0.0 < floor.cost.nanoseconds < result.step.nanoseconds


@pytest.mark.slow
def test_verb_writes_json(tmp_path: Path) -> None:
    assert explain_verb(CONFIG / "pendulum.yaml", tmp_path) == 0
    data = json.loads((tmp_path / "explain.json").read_text(encoding="utf-8"))
    assert data["indeterminate"] == []
    assert data["constraints"][0]["rows"] == 5
    assert "gravity" not in data["absent_effects"] and "spring" in data["absent_effects"]
    assert 0.0 < data["run"]["unchecked"] < data["run"]["checked"]


def test_of_a_run_that_does_not_end_in_time_no_price_is_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def asked(_: object) -> RunCost:
        return RunCost(1.0, 2.5)

    scene = load_scene(CONFIG / "pendulum.yaml")
    reported = explain(scene, run_cost=asked)
    assert any(
        "A run takes 1 s, or 2.5 s with its accuracy checks" in line for line in notes(reported)
    )
    monkeypatch.setattr(costs, "LONGEST_RUN", 0.0)
    assert explain(scene, run_cost=asked).run is None


def test_steps_in_contact_are_measured_between_events_and_events_apart() -> None:
    """A ball dropped from 0.2 m that keeps 0.8 of its speed flies for longest after the first."""
    fall = math.sqrt(2.0 * 0.2 / G)
    flight = 2.0 * 0.8 * fall
    stretch, span, events = measured(scene(ball([0.0, 0.0, 0.3]), touch(restitution=0.8)), 0.7)
    since = EDGE * flight
    assert stretch.start == pytest.approx(fall + since, abs=1e-9)
    assert stretch.length == pytest.approx((1.0 - 2.0 * EDGE) * flight, abs=1e-9)
    assert stretch.y[2] == pytest.approx(0.1 + 0.8 * G * fall * since - 0.5 * G * since**2)
    assert span <= stretch.length * (1.0 + 1e-12)
    assert events.count == 2 and events.nanoseconds > 0.0


@cache
def of_a_fall() -> Any:
    """The explanation of a box that falls and comes to lie."""
    falls = scene(ball([0.0, 0.0, 0.3]), touch(restitution=0.8))
    return explain(scene_from_mapping(falls, duration=0.7))


@pytest.mark.parametrize("nanoseconds", [0.0, 2e6])
def test_events_for_which_nothing_is_left_have_no_price(nanoseconds: float) -> None:
    """Of a box that falls and comes to lie, steps at its rest are measured, which are the dearest:
    all of the run's at that price are more than it took, which was told as 0 ms for an event."""
    said = notes(replace(of_a_fall(), events=Events(76, nanoseconds)))
    (line,) = (line for line in said if line.startswith("Cost of 76 events"))
    assert ("not measurable" in line) == (nanoseconds == 0.0)
    assert ("2 ms each" in line) == (nanoseconds > 0.0)


def measured(mapping: dict[str, Any], duration: float) -> Any:
    """(stretch, span of a measurement [s], events) of the explanation of a scene."""
    compiled, setting = compile_scene(scene_from_mapping(mapping)), Setting("rk4", step=0.01)
    seen = survey(compiled, setting, duration)
    stretch = longest_stretch(compiled, setting, duration, seen)
    step = typical_step(setting, seen, stretch)
    return (
        stretch,
        step * steps_of_a_run(seen),
        cost_of_events(compiled, setting, duration, 1.0, seen),
    )


def swing() -> Any:
    return load_scene(CONFIG / "pendulum.yaml", duration=10.0, method="rk4", step=1e-4)


def test_a_run_too_long_to_be_looked_at_is_explained_as_far_as_it_came(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(costs, "LONGEST_RUN", 0.0)
    reported = explain(swing())
    assert 0.0 < reported.seen_until < reported.duration == 10.0
    assert any(line.startswith("Measured up to t = ") for line in notes(reported))
    assert all(part.cost is not None for part in reported.constraints + reported.effects)


def test_parts_for_which_no_time_is_left_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(costs, "PREPARING", -1.0)
    reported = explain(swing())
    parts = reported.constraints + reported.effects
    assert {part.reason for part in parts} == {costs.LATE}
    assert reported.step.nanoseconds > 0.0


def test_one_of_a_kind_is_no_plural() -> None:
    assert counted(1, "degree", "of freedom") == "1 degree of freedom"
    assert counted(3, "degree", "of freedom") == "3 degrees of freedom"
    assert counted(1, "step") == "1 step"


def test_a_run_that_ends_early_is_explained_up_to_there() -> None:
    """A bead leaves its guide after a second or so: that was all that was said of the scene."""
    points = [[x, 0.0, x * x] for x in [-1.0 + 0.05 * i for i in range(41)]]
    joint = {"type": "translation", "body": "bead", "guide": {"type": "curve", "points": points}}
    bead = {"mass": 1.0, "inertia": [0.1] * 3, "linear_velocity": [0.5, 0.0, 0.0]}
    mapping = {"bodies": {"bead": bead}, "constraints": {"guide": joint}}
    reported = explain(scene_from_mapping(mapping, duration=4.0))
    assert 1.0 < reported.seen_until < 4.0
    (guide,) = reported.constraints
    assert guide.cost is not None and reported.step.nanoseconds > 0.0


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ([("fixed_axis", 5)], "5 constraint equations, "),
        (
            [("contact", 3)],
            " of the start, 3 constraint equations of closed contacts,",
        ),
        (
            [("weld", 6), ("contact", 3), ("string", 1)],
            " 6 constraint equations and 4 of closed contacts,",
        ),
    ],
    ids=str,
)
def test_rows_of_what_may_open_are_told_apart(parts: list[tuple[str, int]], words: str) -> None:
    """Two balls in flight have 12 degrees of freedom, whatever rows their contact will have."""
    items = tuple(Item(f"c{i}", kind, "a", rows, None) for i, (kind, rows) in enumerate(parts))
    total = sum(rows for _, rows in parts)
    console = Console(record=True, width=400, file=io.StringIO())
    cost = Cost(1.0, 0.0)
    print_explanation(
        Explanation(
            "scene", (("a", 1.0),), items, (), total, 12, (), "maximal", "rk4", None, cost, 1.0,
            0.0, 1.0, 1.0, None, None, (), (),
        ),
        console,
    )  # fmt: skip
    assert words in console.export_text()


# Runs of a scene that take too long are broken off, and count as failed.


def run_with(limit: float) -> tuple[bool, float]:
    """(whether the run came to its end, its cost) of a ball that bounces a few times."""
    mapping = scene(ball([0.0, 0.0, 0.2]), touch(restitution=0.2))
    compiled = compile_scene(scene_from_mapping(mapping))
    runner = Runner(compiled, 0.5, np.array([0.0, 0.5]))
    runner.wall = limit
    setting = Setting("rk4", step=0.1)
    rows, _ = runner.sampled(setting)
    return bool(np.isfinite(rows[-1]).all()), runner.measured_cost(setting, 1e-6)


def test_a_run_from_event_to_event_is_broken_off_at_the_limit() -> None:
    done, cost = run_with(math.inf)
    assert done and math.isfinite(cost)
    done, cost = run_with(0.0)
    assert not done and cost == math.inf
