# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""You pay only for what a scene names: what a free body costs beside a catalogue of any size.

    python benchmarks/pay_for_use.py

A free body is compiled and timed in processes of their own whose catalogue holds 1, 5, the shipped
number, and 50 kinds of effects; the rounds of the processes are interleaved.  Then the reactions
of a body on a fixed point are taken out of its sample, and the sinks out of a run.  Each difference
is to be below the noise, which is what two identical processes differ by.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import namedtuple
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
STEPS = 20_000
SPELLS, ROUNDS = 5, 12
FREE = {
    "bodies": {
        "nut": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0], "angular_velocity": [0.01, 2, 0.01]}
    },
    "simulation": {"duration": 20.0, "method": "rk4", "step": 1e-3},
}
TOP = {
    "bodies": {
        "top": {
            "mass": 15.0,
            "inertia": [0.234375, 0.46875, 0.234375],
            "center_of_mass": [0.0, 1.0, 0.0],
            "angular_velocity": [0.0, 150.0, -4.6],
        }
    },
    "constraints": {"tip": {"type": "fixed_point", "body": "top"}},
    "simulation": {"duration": 2.0, "method": "rk4", "step": 1e-4},
}


def strip(keep: int) -> None:
    """Leave the first `keep` effects in the catalogue, and no kernel of any other."""
    from rb_sim.catalogue import effects
    from rb_sim.catalogue.spec import potential, wrench

    for name in list(effects.SPECS)[keep:]:
        del effects.SPECS[name]
    homes = {spec.__module__ for spec in effects.SPECS.values()}
    for table in (wrench.kernels, potential.kernels):
        for row in list(table):
            if row.__module__ not in homes:
                del table[row]


def add_synthetic(count: int) -> None:
    """Register `count` more kinds, each with a row class, a spec and a kernel of its own."""
    from rb_sim.catalogue import effects
    from rb_sim.catalogue.spec import Spec, wrench

    for i in range(count):
        source = (
            f"def kernel(row, t, body, B, A):\n"
            f"    s = {i + 1}.0 * row.strength\n"
            f"    return (s * B.v_WC[0], s, t), (s * B.w_WB_B[1], s, s)\n"
        )
        space: dict[str, Any] = {}
        exec(source, space)
        row = namedtuple(f"Synthetic{i}Row", ["strength"])
        wrench.register(row)(space["kernel"])
        effects.SPECS[f"synthetic_{i}"] = type(f"Synthetic{i}", (Spec,), {})


def without_reactions() -> None:
    """Let the sample of a body on a fixed point report no reaction."""
    from rb_sim.mechanics import system
    from rb_sim.mechanics.systems import fixed_point

    @system.sample.register(fixed_point.FixedPointBody)
    def sample(system, t, y, out):
        out[0] = y[0]


def child(kinds: int, what: str) -> None:
    """Compile one scene, then answer each line of input with the ns per step of one round."""
    from rb_sim.catalogue import effects

    shipped = len(effects.SPECS)
    strip(kinds)
    add_synthetic(kinds - shipped)
    if what == "top without reactions":
        without_reactions()
    from rb_sim.accuracy.costs import nanoseconds
    from rb_sim.motion.traced import TracedMotion
    from rb_sim.scene.compile import compile_method, compile_scene
    from rb_sim.scene.load import scene_from_mapping

    scene = scene_from_mapping(FREE if what == "free" else TOP)
    options = scene.simulation
    with listings() as laws:
        motion = TracedMotion(compile_scene(scene), compile_method(options, options.duration))
        motion.warm()
    print(json.dumps({"kinds": len(effects.SPECS), "code": mnemonics(laws)}), flush=True)
    for _ in sys.stdin:
        assert options.step is not None
        best = min(nanoseconds(motion, options.step, STEPS) for _ in range(SPELLS))
        print(best, flush=True)


@contextmanager
def listings() -> Iterator[list[str]]:
    """Inside, the assembly of every law that is not on disk is added to the list."""
    from rb_sim.compiler.graph import machine

    found: list[str] = []
    usual = machine.assembled

    def listed(module: Any, level: int) -> bytes:
        found.append(machine.target_machine(level).emit_assembly(module))
        return usual(module, level)

    machine.assembled = listed
    try:
        yield found
    finally:
        machine.assembled = usual


