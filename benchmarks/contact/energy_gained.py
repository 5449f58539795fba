# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Energy that contacts gain in time stepping: `python -m benchmarks.contact.energy_gained`.

The random tosses of `benchmarks.contact.tosses` by `time_stepping` at a fixed step; of each the
energy that its contacts made, relative to the energy exchanged, as the check `contact steps`
has it. What cannot be run (pairs that do not touch) is counted, not judged.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from benchmarks.contact.toss_scenes import SUPPORTS, toss
from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError

BOUNDS = (1e-4, 1e-3, 1e-2)
"""Relative gains; the last is the limit of the check."""


def gain(seed: int, number: int, step: float, supports: Sequence[str] = SUPPORTS) -> float | None:
    """Of one toss; None if it is refused."""
    mapping = toss(seed, number, supports=supports).mapping
    mapping["simulation"] |= {"method": "time_stepping", "step": step, "rate": 1.0 / step}
    try:
        simulation = Simulation(load_scene(mapping), announce=None)
        run = simulation.run(checks=False)
    except RbSimError:
        return None
    block, potential = run.block, run.block.potential_energy
    exchanged = block.kinetic_energy[0] + potential[0] - potential.min()
    exchanged += np.abs(block.contact_work).max()
    return float(simulation.made_energy / exchanged)


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--step", type=float, default=1e-2, help="[s]")
    parser.add_argument("--supports", nargs="+", default=SUPPORTS, choices=SUPPORTS)
    options = parser.parse_args()
    gains = [
        gain(options.seed, number, options.step, options.supports)
        for number in range(options.count)
    ]
    run = [value for value in gains if value is not None]
    print(f"{len(run)} of {options.count} tosses run, step {options.step:g} s, seed {options.seed}")
    for bound in BOUNDS:
        print(f"gain above {bound:g}: {sum(value > bound for value in run)}")
    print(f"largest gain: {max(run, default=0.0):.2g}")


if __name__ == "__main__":
    main()
