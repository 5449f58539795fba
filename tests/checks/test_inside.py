"""A shape that sinks into a support past its listed contact points is reported."""

from __future__ import annotations

import math
import warnings
from typing import Any

import pytest

from rb_sim import Simulation, load_scene

METHODS: list[dict[str, Any]] = [{}, {"method": "time_stepping", "step": 1e-3}]
L = 4.0


def rod(angle: float, **floor: Any) -> dict[str, Any]:
    """A rod that leans by the angle from the vertical, its foot at the origin and listed."""
    ladder = {
        "mass": 15.0,
        "shape": {"type": "rod", "length": L, "center_B": [0, 0, L / 2]},
        "center_of_mass": [0, 0, L / 2],
        "orientation": {"axis": [0, 1, 0], "angle": angle},
    }
    return {
        "bodies": {"ladder": ladder},
        "constraints": {"floor": {"type": "contact", "body": "ladder", **floor}},
        "effects": {"w": {"type": "gravity"}},
        "simulation": {"duration": 1.5, "rate": 200},
    }


def found(scene: dict[str, Any], method: dict[str, Any]) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = Simulation(load_scene(scene, **method)).run()
    return run, [f for f in run.findings if f.watch == "inside"]


@pytest.mark.parametrize("method", METHODS)
def test_the_other_end_of_a_ladder_that_falls_past_its_listed_foot(method):
    """It is in the floor once z of that end, the foot's less L cos(angle), is below zero."""
    scene = rod(0.8, points=[[0, 0, 0]], friction={"type": "coulomb", "static": 0.2})
    run, (finding,) = found(scene, method)
    k = int(abs(run.t - finding.t).argmin())
    q = run.orientation["ladder"][k]
    end = run.position["ladder"][k, 2] + 0.5 * L * (1.0 - 2.0 * (q[0] ** 2 + q[1] ** 2))
    assert finding.figure == pytest.approx(-end, rel=1e-6) and finding.figure > 0.0
    assert finding.where == "floor" and "ladder" in finding.what


@pytest.mark.parametrize("method", METHODS)
def test_with_both_ends_or_none_listed_nothing_sinks(method):
    for points in ({"points": [[0, 0, 0], [0, 0, L]]}, {}):
        _, findings = found(rod(0.8, **points), method)
        assert not findings


def test_a_body_without_a_shape_has_nothing_to_sink():
    scene = rod(0.8, points=[[0, 0, 0]])
    del scene["bodies"]["ladder"]["shape"]
    scene["bodies"]["ladder"]["inertia"] = [20.0, 20.0, 0.1]
    assert not found(scene, {})[1]


def test_a_box_past_its_listed_corner_on_another_body():
    """Any support that it may touch: the face of another body's box."""
    box = {"type": "box", "size": [0.4, 0.4, 0.2]}
    scene = {
        "bodies": {
            "table": {"mass": 5.0, "shape": {"type": "box", "size": [2, 2, 0.2]}},
            "box": {"mass": 1.0, "shape": box, "position": [0, 0, 0.2]},
        },
        "constraints": {
            "hold": {"type": "weld", "body": "table"},
            "on": {"type": "contact", "body": "box", "parent": "table"}
            | {"points": [[0.2, 0.2, -0.1]], "surface": {"type": "shape"}},
        },
        "effects": {"w": {"type": "gravity", "acceleration": [0, 0, -9.81]}},
        "simulation": {"duration": 0.3, "rate": 100},
    }
    (finding,) = found(scene, {})[1]
    assert finding.where == "on" and 0.0 < finding.figure < math.hypot(0.4, 0.2)
