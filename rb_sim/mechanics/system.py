# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A system: coordinates y of a scene and its constants; dispatch of its kernels.

Every kind of system is a NamedTuple class that registers the kernels below. y is a tuple of floats
(one body: the compiler keeps it in registers and unrolls every sum) or an array (N bodies);
configuration first, then velocities.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rb_sim.numerics.kernels import dispatch

CONFIGURATION: dict[type, int] = {}
"""Number of leading coordinates of y that are configuration, for each class of one-body systems."""

EVENT_DRIVEN: set[type] = set()
"""Classes of systems whose motion has events; they have their own laws."""

STARTS: dict[type, Callable[[Any, Any], Any]] = {}
"""Functions (system, y) -> system for classes whose constants depend on the initial coordinates."""


def started(system: Any, y: Any) -> Any:
    """The system with its constants for a motion that starts at y."""
    start = STARTS.get(type(system))
    return start(system, y) if start else system


@dispatch
def project(system, t, y):
    """y projected onto the constraint manifold up to rounding; arrays in place."""


@dispatch
def sample(system, t, y, out):
    """Write all quantities of a sample at one instant into out, in the order of
    `samples.block_of`."""


@dispatch
def inside(system, y):
    """False once the state has left the system's domain (the end of a guide)."""
