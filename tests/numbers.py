# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The laws of a compiled scene at one state, as runs have them; the way back to the manifold."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from rb_sim.compiler.graph import machine

POINTER = ctypes.POINTER(ctypes.c_double)
LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)


def outputs(law: Any, t: float, y: np.ndarray, p: np.ndarray, count: int) -> np.ndarray:
    """The law's numbers; through its address if it has one."""
    out = np.zeros(count)
    if machine.interpreted():
        law(t, y, p, out)
    else:
        LAW(law.address)(t, *(a.ctypes.data_as(POINTER) for a in (y, p, out)))
    return out


def projected(system: Any, t: float, y: np.ndarray) -> np.ndarray:
    """y with unit quaternions and on the manifold, in place."""
    from rb_sim.mechanics.initial_projection import start_on_manifold
    from rb_sim.mechanics.system import project
    from rb_sim.mechanics.systems.many_bodies import MultiBody

    if isinstance(system, MultiBody):
        start_on_manifold(system, t, y)
    else:
        project(system, t, y)
    return y


def rate_at(compiled: Any, t: float, y: np.ndarray) -> np.ndarray:
    """dy/dt."""
    from rb_sim.mechanics.contact.motion_kernels import contact_rate

    dy = np.zeros(len(y))
    if compiled.laws is None:  # contacts
        contact_rate(compiled.system, t, y, dy)
        return dy
    return outputs(compiled.laws.rate, t, y, inputs(compiled, t), len(y))


def sample_at(compiled: Any, t: float, y: np.ndarray) -> np.ndarray:
    """What is reported."""
    from rb_sim.mechanics.samples import row_width
    from rb_sim.mechanics.system import sample

    out = np.zeros(row_width(compiled.layout))
    if compiled.laws is None:
        sample(compiled.system, t, y, out)
        return out
    return outputs(compiled.laws.sample, t, np.array(y), inputs(compiled, t), len(out))


def inputs(compiled: Any, t: float) -> np.ndarray:
    """The numbers that laws take beside t and y; the last one is the length of a step."""
    return np.array([*compiled.laws.inputs.values(compiled.system, t), 0.0])
