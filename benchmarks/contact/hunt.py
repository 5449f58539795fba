# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random scenes with contacts, judged by invariants: `python -m benchmarks.contact.hunt`.

Each scene follows from the seed and its number alone (`--show N` writes one, as JSON, which is
YAML).  A run is fine if it keeps to the invariants or is refused in one line; what is neither is
printed.  `--scenes coupled` has others: what touches is held, pulled or driven as well; `joined`:
what they touch is carried, or part of a loop.  A run that is sampled a hundred times less often has
to come to the same place.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from typing import Any

import numpy as np

from benchmarks.contact.coupled_scenes import coupled_scene
from benchmarks.contact.invariants import broken
from benchmarks.contact.joined_scenes import joined_scene
from benchmarks.contact.random_scenes import random_scene
from benchmarks.contact.toss_verdicts import apart, run

SCENES = {"random": random_scene, "coupled": coupled_scene, "joined": joined_scene}
SELDOM = 0.01
"""Samples of the second run, over those of the first."""


def judged(mapping: dict[str, Any]) -> str:
    """What became of a scene: "fine", or what is wrong with it."""
    found = run(mapping, commanded)
    if isinstance(found, str):
        return found
    problems = broken(mapping, found) + seldom(mapping, found)
    return f"broken: {'; '.join(problems)}" if problems else "fine"


def commanded(simulation: Any) -> Any:
    """The whole run; where a body is commanded, a new load every twentieth of it."""
    from rb_sim.mechanics.samples import concatenate
    from rb_sim.simulation.trajectory import Trajectory

    bodies = simulation.layout.commanded
    if not bodies:
        return simulation.run()
    rng, runs = np.random.default_rng(0), []
    for _ in range(20):
        force, torque = rng.normal(0.0, 4.0, 3).tolist(), rng.normal(0.0, 0.1, 3).tolist()
        simulation.apply_wrench(bodies[0], force, torque)
        runs.append(simulation.run(duration=simulation.scene.simulation.duration / 20))
    block = concatenate([one.block for one in runs], simulation.layout)
    reported = [finding for one in runs for finding in one.findings]
    return Trajectory(block, simulation.layout, findings=reported)


def seldom(mapping: dict[str, Any], often: Any) -> list[str]:
    """Where a run with few samples ends elsewhere."""
    own = mapping["simulation"]
    if own.get("method") == "time_stepping" or often.layout.commanded:
        return []
    rate = own.get("rate", len(often.t) / often.t[-1])
    rarely = mapping | {"simulation": own | {"rate": rate * SELDOM}}
    again = run(rarely, lambda simulation: simulation.run(checks=False))
    if isinstance(again, str):
        return [f"with few samples {again}"]
    apart = np.abs(again.block.position[-1] - often.block.position[-1]).max()
    return [f"with few samples the end is {apart:.2g} m away"] if apart > 0.0 else []


def warm(mapping: dict[str, Any]) -> None:
    """Compile the loops before processes part from this one."""
    run(mapping | {"simulation": mapping["simulation"] | {"duration": 1e-3}})


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--scenes", choices=SCENES, default="random")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=20.0, help="CPU time that one may take")
    parser.add_argument("--refused", action="store_true", help="print what is refused, too")
    parser.add_argument("--show", type=int, help="only write the scene of this number")
    options = parser.parse_args()
    scene = SCENES[options.scenes]
    if options.show is not None:
        print(json.dumps(scene(options.seed, options.show).mapping, indent=1))
        return
    counts: Counter[str] = Counter()
    warmed: set[bool] = set()
    for number in range(options.first, options.first + options.count):
        mapping, kind = scene(options.seed, number)
        method = mapping["simulation"].get("method", "")
        if (method == "time_stepping") not in warmed:
            warmed.add(method == "time_stepping")
            warm(mapping)
        text = apart(mapping, options.seconds, judged)
        verdict = text.partition(":")[0]
        counts[verdict] += 1
        if verdict not in ("fine", "refused") or (options.refused and verdict == "refused"):
            print(number, kind, method, text, flush=True)
    print(f"seed {options.seed}, {options.first} to {options.first + options.count - 1}:")
    print(", ".join(f"{count} {verdict}" for verdict, count in counts.most_common()))


if __name__ == "__main__":
    main()
