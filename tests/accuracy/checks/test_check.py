# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a run may lose before a check speaks, what its steps tell, and what is advised."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.accuracy.checks.check import Effort, effort_of, finer_step
from rb_sim.accuracy.checks.step_checks import found_in
from rb_sim.accuracy.checks.step_doubling import Missed
from rb_sim.base.errors import Finding
from rb_sim.contact.grid_motion import LeftOpen
from tests.accuracy.checks.blocks import Block


@pytest.mark.parametrize(
    ("figure", "order", "step"),
    [
        (0.1, 1, 0.05),  # at its bound: half of it
        (0.8, 1, 0.005),  # to 1/16
        (0.8, 2, 0.02),  # to 1/4
        (5.0, 1, 0.005),  # lost: as a figure of one
        (np.inf, 1, 0.005),
        (np.nan, 2, 0.02),
        (0.0, 1, 0.05),
    ],
)
def test_a_finer_step_by_the_order(figure: float, order: int, step: float) -> None:
    """A step of 0.1 s and a bound of 0.1: a figure of one asks for 1/20, or 1/4.5 of order two."""
    assert finer_step(0.1, figure, 0.1, order) == step


# What shows in how a run was integrated is told in finite steps, whatever it lost.


@pytest.mark.parametrize("lost", [0.5, 1e3, 1e300, math.inf])
def test_energy_lost_to_running_contacts_without_bound_names_a_step(lost: float) -> None:
    """A trial of another step blew up, and the search for a step ended in a traceback."""
    block = Simulation(load_scene("thrown_ball", duration=0.1), announce=None).sample().block
    effort = Effort("time_stepping", 0.002, None, 50, restruck=lost)
    (finding,) = found_in(block, effort, 1.0)
    assert finding.check == "contact steps" and finding.figure == lost
    assert finding.finer_step is not None and 0.0 < finding.finer_step < 0.002


TOP = {"mass": 0.22, "inertia": [0.0026, 0.0022, 0.00335], "angular_velocity": [10.0, 6.0, -4.0]}


def test_a_long_step_of_auto_was_measured_and_is_reported_only_beyond() -> None:
    """Its 4 rad keep the pose to 1e-3; the same step, named, and longer runs are not measured."""
    setting = {"method": "auto", "tolerance": 1e-3, "duration": 2.0, "rate": 50.0}
    scene = {"bodies": {"top": TOP}, "simulation": setting}
    chosen = Simulation(load_scene(scene), announce=None)
    assert chosen.choice is not None and chosen.choice.step is not None
    block = chosen.run(checks=False).block
    sharp = Simulation(load_scene(scene, method="dopri853", tolerance=1e-13), announce=None)
    exact = sharp.run(checks=False).block
    assert np.abs(block.orientation - exact.orientation).max() < 0.5e-3
    missed = effort_of(chosen)._replace(missed=Missed(0.5, "top"))
    assert not [*found_in(block, missed, 1.0)]
    for unmeasured in (missed._replace(kept_to=0.0), missed._replace(kept_to=1.99)):
        assert [finding.check for finding in found_in(block, unmeasured, 1.0)] == ["step"]


def reported(
    effort: Effort, t: tuple[float, ...] = (1.0, 1.5, 2.0), **more: float
) -> dict[str, Finding]:
    """What the effort of a run tells by its last sample, by watch."""
    block: Any = Block(t)
    found = found_in(block, effort, more.get("exchanged", 1.0))
    return {finding.check: finding for finding in found}


STEPPED = Effort("time_stepping", 0.02, None, 50)
ADAPTIVE = Effort("dopri853", None, 1e-6, 50)


def test_what_steps_miss_is_reported_beyond_its_bound() -> None:
    """Of rk4 a figure 8 times the bound asks for half the step."""
    fixed = Effort("rk4", 0.02, None, 50, missed=Missed(0.8, "b"))
    finding = reported(fixed)["step"]
    assert (finding.figure, finding.t, finding.where, finding.bound) == (0.8, 2.0, "b", 0.1)
    assert finding.finer_step == 0.01
    assert reported(fixed._replace(missed=Missed(0.099, "b"))) == {}
    assert reported(ADAPTIVE._replace(missed=Missed(0.8, "b"))) == {}


@pytest.mark.parametrize(
    ("counted", "figure", "bound", "finer"),
    [
        ({"unsolved": 1, "solver_residual": 0.3}, 0.3, 1e-6, 0.01),
        ({"circling": 1}, 0.02, 0.0, 0.002),
        ({"restruck": 0.16}, 0.04, 0.02, 0.01),
        ({"made": 0.08}, 0.02, 0.01, 0.01),
        ({"astray": (0.2, 0.3, "floor")}, 0.2, 0.05, 0.002),
        ({"paradox": 1}, 0.02, 0.0, None),
        ({"slipping": 3}, 0.06, 0.0, None),
    ],
)
def test_steps_that_do_not_follow_their_contacts_are_reported(
    counted: dict[str, Any], figure: float, bound: float, finer: float | None
) -> None:
    """Of 50 steps of 0.02 s and 4 J; errors of first order, so that a figure four times its bound
    asks for a quarter of the step, and half of that for a margin."""
    found = reported(STEPPED._replace(**counted), exchanged=4.0)["contact steps"]
    assert (found.figure, found.bound) == (pytest.approx(figure), bound)
    assert found.finer_step == finer and ("try step" in found.advice) == (finer is not None)
    assert found.t == (0.3 if "astray" in counted else 2.0)
    assert found.where in ("1 of 50 steps", "3 of 50 steps", "floor", "")


def test_steps_that_nearly_follow_their_contacts_are_not() -> None:
    near = STEPPED._replace(restruck=0.079, made=0.039, astray=(0.049, 0.3, "floor"))
    assert reported(near, exchanged=4.0) == {}
    assert reported(STEPPED._replace(restruck=0.1, made=0.1), exchanged=0.0) == {}


def test_of_what_contacts_tell_the_first_is_reported() -> None:
    """Unsolved steps explain the rest."""
    all_of_it = STEPPED._replace(unsolved=2, solver_residual=0.3, circling=1, paradox=3)
    assert reported(all_of_it)["contact steps"].where == "2 of 50 steps"
    assert reported(STEPPED._replace(steps=0, paradox=2))["contact steps"].figure == 2.0


@pytest.mark.parametrize("effort", [STEPPED, ADAPTIVE])
def test_motions_that_laws_leave_open_are_reported(effort: Effort) -> None:
    """Apart by more than what the setting takes for one: 1e-3, or the tolerance."""
    bound = 1e-3 if effort is STEPPED else 1e-6
    chosen = LeftOpen(0.9 * bound, 0.3, "floor", "what parts,")
    assert reported(effort._replace(left_open=chosen)) == {}
    found = reported(effort._replace(left_open=chosen._replace(figure=2.0 * bound)))["ambiguous"]
    assert (found.t, found.where, found.bound, found.finer_step) == (0.3, "floor", bound, None)
    assert found.advice == chosen.advice
