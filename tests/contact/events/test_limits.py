# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Event-driven heaps advance or end with a line that names time stepping."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from benchmarks.contact.random_scenes import random_scene
from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.contact.events import event_motion, limits
from rb_sim.contact.events.event_motion import STALLED_SPAN, STALLED_STEPS
from tests.contact.scenes import ball, box, scene, touch

TOOL = "use simulation.method time_stepping for this scene"


def stack(*sizes: float) -> dict[str, Any]:
    """Cubes on top of each other, from the floor up, at rest."""
    bodies, constraints, top = {}, {}, 0.0
    for i, size in enumerate(sizes):
        bodies[f"b{i}"] = box([size] * 3, [0.0, 0.0, top + 0.5 * size])
        below = {"parent": f"b{i - 1}", "surface": {"type": "shape"}} if i else {}
        constraints[f"c{i}"] = touch(f"b{i}", mu=0.5, **below)
        top += size
    return scene(bodies, constraints)


def made(mapping: dict[str, Any]) -> str:
    """What making a simulation of the scene says."""
    try:
        Simulation(load_scene(mapping))
    except SimulationError as error:
        return str(error)
    return "made"


def test_corners_on_edges_whose_normals_differ_are_refused() -> None:
    """Three equal cubes: corners of the third lie on edges of the second, to rounding."""
    equal = stack(0.1, 0.1, 0.1)
    text = made(equal)
    assert text.startswith("contacts c2/1 and c2/") and text.endswith(TOOL) and "\n" not in text
    equal["simulation"] = {"duration": 1.0, "method": "time_stepping", "step": 1e-3}
    assert made(equal) == "made"


def test_corners_within_a_face_are_not() -> None:
    assert made(stack(0.1, 0.08)) == "made"


def test_a_run_counts_its_events(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a ball that bounces three in this time (natural units) are too many."""
    mapping = scene(ball([0.0, 0.0, 0.11]), touch(restitution=0.5))
    mapping["simulation"]["duration"] = 0.2
    monkeypatch.setattr(limits, "STALLED_EVENTS", 3)
    monkeypatch.setattr(limits, "STALLED_TIME", 1e-12)
    Simulation(load_scene(mapping)).run(checks=False)
    monkeypatch.setattr(limits, "STALLED_TIME", 1e3)
    with pytest.raises(SimulationError, match=f"{TOOL}$"):
        Simulation(load_scene(mapping)).run(checks=False)


def test_what_gives_way_and_hardly_slips_is_no_paradox() -> None:
    """Coulomb's law has forces wherever the pushes are given; a box that comes to rest on corners
    that give way ended in "Painleve's paradox", and then in a line that no forces are found."""
    rocking = box([0.1, 0.14, 0.18], [0.0, 0.0, 0.0895095])
    rocking |= {
        "mass": 0.8,
        "orientation": {"axis": [0.8, 0.6, 0.0], "angle": 3e-4},
        "linear_velocity": [4e-4, -7e-4, 5e-4],
        "angular_velocity": [-0.03, 0.02, 0.006],
    }
    floor = touch(mu=0.5, compliance={"stiffness": 4000.0})
    places = []
    for tolerance in (1e-8, 1e-11):
        setting = {"simulation": {"duration": 1.0, "tolerance": tolerance, "method": "dopri853"}}
        simulation = Simulation(load_scene(scene(rocking, floor) | setting))
        simulation.advance(0.1)
        places.append(simulation.state.position["body"])
        assert simulation.steps < 5000
    np.testing.assert_allclose(*places, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("axis", "offset"), [("x", 0.0), ("y", 0.0), ("x", 0.2)])
def test_a_can_that_comes_to_stand_in_a_bowl_ends_in_one_line(
    axis: str, offset: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Let go upright, tilted by 0.1 mrad, its point of contact turns round the rim without bound
    (or leaps to the other side, where it falls straight) until the rim touches all round."""
    monkeypatch.setattr(event_motion, "STALLED_STEPS", STALLED_STEPS // 8)
    monkeypatch.setattr(event_motion, "STALLED_SPAN", STALLED_SPAN / 8)
    tilt = [5e-5, 0.0, 0.0, 1.0] if axis == "x" else [0.0, 5e-5, 0.0, 1.0]
    can = {
        "mass": 1.0,
        "shape": {"type": "cylinder", "radius": 0.1, "length": 0.3},
        "position": [0.0, offset, 0.23],
        "orientation": tilt,
    }
    mapping = {
        "bodies": {"can": can},
        "constraints": {
            "bowl": {
                "type": "contact",
                "body": "can",
                "surface": {
                    "type": "sphere",
                    "center": [0.0, 0.0, 1.0],
                    "radius": 1.0,
                    "side": "inside",
                },
            }
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    }
    events = {"simulation": {"duration": 1.0, "method": "dopri853", "rate": 100}}
    simulation = Simulation(load_scene(mapping | events))
    with pytest.raises(SimulationError, match=TOOL):
        simulation.advance(1.0)
    stepping = {"simulation": {"duration": 1.0, "method": "time_stepping", "step": 1e-3}}
    simulation = Simulation(load_scene(mapping | stepping))
    simulation.advance(1.0)
    if offset == 0.0:  # it comes to rest upright: its lower rim is at sqrt(1 - 0.1^2) below
        height = simulation.state.position["can"][2]
        assert height == pytest.approx(1.0 - 0.99**0.5 + 0.15, abs=1e-3)


def test_a_run_that_creeps_names_a_step_that_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a slip that ends, steps of rk4 from one as long as this kept 1 nm/s alive for days."""
    monkeypatch.setattr(event_motion, "STALLED_STEPS", 10_000)
    mapping, _ = random_scene(11, 0)
    mapping["simulation"] = {"duration": 0.5, "rate": 200.0, "method": "rk4", "step": 0.05}
    simulation = Simulation(load_scene(mapping))
    match = "steps in the last .* step 0.05 s is too large here; use step .* runs to the end"
    with pytest.raises(StepTooLargeError, match=match):
        simulation.run(checks=False)


# No LinAlgError leaves the contacts: what linear algebra cannot do is one line.


def fail(*_: Any, **__: Any) -> Any:
    raise np.linalg.LinAlgError("SVD did not converge")


def run_with_a_failing(module: str, name: str) -> str:
    """What a box that falls onto its corners says when this function fails."""
    from rb_sim import Simulation, load_scene

    with pytest.MonkeyPatch.context() as patch:
        mapping = scene(box([0.2, 0.3, 0.1], [0, 0, 0.051]), touch(mu=0.4))
        mapping["simulation"]["duration"] = 0.02
        simulation = Simulation(load_scene(mapping))
        patch.setattr(importlib.import_module(module), name, fail)
        try:
            simulation.run(checks=False)
        except SimulationError as error:
            return str(error)
    return "ran"


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("numpy.linalg", "svd"),
        ("rb_sim.contact.events.event_motion", "record_contacts"),
    ],
)
def test_a_run_tells_it_in_one_line(module: str, name: str) -> None:
    """svd: the shares of redundant corners; record_contacts: kernels."""
    text = run_with_a_failing(module, name)
    assert "have no solution: SVD did not converge" in text and "\n" not in text
