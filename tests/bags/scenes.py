# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs that leave a bag, for tests: interpreted, so that they start at once."""

from __future__ import annotations

from pathlib import Path

PUSHED = """\
description: a box pushed by commands
bodies:
  box:
    mass: 2.0
    shape: {type: box, size: [0.3, 0.2, 0.1]}
    orientation: {axis: [0, 0, 1], angle: 1.5707963267948966}
    angular_velocity: [0.3, 2.0, 0.1]
effects:
  weight: {type: gravity}
  drive: {type: commanded_wrench, body: box}
simulation: {duration: 1.0, method: rk4, step: 5.0e-3, rate: 50}
"""


def record_run(text: str, folder: Path, **overrides) -> Path:
    """`rb_sim run` without its summary: the bag of a scene."""
    from rb_sim import Simulation, load_scene
    from rb_sim.io.bag.bag_sink import BagSink

    simulation = Simulation(load_scene(text, **overrides))
    sink = BagSink(folder, run={"by": "run", "options": overrides})
    options = simulation.scene.simulation
    sink.open(simulation.scene, simulation.layout)
    for block in simulation.blocks(options.duration, options.rate):
        sink.write(block)
    sink.close({"outcome": "finished"})
    return folder


class Commander:
    """Stands for the node's inbox: what to do before which step."""

    def __init__(self, plan: dict[int, list]) -> None:
        self.plan, self.step = plan, 0

    def apply(self, simulation, t: float, timeout: float) -> None:
        for entry in self.plan.get(self.step, ()):
            simulation.apply_wrench("box", *entry)
        self.step += 1

    def forget(self) -> None:
        """Nothing waits."""


PLAN = {
    3: [((4.0, 0.0, 1.0), (0.0, 0.2, 0.0), "body")],
    20: [((0.0, 1.0, 0.0), (0.0, 0.0, 0.3), "world")],
    30: [((0.1, 0.2, 0.3), (0.01, 0.0, 0.0), "body")],
}


def record_node(folder: Path, steps: int = 60, reset_at: int = 40) -> Path:
    """The node's own stepper with commands in both frames and a reset, without ROS around it."""
    from rb_sim import Simulation, load_scene
    from rb_sim.io.bag.bag_sink import BagSink
    from rb_sim.mechanics.samples import concatenate
    from rb_sim.ros.stepper import Stepper

    class Batching(BagSink):
        """Writes many samples at once, as a log beside a node does."""

        waiting: list = []

        def write(self, block):
            self.waiting = [*self.waiting, block]
            if len(self.waiting) == 7:
                self.flush()

        def flush(self):
            BagSink.write(self, concatenate(self.waiting, simulation.layout))
            self.waiting = []

    simulation = Simulation(load_scene(PUSHED))
    settings = {"by": "node", "wrench_timeout": 0.0}
    sink = Batching(folder, run=settings, namespace="/sim", chunk_size=8000)
    sink.open(simulation.scene, simulation.layout)
    stepper = Stepper(simulation, Commander(PLAN), [sink], 50.0)  # type: ignore[arg-type]
    stepper.emit()
    for k in range(steps):
        if k == reset_at:
            stepper.reset()  # a sample of its own
        else:
            stepper.step(0.0)
    if sink.waiting:
        sink.flush()
    sink.close({"commands_applied": 3, "commands_refused": {"not finite": 2}, "samples_dropped": 7})
    return folder
