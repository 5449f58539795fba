# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What became of a toss: fine, or in one line what is wrong with it."""

from __future__ import annotations

import math
import os
import resource
import signal
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.contact.depths import depth_of
from benchmarks.contact.shapes import size_of

DEEPEST = 1e-9
"""Overlap, in sizes of the body, that is none."""
GAINED = 1e-6
"""Energy, relative to that of the toss, that is none: what the default tolerance leaves."""


def apart(
    mapping: dict[str, Any], seconds: float, judge: Callable[[dict[str, Any]], str] | None = None
) -> str:
    """As `judge` (left out: `judged`), in a process of its own that may take so much CPU time: a
    signal does not reach Python while a kernel runs, and what kills the process is a verdict as
    well."""
    here, there = os.pipe()
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), math.ceil(seconds) + 5))
        os.write(there, (judge or judged)(mapping).encode()[:2000])
        os._exit(0)
    os.close(there)
    with os.fdopen(here, "rb") as pipe:
        text = pipe.read().decode()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"endless: not done after {seconds:g} s of CPU"
    return text if status == 0 else f"traceback: the process died of {status}"


def judged(mapping: dict[str, Any]) -> str:
    """What became of a toss: "fine", or what is wrong with it."""
    found = run(mapping)
    return found if isinstance(found, str) else verdict(mapping, found)


def run(mapping: dict[str, Any], go: Callable[[Any], Any] | None = None) -> Any:
    """The trajectory that `go` (left out: `run`) makes of the simulation, or in a line why there is
    none."""
    from rb_sim import Simulation, load_scene
    from rb_sim.base.errors import RbSimError

    try:
        with np.errstate(all="ignore"):
            simulation = Simulation(load_scene(mapping))
            return simulation.run() if go is None else go(simulation)
    except RbSimError as error:
        text = str(error)
        return "unclear: " + repr(text) if "\n" in text else "refused: " + text
    except Exception as error:  # noqa: BLE001 (what is counted is that there is none)
        return f"traceback: {type(error).__name__}: {error}"


def verdict(mapping: dict[str, Any], trajectory: Any) -> str:
    """Of the samples."""
    block = trajectory.block
    contact, body = mapping["constraints"]["c"], mapping["bodies"]["b"]
    size = size_of(body["shape"])
    if "compliance" not in contact:
        deepest = float(block.residual.max())  # in lengths of the scene, at least the body's
        deepest = max(deepest, float(depth_of(contact, mapping, trajectory).max()) / size)
        if not deepest <= DEEPEST:
            return f"overlaps: by {deepest:.2g} of its size"
        total = block.energy
    else:
        total = block.energy - block.contact_work  # the support stores some
    scale = float(block.kinetic_energy.max()) + body["mass"] * 9.81 * size
    gained = float((total - np.minimum.accumulate(total)).max()) / scale
    if not gained <= GAINED:
        return f"gains: {gained:.2g} of its energy"
    return "fine"
