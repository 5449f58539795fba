# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""No LinAlgError leaves the contacts: what linear algebra cannot do is one line."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SimulationError
from rb_sim.contact.events.instant import pseudo_inverse, require_finite
from tests.contact.scenes import ball, box, scene, touch
from tests.interpreted import interpreted

BAD = (np.nan, np.inf, -np.inf)


def fail(*_: Any, **__: Any) -> Any:
    raise np.linalg.LinAlgError("SVD did not converge")


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("ends", ["choose_modes", "_strike"])
def test_a_run_whose_loads_are_not_finite_is_told(bad: float, ends: str) -> None:
    """A mass that is none makes the Delassus matrix none, of impacts and of modes."""
    text = interpreted(told_of, bad, ends)
    assert text.startswith("the laws of contact have no solution") and "finite" in text


def told_of(bad: float, ends: str) -> str:
    """What is said of a ball that strikes the floor, or lies on it, with an inertia of this."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.events.shares import choose_modes

    falls = ends == "_strike"
    mapping = scene(
        ball([0, 0, 0.1], linear_velocity=[0, 0, -1.0 if falls else 0.0]), touch(mu=0.3)
    )
    motion: Any = Simulation(load_scene(mapping))._motion
    y = np.array(motion.compiled.y)
    motion.system.bodies[:, 7] = bad  # of the inverse of the inertia
    try:
        instant = motion._instant(0.0, y)
        motion._strike(instant) if falls else choose_modes(instant)
    except SimulationError as error:
        return str(error)
    return "ran"


def run_with_a_failing(module: str, name: str) -> str:
    """What a box that falls onto its corners says when this function fails."""
    from rb_sim import Simulation, load_scene

    with pytest.MonkeyPatch.context() as patch:
        mapping = scene(box([0.2, 0.3, 0.1], [0, 0, 0.051]), touch(mu=0.4))
        mapping["simulation"]["duration"] = 0.02
        simulation = Simulation(load_scene(mapping))
        patch.setattr(importlib.import_module(module), name, fail)
        try:
            simulation.run()
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
    text = interpreted(run_with_a_failing, module, name)
    assert "have no solution: SVD did not converge" in text and "\n" not in text


def test_entries_whose_squares_overflow_are_no_error() -> None:
    """A pseudo-inverse of numbers of 1e200 has a solution."""
    A = 1e200 * np.diag([1.0, 2.0])
    np.testing.assert_allclose(pseudo_inverse(A, "reactions"), 1e-200 * np.diag([1.0, 0.5]))
    require_finite("reactions", A, np.array([-1e300, 1e300]))
