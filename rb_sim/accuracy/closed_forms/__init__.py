# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms of motions: a scene that matches one is measured against it."""

from __future__ import annotations

import numpy as np

from rb_sim.accuracy.closed_forms.on_supports import (
    bouncing_ball,
    off_a_sphere,
    rolling_in_cylinder,
    rolling_sphere,
    sliding_block,
    slipping_ball,
    turntable,
)
from rb_sim.accuracy.closed_forms.rotors import (
    Exact,
    falling_body,
    free_rotor,
    pendulum,
    steady_top,
    symmetric_rotor,
)
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.methods import build
from rb_sim.mechanics.samples import Array, SampleBlock, block_of
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.schema import DEFAULT_TOLERANCE, Scene

FORMS = (
    symmetric_rotor,
    free_rotor,
    pendulum,
    rolling_sphere,
    steady_top,
    falling_body,
    bouncing_ball,
    slipping_ball,
    turntable,
    rolling_in_cylinder,
    off_a_sphere,
    sliding_block,
)
"""Of a compiled scene: its exact motion, or None; the first that knows one is taken. The table that
`rb_sim accuracy` measures against and that the tests compare runs with."""


def closed_form(compiled: Compiled) -> Exact | None:
    """The exact motion of a compiled scene, or None where none is known."""
    if compiled.breakpoints:
        return None
    found = (form(compiled) for form in FORMS)
    return next((exact for exact in found if exact is not None), None)


def exact_samples(scene: Scene, times: Array) -> tuple[str, SampleBlock] | None:
    """Name of the closed form of a scene, and its samples at these times; None where there is none.

    times: from the scene's start, increasing [s].
    """
    compiled = compile_scene(scene)
    exact = closed_form(compiled)
    if exact is None:
        return None
    span = scene.simulation.duration
    method = build("dopri853", step=None, tolerance=DEFAULT_TOLERANCE, largest_step=span)
    motion = motion_of(compiled, method)
    rows = np.zeros((len(times), motion.width))
    for i, (t, y) in enumerate(zip(times, exact.coordinates(times), strict=True)):
        motion.reset(np.array(y, dtype=float), float(t))
        rows[i] = motion.sample()[0]
    command = np.zeros((len(times), len(compiled.layout.commanded), 6))
    return exact.name, block_of(times, rows, compiled.layout, command)
