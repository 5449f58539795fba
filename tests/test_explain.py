"""`rb_sim explain`: what a scene calls for, and what each part costs."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rb_sim.accuracy.choice import Setting
from rb_sim.catalogue.effects import SPECS
from rb_sim.cli.explain import explain as explain_verb
from rb_sim.cli.explain import notes
from rb_sim.explain import explain
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene, scene_from_mapping
from rb_sim.step_costs import (
    EDGE,
    FEWEST_STEPS,
    Events,
    cost_of,
    cost_of_events,
    longest_stretch,
    typical_step,
)
from tests.contact.scenes import G, ball, scene, touch
from tests.interpreted import interpreted

CONFIG = Path(__file__).resolve().parents[1] / "config"


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


def test_cost_is_the_median_with_half_the_interquartile_range() -> None:
    cost = cost_of([1.0, 2.0, 3.0, 4.0, 100.0])
    assert (cost.nanoseconds, cost.spread) == (3.0, 1.0)


def test_steps_in_contact_are_measured_between_events_and_events_apart() -> None:
    """A ball dropped from 0.2 m that keeps 0.8 of its speed flies for longest after the first."""
    fall = math.sqrt(2.0 * 0.2 / G)
    flight = 2.0 * 0.8 * fall
    stretch, step, events = interpreted(
        measured, scene(ball([0.0, 0.0, 0.3]), touch(restitution=0.8)), 0.7
    )
    since = EDGE * flight
    assert stretch.start == pytest.approx(fall + since, abs=1e-9)
    assert stretch.length == pytest.approx((1.0 - 2.0 * EDGE) * flight, abs=1e-9)
    assert stretch.y[2] == pytest.approx(0.1 + 0.8 * G * fall * since - 0.5 * G * since**2)
    assert FEWEST_STEPS * step <= stretch.length * (1.0 + 1e-12)
    assert events.count == 2 and events.nanoseconds > 0.0


@pytest.mark.parametrize("nanoseconds", [0.0, 2e6])
def test_events_for_which_nothing_is_left_have_no_price(nanoseconds: float) -> None:
    """Of a box that falls and comes to lie, steps at its rest are measured, which are the dearest:
    all of the run's at that price are more than it took, which was told as 0 ms for an event."""
    falls = scene(ball([0.0, 0.0, 0.3]), touch(restitution=0.8))
    told = explain(scene_from_mapping(falls, duration=0.7))
    said = notes(replace(told, events=Events(76, nanoseconds)))
    (line,) = (line for line in said if line.startswith("Events"))
    assert ("no price" in line) == (nanoseconds == 0.0)
    assert ("2 ms each" in line) == (nanoseconds > 0.0)


def measured(mapping: dict[str, Any], duration: float) -> Any:
    """(stretch, step, events) of the explanation of a scene."""
    compiled, setting = compile_scene(scene_from_mapping(mapping)), Setting("rk4", step=0.01)
    stretch = longest_stretch(compiled, setting, duration)
    step = typical_step(compiled, setting, duration, stretch)
    return stretch, step, cost_of_events(compiled, setting, duration, 1.0)
