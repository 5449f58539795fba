# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A setting of a method, what it costs, and the choice among settings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.methods import METHODS, build
from rb_sim.motion.motion import Motion

# The cost of a step of each method, in evaluations of the right-hand side.
#
# The costs are constants, because a choice by measured times would change from run to run. They are
# medians of measurements (`python -m benchmarks.steps`, six scenes of one body, a quiet machine)
# and hold to a factor of two.


FIXED = {"euler": 2.0, "rk4": 4.0, "dopri853": 12.0, "gauss6": 24.0, "time_stepping": 6.0}
"""Evaluations of a fixed step; for iterative methods a mean."""

ADAPTIVE = {"dopri853": 15.0, "radau5": 60.0}
"""Evaluations of an attempted step with its error estimate."""

UNKNOWN = 40.0
"""Evaluations of a step of any other method."""

TAYLOR_STEP, TAYLOR_DIGIT = 10.0, 3.5
"""Evaluations of a step of the Taylor method, and the number that each decimal digit of its
tolerance adds."""

JOINTED_STEP, JOINTED_DIGIT = 40.0, 17.0
"""The same in maximal coordinates with constraint rows (chains of 2 and 5 rods:
`python -m benchmarks.series`)."""

REDUCED = 25e-9
"""CPU time of an evaluation for a body in reduced coordinates [s]."""

BODY, ROW = 150e-9, 100e-9
"""CPU time of an evaluation in maximal coordinates, per body and per constraint row [s]; the
elimination adds ROW / 10 for each pair of rows."""

SHARED = 25e-6
"""Additional CPU time of an evaluation for each body on which contacts may act by more rows than it
has degrees of freedom [s], such as a box on its face. One to three boxes at rest, to a factor of
1.4 (`python -m benchmarks.auto_search --family resting`)."""

SOLVE = 4.5e-11
"""CPU time of the linear systems of an implicit step, divided by the cube of the number of
coordinates [s]: lattices of 5 to 30 bodies on springs, to a factor of two."""

OPEN_ROW = 50e-9
"""As ROW, for rows of contacts that are open most of the time [s]: random scenes with one to four
bodies and up to 79 rows of contacts (benchmarks.silent_runs), to a factor of two."""

PYTHON_STEP = 1e-3
"""CPU time of a step of time stepping outside the compiled loop [s]."""

SWEEP = 2.5e-6
"""CPU time of the time-stepping solver per sweep and near contact [s]: settling piles of 8 to 216
balls, to a factor of three."""

EVENT = 2e-3
"""CPU time of a contact event [s]: its location, impacts, choice of modes."""


def evaluations(name: str, tolerance: float | None, compiled: Compiled) -> float:
    """Cost of an attempted step in evaluations of the right-hand side; tolerance: None with fixed
    steps."""
    if METHODS[name].family == "taylor" and tolerance is not None:
        jointed = isinstance(compiled.y, np.ndarray) and compiled.rows > 0
        step, digit = (JOINTED_STEP, JOINTED_DIGIT) if jointed else (TAYLOR_STEP, TAYLOR_DIGIT)
        return step - digit * math.log10(tolerance)
    table = FIXED if tolerance is None else ADAPTIVE
    return table.get(name, UNKNOWN) + _solving(name, compiled)


def _solving(name: str, compiled: Compiled) -> float:
    """Cost of the linear systems of a step in evaluations; 0 for methods without any."""
    if METHODS[name].family != "radau" or not isinstance(compiled.y, np.ndarray):
        return 0.0
    return SOLVE * len(compiled.y) ** 3 / seconds_of_evaluation(compiled)


def seconds_of_evaluation(compiled: Compiled, closed: bool = True) -> float:
    """Approximate CPU time of an evaluation of the scene's right-hand side [s].

    closed: whether all contacts are closed; otherwise most are open most of the time.
    """
    if not isinstance(compiled.y, np.ndarray):
        return REDUCED
    bodies, rows = len(compiled.layout.bodies), compiled.rows
    if not closed:
        return BODY * bodies + OPEN_ROW * rows
    free = BODY * bodies + ROW * rows + 0.1 * ROW * rows * rows
    return free + SHARED * overdetermined(compiled)


