"""`rb_sim explain`: what a scene calls for, and what each part costs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rb_sim.catalogue.effects import SPECS
from rb_sim.cli.explain import explain as explain_verb
from rb_sim.explain import cost_of, explain
from rb_sim.scene.load import load_scene

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
