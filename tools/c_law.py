"""The equations of motion of one body as a function in C: python -m tools.c_law SCENE

It computes dy/dt for the coordinates y of the scene in reduced coordinates (pose, then velocities);
p are the inputs that change while it runs, commands and tables.
"""

from __future__ import annotations

import sys

from rb_sim.base.errors import RbSimError
from rb_sim.graph.emit import c_function
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.mechanics.system import rate
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene


def c_law(scene: str) -> str:
    """void rate(double t, const double *y, const double *p, double *out) of a scene.

    Raises RbSimError for several bodies and for laws that call routines, like contacts.
    """
    laws = compile_scene(load_scene(scene)).laws
    text = c_function("rate", laws.traced(rate)) if isinstance(laws, ReducedLaws) else None
    if text is None:
        raise RbSimError(f"{scene}: must be of one body with at most one joint, without contacts")
    return text


if __name__ == "__main__":
    print(c_law(sys.argv[1]))
