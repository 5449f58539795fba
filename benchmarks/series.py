# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The Taylor series of the coordinates beside that of other variables, and beside dopri853.

    python -m benchmarks.series [--links 2 5 10]

For the shipped scenes of one body and for chains, at the tolerances TOLERANCES: CPU time of a
simulated second by the series of the coordinates; over it by that of the variables that rb_sim
takes instead (`mechanics.taylor_variables`), if it does, and by dopri853; and what a step along
the series costs in steps of dopri853.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from benchmarks.many_body_scenes import chain
from rb_sim import load_scene
from rb_sim.integrate.methods.dopri853 import AdaptiveDopri853
from rb_sim.integrate.methods.taylor import AdaptiveTaylor
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.motion.traced import TracedMotion
from rb_sim.scene.compile import compile_scene

SCENES = (
    "free_tumble",
    "gazebo_boxes",
    "heavy_top",
    "pendulum",
    "rolling_sphere",
    "rolling_disk",
)
TOLERANCES = (1e-6, 1e-9, 1e-12)
REPEATS = 15


class OfCoordinates(ReducedLaws):
    """Laws without other variables."""

    variables: Any = None


def cost(compiled: Compiled, method: Any, span: float) -> tuple[float, float]:
    """(CPU time of a simulated second, of a step), least of REPEATS [s]."""
    motion, best = TracedMotion(compiled, method), float("inf")
    motion.warm()
    for _ in range(REPEATS):
        motion.reset()
        begin = time.process_time()
        motion.run_to([span])
        best = min(best, time.process_time() - begin)
    return best / span, best / motion.steps


def row(name: str, compiled: Compiled, span: float, tolerance: float) -> str:
    """A line of the table."""
    taylor = AdaptiveTaylor(tolerance, span)
    laws: Any = compiled.laws
    ours = None
    if getattr(laws, "variables", None) is not None:
        ours, _ = cost(compiled, taylor, span)
        vars(compiled)["laws"] = OfCoordinates(compiled.system, laws.n, laws.width)
    second, step = cost(compiled, taylor, span)
    other, other_step = cost(compiled, AdaptiveDopri853(tolerance, span), span)
    hand = "-" if ours is None else f"{ours / second:.2f}"
    steps = f"{other / second:.2f} | {step / other_step:.1f}"
    return f"| {name} | {tolerance:.0e} | {second:.1e} | {hand} | {steps} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--links", type=int, nargs="*", default=[2, 5, 10])
    options = parser.parse_args()
    print("| scene | tolerance | s/s | variables | dopri853 | step in steps of dopri853 |")
    print("|---|---|---|---|---|---|")
    for name in SCENES:
        scene = load_scene(f"config/{name}.yaml")
        for tolerance in TOLERANCES:
            span = scene.simulation.duration
            print(row(name, compile_scene(scene), span, tolerance), flush=True)
    for links in options.links:
        compiled = compile_scene(load_scene(chain(links)))
        print(row(f"chain of {links}", compiled, 1.0, 1e-9), flush=True)


if __name__ == "__main__":
    main()
