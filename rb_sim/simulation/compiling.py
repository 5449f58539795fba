"""Compile a scene ahead of its first step, and say so when it takes more than the cache."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.simulation import Simulation

Say = Callable[[str], None]

ATTEMPTS = 8
"""More than there are kernels; each may fail to be kept once."""


def compiled(scene: Scene, say: Say) -> Simulation:
    """The simulation of a scene, ready to step.

    say: gets a line where something really has to be compiled, or cannot be kept.
    """
    from rb_sim.numerics.kernels import on_compilation
    from rb_sim.simulation.scene_in_motion import compiling
    from rb_sim.simulation.simulation import Simulation

    said: list[str] = []

    def say_once(line: str) -> None:
        if line not in said:
            said.append(line)
            say(line)

    def announce() -> None:
        say_once(compiling(scene.name))

    if scene.simulation.method == "auto":
        say_once(
            f"choosing the cheapest method for a global error of {scene.simulation.tolerance:g}"
        )
    with on_compilation(announce):
        for attempt in range(ATTEMPTS):
            try:
                simulation = Simulation(scene, announce=None)
                simulation.warm()
                return simulation
            except OSError as error:  # the code is compiled, but there is no room to keep it
                if attempt == ATTEMPTS - 1:
                    raise
                say_once(f"note: the compiled code is not kept: {error.strerror}")
    raise AssertionError("the loop returns or raises")
