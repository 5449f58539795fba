# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Thresholds of rounding in four sizes, of solvers, and of negligible quantities; magnitudes.

Thresholds that decide anything but rounding are named where they are used.
"""

from __future__ import annotations

from collections.abc import Mapping

TWO_ULPS = 4e-16
"""Relative difference of two doubles that are equal except for their last places."""
SUM_ROUNDING = 1e-14
"""Rounding error of a sum of a few terms, relative to the terms."""
COMPUTED_ROUNDING = 1e-12
"""Relative rounding error of numbers computed by some dozens of operations."""
WRITTEN_ROUNDING = 1e-9
"""Relative error of numbers that a person or a program has rounded and written down."""
NEGLIGIBLE = 1e-6
"""Fraction of the largest quantity of its kind below which a quantity is neither drawn nor
reported."""
SOLVED = 1e-9
"""Best accuracy of solvers, projections and tolerances, relative to what they solve for:
constraints, velocities, the exchanged energy, the lengths at which loads act."""
SOLVED_IN_CONTACT = 1e-6
"""The same with contacts: relative to lengths for overlaps at events and creep at rest, relative to
impulses for a step of time stepping."""


PAIRS = (("speed", "spin"), ("torque", "force"), ("acceleration", "turning"))


def related(sizes: Mapping[str, float], length: float) -> dict[str, float]:
    """Reference magnitudes by kind of quantity: below their rounding a quantity counts as zero.

    sizes: greatest values (speed [m/s], spin [rad/s], force [N], torque [N m], power [W],
    acceleration [m/s^2], turning [rad/s^2] and others). Related kinds share a magnitude, since a
    vanishing torque is the difference of forces times `length` [m].
    """
    found = dict(sizes)
    for kind, per_length in PAIRS:
        size, other = sizes.get(kind, 0.0), sizes.get(per_length, 0.0)
        found[kind] = max(size, other * length)
        found[per_length] = max(other, size / length if length else 0.0)
    found["power"] = max(sizes.get("power", 0.0), found["force"] * found["speed"])
    return found
