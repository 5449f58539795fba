# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Nanoseconds per step of the rb_sim in the current folder, on request: one end of a pipe.

Run as a program it answers each line {"scene": path, "method": name, "step": s, "count": n} with
{"ns": nanoseconds of CPU time per step}; the first request for a scene compiles it.  It needs only
what every revision of rb_sim has had.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any, TextIO

REPEATS = 3
"""Runs of one measurement; the fastest counts."""


def compiled(scene: Any, method: str, step: float) -> Any:
    """The simulation of a scene, file or mapping, in fixed steps [s], compiled."""
    from rb_sim import Simulation, load_scene  # the revision's own

    simulation = Simulation(load_scene(scene, method=method, step=step))
    simulation.advance(2.0 * step)
    return simulation


def nanoseconds(simulation: Any, step: float, count: int) -> float:
    """CPU time of one of `count` steps from the start, the best of REPEATS [ns]."""
    best = float("inf")
    for _ in range(REPEATS):
        simulation.reset()
        begin = time.process_time()
        simulation.advance(count * step)
        best = min(best, time.process_time() - begin)
    return 1e9 * best / count


def answer(requests: TextIO, answers: TextIO) -> None:
    """Measure what each line asks for until there is none."""
    known: dict[tuple[str, str, float], Any] = {}
    for line in requests:
        asked = json.loads(line)
        key = asked["scene"], asked["method"], asked["step"]
        if key not in known:
            known[key] = compiled(*key)
        answers.write(json.dumps({"ns": nanoseconds(known[key], key[2], asked["count"])}) + "\n")
        answers.flush()


if __name__ == "__main__":
    answer(sys.stdin, sys.stdout)
