# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The smallest scene that each special case of event-driven contact saves keeps to the invariants.

What each scene is for stands in its first line: without that case it does not end, is refused, or
goes wrong in silence.  Those that have no motion under their laws are refused in one line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from benchmarks.contact.hunt import judged
from benchmarks.contact.toss_verdicts import run
from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError
from rb_sim.scene.load import scene_from_mapping

SCENES = {path.stem: path for path in sorted(Path(__file__).parent.glob("special_scenes/*.yaml"))}
REFUSED = {
    "leaving_bilateral_edge": "contact slide reaches the edge of its surface",
    "rough_on_what_gives": "perfectly rough contact floor slips on a compliant support",
    "sides_box_on_cylinder": "the body penetrates the support of contact c",
    "viscous_drag_lifts": "its drag, which does not depend on the normal force, lifts the body",
}


def mapping(name: str) -> dict[str, Any]:
    return yaml.safe_load(SCENES[name].read_text())


@pytest.mark.parametrize("name", sorted(SCENES.keys() - REFUSED.keys()))
def test_a_special_case_keeps_to_the_invariants(name: str) -> None:
    assert judged(mapping(name)) == "fine"


@pytest.mark.parametrize(("name", "words"), REFUSED.items())
def test_what_has_no_motion_is_refused(name: str, words: str) -> None:
    verdict = run(mapping(name))
    assert isinstance(verdict, str)
    assert verdict.startswith("refused: ")
    assert words in verdict


@pytest.mark.parametrize("name", ["bounces_ball", "bounces_rocking_block"])
def test_bounces_without_end_come_to_rest(name: str) -> None:
    assert "rests" in [event.kind for event in run(mapping(name)).events]


def test_the_rebound_after_a_jam_is_kept() -> None:
    """A rod that jams in Painleve's paradox leaves with restitution 0.3 of what stopped it."""
    kinds = [event.kind for event in run(mapping("jams_restitution")).events]
    assert "jams" in kinds


def refusal(name: str, targets: np.ndarray, samples: np.ndarray) -> str:
    """Of a run with these samples that is carried by way of the targets; see Watcher."""
    motion = Simulation(scene_from_mapping(mapping(name)), announce=None).motion
    ends = np.union1d(targets, samples)
    try:
        for t in ends:
            out = np.zeros((1, motion.width)) if t in samples else None
            motion.run_to(np.array([t]), out)
    except SimulationError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("seed", [0, 4])
def test_when_a_side_is_seen_does_not_hang_on_the_pieces_of_a_run(seed: int) -> None:
    """A run is carried in pieces that the wall's clock ends: what it says is of its motion."""
    name, samples = "sides_box_on_cylinder", np.array([0.1, 0.2, 5.0])
    pieces = np.cumsum(np.random.default_rng(seed).uniform(1e-4, 0.2 / 3**seed, 2000))
    reported = refusal(name, pieces[pieces < 0.5], samples)
    assert reported == refusal(name, np.zeros(0), samples)
    assert "the body penetrates the support of contact c" in reported


# Scenes of contact at other sizes: a micrometre and a nanogram, a kilometre and a megaton.


def jamming_rod(size: float) -> dict[str, Any]:
    """A rod that slides on its lower end towards Painleve's paradox."""
    tilt, half = 0.8, 0.5 * size
    return {
        "bodies": {
            "rod": {
                "mass": size**3,
                "shape": {"type": "rod", "length": size},
                "orientation": {"axis": [0.0, 1.0, 0.0], "angle": 0.5 * np.pi - tilt},
                "position": [half * np.cos(tilt), 0.0, half * np.sin(tilt)],
                "linear_velocity": [-10.0 * size**0.5, 0.0, 0.0],
            }
        },
        "constraints": {
            "floor": {
                "type": "contact",
                "body": "rod",
                "friction": {"type": "coulomb", "static": 1.6},
            }
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 0.8 * size**0.5, "rate": 20.0 / size**0.5},
    }


@pytest.mark.parametrize("size", [1e-9, 1e3])
def test_a_rod_that_jams(size: float) -> None:
    """The impulse that resolves the paradox, and the flight after it."""
    run = Simulation(load_scene(jamming_rod(size))).run(checks=False)
    metre = Simulation(load_scene(jamming_rod(1.0))).run(checks=False)
    of_metre, of_size = ([e.kind for e in each.events] for each in (metre, run))
    assert of_size == of_metre and "jams" in of_metre
    one, other = (
        np.array([e.impulse for e in each.events if e.kind == "jams"]) for each in (metre, run)
    )
    np.testing.assert_allclose(other / size**3.5, one, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(run.position["rod"] / size, metre.position["rod"], atol=1e-6)
