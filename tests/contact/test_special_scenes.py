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
from rb_sim import Simulation
from rb_sim.base.errors import SimulationError
from rb_sim.scene.load import scene_from_mapping

SCENES = {path.stem: path for path in sorted(Path(__file__).parent.glob("special_scenes/*.yaml"))}
REFUSED = {
    "leaving_bilateral_edge": "contact slide reaches the edge of its surface",
    "rough_on_what_gives": "perfectly rough contact floor slips on a compliant support",
    "sides_box_on_cylinder": "an edge of the body penetrates the support of contact c",
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


@pytest.mark.parametrize("seed", range(6))
def test_when_a_side_is_seen_does_not_hang_on_the_pieces_of_a_run(seed: int) -> None:
    """A run is carried in pieces that the wall's clock ends: what it says is of its motion."""
    name, samples = "sides_box_on_cylinder", np.array([0.1, 0.2, 5.0])
    pieces = np.cumsum(np.random.default_rng(seed).uniform(1e-4, 0.2 / 3**seed, 2000))
    told = refusal(name, pieces[pieces < 0.5], samples)
    assert told == refusal(name, np.zeros(0), samples)
    assert "an edge of the body penetrates the support of contact c" in told
