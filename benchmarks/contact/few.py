# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a time step with few contacts costs: `python -m benchmarks.contact.few`.

It prints the CPU time of a step, the least of several runs, and its ratio to that of a table at
rest, whose impulses are those of the step before.
"""

from __future__ import annotations

from typing import Any

from benchmarks.stepping import compiled, nanoseconds
from tests.contact.scenes import box, scene, touch
from tests.contact.stepping.test_least_shares import MU, clamped

STEP = 1e-3
COUNT = 400
"""Steps of a run, in which all that slides goes on sliding."""
HEAD = """\
| scene | step [us] | over a table at rest |
|---|---|---|"""


def table(slip: float, spin: float, height: float = 0.1) -> dict[str, Any]:
    """A table that slides and turns on its four feet."""
    feet = [[x, y, -0.1] for x in (0.3, -0.3) for y in (0.2, -0.2)]
    moves = {"linear_velocity": [slip, 0.0, 0.0], "angular_velocity": [0.0, 0.0, spin]}
    return scene(box([0.6, 0.4, 0.2], [0.0, 0.0, height], **moves), touch(mu=0.2, points=feet))


def tumbling() -> dict[str, Any]:
    """A box that is thrown and rolls over its corners."""
    turn = {"axis": [0.6, 0.8, 0.0], "angle": 0.5}
    moves = {"linear_velocity": [2.0, 0.0, 0.0], "angular_velocity": [1.0, 8.0, 0.0]}
    thrown = box([0.3, 0.2, 0.1], [0.0, 0.0, 0.2], orientation=turn, **moves)
    return scene(thrown, touch(mu=0.4))


def scenes() -> dict[str, dict[str, Any]]:
    """By what they show; the first is the one that others are compared with."""
    friction = {"type": "coulomb", "static": MU}
    return {
        "table at rest": table(0.0, 0.0),
        "sliding table": table(5.0, 0.0),
        "turning table": table(5.0, 5.0),
        "tumbling box": tumbling(),
        "two pads in the world": clamped(1.0, friction, False),
        "gripper on a rail": clamped(1.0, friction, True),
    }


def main() -> None:
    """Print a row for each scene."""
    print(HEAD)
    unit = 0.0
    for name, mapping in scenes().items():
        simulation = compiled(mapping, "time_stepping", STEP)
        found = 1e-3 * nanoseconds(simulation, STEP, COUNT)
        unit = unit or found
        print(f"| {name} | {found:.1f} | {found / unit:.1f} |", flush=True)


if __name__ == "__main__":
    main()
