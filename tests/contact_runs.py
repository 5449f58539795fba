# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs of contact scenes: samples at any instants, and what happened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.contact.events.event_motion import ContactEvent
from rb_sim.mechanics.samples import block_of
from rb_sim.simulation.trajectory import Trajectory
from tests.interpreted import interpreted


@dataclass(frozen=True)
class ContactRun:
    """Samples and events of a run."""

    trajectory: Trajectory
    events: tuple[ContactEvent, ...]

    def times(self, kind: str, contact: str | None = None) -> list[float]:
        """Instants of the events of one kind."""
        return [
            e.t for e in self.events if e.kind == kind and (contact is None or e.contact == contact)
        ]

    def balance(self) -> float:
        """Largest change of energy minus work of the contacts [J]."""
        balance = self.trajectory.energy - self.trajectory.contact_work
        return float(np.abs(balance - balance[0]).max())


def contact_run(scene: dict[str, Any], times: Sequence[float], **options: Any) -> ContactRun:
    """The scene mapping run to the instants; what it raises is raised here."""
    return _found(_run(scene, list(times), options))


def interpreted_run(scene: dict[str, Any], times: Sequence[float], **options: Any) -> ContactRun:
    """The same as plain Python."""
    return _found(interpreted(_run, scene, list(times), options))


def _found(found: Any) -> ContactRun:
    if isinstance(found, str):
        raise RbSimError(found)
    return ContactRun(Trajectory(found[0], found[1]), found[2])


def _run(scene: dict[str, Any], times: list[float], options: dict[str, Any]) -> Any:
    mapping = scene | {"simulation": scene.get("simulation", {}) | options}
    try:
        simulation = Simulation(load_scene(mapping))
        motion = simulation._motion
        out = np.zeros((len(times), motion.width))
        with np.errstate(all="ignore"):  # attempts that are far too long overflow, and are refused
            motion.run_to(np.array(times), out)
    except RbSimError as error:
        return str(error)
    command = np.zeros((len(times), len(simulation.layout.commanded), 6))
    block = block_of(np.array(times), out, simulation.layout, command)
    return block, simulation.layout, simulation.events