def counted_time(motion: Motion, setting: Setting, one: float | None = None) -> float:
    """Approximate CPU time of the steps and events of a motion so far [s], to a factor of three.

    It is computed from their number, and so is the same on every machine. one: CPU time of an
    evaluation [s]; default: with contacts that are open most of the time.
    """
    compiled = motion.compiled
    if one is None:
        one = seconds_of_evaluation(compiled, closed=False)
    attempts = motion.steps + motion.rejected_steps
    worth = EVENT * (motion.forgotten + len(motion.events))
    worth += SWEEP * getattr(motion, "swept_contacts", 0.0)
    if not getattr(motion, "plain", True):
        return worth + PYTHON_STEP * attempts
    return worth + attempts * one * evaluations(setting.name, setting.tolerance, compiled)


def overdetermined(compiled: Compiled) -> int:
    """Number of bodies on which contacts may act by more than six rows."""
    if not compiled.contact_laws:
        return 0
    ends = np.asarray(compiled.system.row_table)[:, :2].ravel()
    return int((np.bincount(ends[ends >= 0]) > 6).sum())


# A setting of a method, and a choice among settings with its reason.


TIGHTEST = 1e-14
"""Local tolerance below which the error is rounding, whatever the step."""

QUANTITIES = ("position", "rotation", "linear_velocity", "angular_velocity", "force", "torque")
UNITS = ("m", "rad", "m/s", "rad/s", "N", "N m")


def listed(errors: Sequence[float]) -> str:
    """The errors of QUANTITIES with their units."""
    return ", ".join(
        f"{name.replace('_', ' ')} {error:.1e} {unit}"
        for name, error, unit in zip(QUANTITIES, errors, UNITS, strict=True)
    )


def dividing(step: float, duration: float) -> float:
    """The largest step <= `step` that divides the duration [s]."""
    return duration / max(1, math.ceil(duration / step * (1.0 - 1e-9)))


class Setting(NamedTuple):
    """A method with a fixed step [s] or a local tolerance: exactly one of the two is set."""

    name: str
    step: float | None = None
    tolerance: float | None = None

    @property
    def order(self) -> int:
        """Order of the method."""
        return METHODS[self.name].order

    @property
    def knob(self) -> float:
        """The step [s] or the tolerance."""
        return self.step if self.step is not None else float(self.tolerance or 0.0)

    @property
    def power(self) -> float:
        """Theoretical exponent of the knob in the global error."""
        return float(self.order) if self.step is not None else 1.0

    def with_knob(self, value: float) -> Setting:
        """The same method with this step [s] or tolerance."""
        if self.step is not None:
            return self._replace(step=value)
        return self._replace(tolerance=value)

    def scaled(self, factor: float, duration: float) -> Setting:
        """The same method with its step or tolerance times the factor; the step divides the
        duration [s], the tolerance is from TIGHTEST to 1."""
        knob = factor * self.knob
        if self.step is not None:
            return self.with_knob(dividing(knob, duration))
        return self.with_knob(min(max(knob, TIGHTEST), 1.0))

    def build(self, duration: float) -> Any:
        """The method for the kernel; duration [s] bounds an adaptive step."""
        return build(self.name, step=self.step, tolerance=self.tolerance, largest_step=duration)

    def __str__(self) -> str:
        if self.step is not None:
            return f"{self.name}, step {self.step:.3g} s"
        return f"{self.name}, tolerance {self.tolerance:.3g}"


@dataclass(frozen=True)
class Choice:
    """What `method: auto` decided, and why."""

    method: str
    step: float | None
    """fixed step [s], or None."""
    tolerance: float | None
    """local tolerance of an adaptive step, or None."""
    target: float
    """requested global error of the pose [rad, m]."""
    predicted_error: float
    """global error over the scene's duration, measured by a checked second run [rad, m]."""
    cost: float
    """CPU seconds per simulated second."""
    reached: bool
    """False if round-off, chaos or the search's budget keep the error above the target."""
    reason: str
    errors: tuple[float, ...] = ()
    """largest errors of position [m], rotation [rad], linear and angular velocity [m/s, rad/s],
    reaction force [N] and torque [N m] over the duration, including the uncertainty of the
    reference."""

    @property
    def setting(self) -> Setting:
        """The setting that was chosen."""
        return Setting(self.method, self.step, self.tolerance)

    def build(self, duration: float) -> Any:
        """The method for the kernel."""
        return self.setting.build(duration)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for a summary or a recording."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.setting}: {self.reason}"
