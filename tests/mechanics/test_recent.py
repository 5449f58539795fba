"""Laws are kept for equal systems, and for these alone."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.many_body_scenes import chain
from rb_sim.scene import compiled
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from rb_sim.simulation.simulation import Simulation


def laws_of(scene: dict[str, Any]) -> Any:
    return compile_scene(scene_from_mapping(scene)).laws


def heavier(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with one mass that differs in its last bit."""
    bodies = scene["bodies"]
    bodies["b0"]["mass"] = float(np.nextafter(bodies["b0"]["mass"], 2.0))
    return scene


@pytest.mark.parametrize("links", [1, 2])
def test_the_same_scene_has_the_same_laws_whatever_its_method(links):
    first = laws_of(chain(links))
    other = chain(links)
    other["simulation"] = {"duration": 1.0, "rate": 7.0, "method": "taylor", "tolerance": 1e-9}
    assert laws_of(other) is first
    assert laws_of(heavier(chain(links))) is not first


def test_interpreted_laws_are_others(monkeypatch):
    first = compiled.recent_laws((1.0,), (), lambda system: [system])
    monkeypatch.setenv("RB_SIM_INTERPRETED", "1")
    assert compiled.recent_laws((1.0,), (), lambda system: [system]) is not first


def test_laws_of_a_class_without_a_name_are_made_anew():
    class Local(NamedTuple):
        length: float = 1.0

    made = [compiled.recent_laws(Local(), (), lambda system: [system]) for _ in range(2)]
    assert made[0] is not made[1]


def test_no_more_are_kept_than_said(monkeypatch):
    monkeypatch.setattr(compiled, "KEPT", 2)
    made = [
        compiled.recent_laws((float(i),), (), lambda system: [system]) for i in (1, 2, 1, 3, 1, 2)
    ]
    assert made[0] is made[2] is made[4]
    assert made[5] is not made[1]


def test_commands_of_one_run_do_not_reach_another_of_the_same_scene():
    scene = chain(2, duration=0.05)
    scene["effects"]["hand"] = {"type": "commanded_wrench", "body": "b1"}
    alone = Simulation(scene_from_mapping(scene)).run(watched=False).position["b1"]
    pushed, still = (Simulation(scene_from_mapping(scene)) for _ in range(2))
    pushed.apply_wrench("b1", force=[3.0, 2.0, 1.0], torque=[0.0, 0.0, 0.0])
    for _ in range(5):
        pushed.advance(0.01)
        still.advance(0.01)
    assert abs(pushed.sample().position["b1"][0] - alone[-1]).max() > 1e-4
    assert_allclose(still.sample().position["b1"][0], alone[-1], atol=1e-15)
