# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What events cost: `python -m benchmarks.contact.events`.

Each scene is advanced sample by sample at its own rate, as a node does, several times over.  Told
are the CPU time of its costliest sample, of the whole run per simulated second, and how much of it
was in the compiled loop, each the least of the runs; and the instants at which a contact changed.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

SCENES = ("dropped_box", "ball_on_block", "colliding_spheres", "rocking_block", "stick_slip")
HEAD = """\
| scene | costliest sample [ms] | CPU a second [s] | in the loop [s] | instants | in that sample |
|---|---|---|---|---|---|"""


class Timed:
    """A function that adds up the CPU time of its calls."""

    def __init__(self, function: Any) -> None:
        self.function, self.seconds = function, 0.0

    def __call__(self, *arguments: Any) -> Any:
        began = time.process_time()
        found = self.function(*arguments)
        self.seconds += time.process_time() - began
        return found


def run(name: str) -> tuple[float, float, float, int, int]:
    """CPU seconds of the costliest sample, of a simulated second, and of that in the loop; instants
    of changes in the run, and in that sample."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.events import event_motion

    scene = load_scene(name)
    interval, duration = 1.0 / scene.simulation.rate, scene.simulation.duration
    simulation = Simulation(scene)
    simulation.warm()
    loop = Timed(event_motion.record_contacts)
    event_motion.record_contacts = loop  # type: ignore[assignment]
    costs, reported = np.empty(round(duration / interval)), [len(simulation.events)]
    try:
        for i in range(len(costs)):
            began = time.process_time()
            simulation.advance(interval)
            costs[i] = time.process_time() - began
            reported.append(len(simulation.events))
    finally:
        event_motion.record_contacts = loop.function
    i, events = int(costs.argmax()), simulation.events
    everywhere, here = (
        {e.t for e in some} for some in (events, events[reported[i] : reported[i + 1]])
    )
    worst, second = float(costs[i]), float(costs.sum()) / duration
    return worst, second, loop.seconds / duration, len(everywhere), len(here)


def main() -> None:
    parser = argparse.ArgumentParser(description="What events of contacts cost")
    parser.add_argument("--scenes", nargs="*", default=SCENES)
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    print(HEAD)
    for name in options.scenes:
        runs = [run(name) for _ in range(options.runs)]
        worst, second, loop = (min(one[k] for one in runs) for k in range(3))
        print(f"| {name} | {1e3 * worst:.2f} | {second:.3f} | {loop:.3f} | ", end="")
        print(f"{runs[0][3]} | {runs[0][4]} |", flush=True)


if __name__ == "__main__":
    main()