def mnemonics(laws: list[str]) -> dict[str, int]:
    """How often each machine instruction occurs in the laws."""
    counts: dict[str, int] = {}
    for listing in laws:
        for line in listing.splitlines():
            word = line.split()[0] if line.startswith("\t") and line.split() else "."
            if not word.startswith((".", "#")):
                counts[word] = counts.get(word, 0) + 1
    return counts


class Process:
    """A child that compiles afresh, in a cache of its own."""

    def __init__(self, name: str, kinds: int, what: str, folder: Path) -> None:
        self.name = name
        paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path for path in paths if path),
            "RB_SIM_CACHE": str(folder / name.replace(" ", "_")),
        }
        command = [sys.executable, str(Path(__file__).resolve()), "--child", str(kinds), what]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self.figures: list[float] = []

    def first(self) -> dict[str, Any]:
        """What the child says once it has compiled."""
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def round(self) -> None:
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write("go\n")
        self.process.stdin.flush()
        self.figures.append(float(self.process.stdout.readline()))

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def compare(cases: list[tuple[str, int, str]]) -> dict[str, dict[str, Any]]:
    """ns per step of every case, rounds interleaved, and its machine code."""
    with tempfile.TemporaryDirectory() as folder:
        processes = [Process(name, kinds, what, Path(folder)) for name, kinds, what in cases]
        try:
            said = [process.first() for process in processes]
            for _ in range(ROUNDS):
                for process in processes:
                    process.round()
        finally:
            for process in processes:
                process.close()
    results = {}
    for process, first in zip(processes, said, strict=True):
        figures = np.array(process.figures) / np.array(processes[0].figures)
        low, middle, high = np.percentile(figures, [25.0, 50.0, 75.0])
        results[process.name] = {
            "kinds": first["kinds"],
            "nanoseconds": float(np.median(process.figures)),
            "ratio": float(middle),
            "spread": float(0.5 * (high - low)),
            "instructions": sum(first["code"].values()),
            "code": first["code"],
        }
    return results


def cost_of_sinks() -> tuple[float, float, float]:
    """CPU time of a run without any sink [s], twice, and of its blocks without Simulation.run."""
    from rb_sim import Simulation
    from rb_sim.scene.load import scene_from_mapping

    simulation = Simulation(scene_from_mapping(FREE))
    simulation.warm()
    duration, rate = 2.0, 100.0

    def with_run() -> None:
        simulation.run(duration, rate, checks=False)

    def by_blocks() -> None:
        for _ in simulation.blocks(duration, rate):
            pass

    times: dict[Any, list[float]] = {}
    for _ in range(80):
        for name, act in (("a", with_run), ("b", with_run), ("c", by_blocks)):
            simulation.reset()
            start = time.process_time()
            act()
            times.setdefault(name, []).append(time.process_time() - start)
    a, b, c = (min(times[name]) for name in "abc")
    return a, b, c


def main() -> None:
    from rb_sim.catalogue.effects import SPECS

    shipped = len(SPECS)
    free = compare(
        [
            ("shipped", shipped, "free"),
            ("shipped again", shipped, "free"),
            ("1 kind", 1, "free"),
            ("5 kinds", 5, "free"),
            ("50 kinds", 50, "free"),
        ]
    )
    top = compare(
        [
            ("top", shipped, "top"),
            ("top again", shipped, "top"),
            ("top without reactions", shipped, "top without reactions"),
        ]
    )
    print(f"{'catalogue':24}{'kinds':>6}{'ns/step':>9}{'ratio':>8}{'±':>7}{'instructions':>14}")
    for name, row in {**free, **top}.items():
        print(
            f"{name:24}{row['kinds']:6}{row['nanoseconds']:9.1f}{row['ratio']:8.3f}"
            f"{row['spread']:7.3f}{row['instructions']:14}"
        )
    same = all(row["code"] == free["shipped"]["code"] for row in free.values())
    noise = max(abs(free["shipped again"]["ratio"] - 1.0), free["shipped again"]["spread"])
    per_kind = (free["50 kinds"]["ratio"] - free["5 kinds"]["ratio"]) / 45.0
    print(f"machine code of the free body the same in all catalogues: {'yes' if same else 'NO'}")
    print(f"an absent kind costs {100 * per_kind:+.3f} % of a step; noise {100 * noise:.1f} %")
    a, b, c = cost_of_sinks()
    print(
        f"run without sinks over its blocks alone: {100 * (a / c - 1):+.1f} %; "
        f"noise {100 * abs(a / b - 1):.1f} %"
    )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(int(sys.argv[2]), sys.argv[3])
    else:
        sys.path.insert(0, str(ROOT))
        main()
