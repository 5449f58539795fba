# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The equations of motion of one body as a function in C: python -m tools.c_law SCENE

It computes dy/dt for the coordinates y of the scene in reduced coordinates (pose, then velocities);
p are the inputs that change while it runs, commands and tables.
"""

from __future__ import annotations

import sys

from rb_sim.base.errors import RbSimError
from rb_sim.compiler.graph.emit import c_function
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.mechanics.systems.one_body import rate
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene


def c_law(scene: str) -> str:
    """void rate(double t, const double *y, const double *p, double *out) of a scene.

    Raises RbSimError for several bodies and for laws that call routines, like contacts.
    """
    laws = compile_scene(load_scene(scene)).laws
    text = c_function(laws.traced(rate)) if isinstance(laws, ReducedLaws) else None
    if text is None:
        raise RbSimError(f"{scene}: must be of one body with at most one joint, without contacts")
    return text


if __name__ == "__main__":
    print(c_law(sys.argv[1]))
