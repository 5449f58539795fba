# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""RK4 step of chains of rods on spherical joints, beside MuJoCo's RK4 on the same chain.

    python -m benchmarks.peers.chains [--links 2 10 100] [--rounds N]

Both are measured in turn in one process, the least CPU time of the rounds counts, samples left out.
rb_sim's step includes the way back to the manifold; MuJoCo's coordinates need none.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from benchmarks import machine
from benchmarks.many_body_scenes import chain
from benchmarks.sizes import mujoco_chain

SPAN = 0.2
"""Simulated time of one measurement [s], in steps of 1 ms."""


def own_step(simulation: Any) -> float:
    """One RK4 step [us]."""
    simulation.reset()
    begin = time.process_time()
    simulation.advance(SPAN)
    return 1e6 * (time.process_time() - begin) / simulation.steps


def main() -> None:
    """Measure and print."""
    from rb_sim import Simulation
    from rb_sim.scene.load import scene_from_mapping

    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.chains")
    parser.add_argument("--links", type=int, nargs="+", default=[2, 10, 20, 100])
    parser.add_argument("--rounds", type=int, default=7)
    asked = parser.parse_args()
    if mujoco_chain(1) is None:
        raise SystemExit("MuJoCo is not installed: pip install '.[peers]'")
    with machine.alone():
        print(machine.line(machine.describe(["numpy", "mujoco"])))
        print("links   rb_sim us   MuJoCo us   ratio")
        for links in asked.links:
            simulation = Simulation(scene_from_mapping(chain(links)))
            simulation.advance(1e-3)
            own, other = float("inf"), float("inf")
            for _ in range(asked.rounds):
                own = min(own, own_step(simulation))
                other = min(other, mujoco_chain(links) or other)
            print(f"{links:5d} {own:11.2f} {other:11.2f} {own / other:7.2f}", flush=True)


if __name__ == "__main__":
    main()
