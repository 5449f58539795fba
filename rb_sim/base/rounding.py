# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How large rounding is, in four sizes that all of the package shares, what solvers leave, and
what nobody sees.

What decides anything but rounding has a name of its own where it decides.
"""

from __future__ import annotations

TWO_ULPS = 4e-16
"""Relative difference of two doubles that are equal but for their last places."""
SUM_ROUNDING = 1e-14
"""Of the terms of a sum of a few: what rounding leaves where the sum is zero."""
COMPUTED_ROUNDING = 1e-12
"""Relative size of what is zero in numbers that some dozens of operations give."""
WRITTEN_ROUNDING = 1e-9
"""Relative misfit of numbers that a person or a program has rounded and written down."""
NEGLIGIBLE = 1e-6
"""Share of the largest of its kind below which something is not drawn and not told."""
SOLVED = 1e-9
"""Share of what is solved for that solvers, projections and tolerances leave at their best: of
constraints, of velocities, of the energy exchanged, of the lengths at which loads act."""
SOLVED_IN_CONTACT = 1e-6
"""The same with contacts: of lengths by overlaps at events and bodies that creep at rest, of
impulses by a step of time stepping."""
