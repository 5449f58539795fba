# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start and RK4 step from one body to many, beside MuJoCo's RK4 and another revision, in one run.

    python -m benchmarks.sizes [--against REV] [--most LINKS] [--out FILE.json]

Given are CPU times: from starting Python to the first step with the loops on disk, once with the
laws to be compiled (cold) and once with them on disk (warm); the RK4 step, samples left out, with
the way back to the manifold; the same step of MuJoCo on the same chain; and of the revision REV
where it can run the scene within TOO_LONG.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

from benchmarks import machine
from benchmarks.against_revision import checked_out
from benchmarks.many_body_scenes import chain, lattice, on_springs, rods, star
from benchmarks.start_time import to_first_step

CHAINS = (2, 10, 20, 100)
TOO_LONG = 300.0
"""[s] of wall time that a tree may take for one scene."""
SPAN = 1.0
"""Simulated time of one measurement [s]."""

MEASURE = """
import sys, time
from rb_sim import Simulation, load_scene
simulation = Simulation(load_scene(sys.argv[1], method="rk4", step=1e-3))
span = float(sys.argv[2])
simulation.advance(1e-3)
best = float("inf")
for _ in range(7):
    simulation.reset()
    begin = time.process_time()
    simulation.advance(span)
    best = min(best, time.process_time() - begin)
print(1e6 * best / simulation.steps)
"""


def cases(most: int) -> dict[str, dict[str, Any] | str]:
    """Scenes by name: shipped ones by theirs, others as mappings."""
    shipped = {name: name for name in ("free_tumble", "heavy_top", "pendulum", "rolling_disk")}
    chains = {f"chain of {n}": chain(n) for n in CHAINS if n <= most}
    springs = {f"{n} springs": on_springs(n) for n in (16, 64)}
    hubs = {"star of 16": star(16), "rods 10 x 10": rods(10), "lattice 10 x 10": lattice(10)}
    return {**shipped, **chains, **springs, **hubs}


def written(scene: dict[str, Any] | str, folder: Path, name: str) -> str:
    """The scene as a file that every revision can read."""
    if isinstance(scene, str):
        return str(Path(__file__).resolve().parents[1] / "config" / f"{scene}.yaml")
    path = folder / f"{name.replace(' ', '_')}.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    return str(path)


def microseconds(scene: str, tree: Path, cache: Path, span: float) -> float | str:
    """One RK4 step of the tree's rb_sim [us], or why there is none."""
    environment = {**os.environ, "RB_SIM_CACHE": str(cache), "PYTHONPATH": str(tree)}
    command = [sys.executable, "-c", MEASURE, scene, str(span)]
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=TOO_LONG
        )
    except subprocess.TimeoutExpired:
        return f"more than {TOO_LONG:g} s"
    if done.returncode != 0:
        return done.stderr.strip().splitlines()[-1].split(":")[0]
    return float(done.stdout)


def mujoco_chain(links: int, step: float = 1e-3, count: int = 200) -> float | None:
    """One RK4 step of MuJoCo on the same chain [us]; None where MuJoCo is not installed."""
    try:
        import mujoco
    except ImportError:
        return None
    text = ""
    for i in reversed(range(links)):
        place = "0 0 0" if i == 0 else "1 0 0"
        text = (
            f'<body pos="{place}"><joint type="ball"/><inertial pos="0.5 0 0" mass="1" '
            f'diaginertia="0.01 0.09 0.08"/>{text}</body>'
        )
    option = f'<option timestep="{step}" gravity="0 1 -9.81" integrator="RK4"/>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco>{option}<worldbody>{text}</worldbody></mujoco>"
    )
    data, best = mujoco.MjData(model), float("inf")
    for _ in range(7):
        mujoco.mj_resetData(model, data)
        begin = time.process_time()
        mujoco.mj_step(model, data, count)
        best = min(best, time.process_time() - begin)
    return 1e6 * best / count


def measured(most: int, folder: Path, old: Path | None) -> dict[str, dict[str, Any]]:
    """Every figure of every case."""
    cache, tree = folder / "cache", Path(__file__).resolve().parents[1]
    environment = {**os.environ, "RB_SIM_CACHE": str(cache)}
    for method in ("rk4", "dopri853"):  # the loops, once for all
        to_first_step(written(on_springs(1, method=method), folder, method), environment)
    table: dict[str, dict[str, Any]] = {}
    for name, scene in cases(most).items():
        path = written(scene, folder, name)
        row: dict[str, Any] = {
            "cold start": to_first_step(path, environment).cpu,
            "warm start": to_first_step(path, environment).cpu,
        }
        row["step"] = microseconds(path, tree, cache, SPAN)
        if name.startswith("chain"):
            row["MuJoCo"] = mujoco_chain(int(name.split()[-1]))
        if old is not None:
            row["old"] = microseconds(path, old, folder / "old cache", SPAN)
        table[name] = row
        print(line(name, row), flush=True)
    return table


def line(name: str, row: dict[str, Any]) -> str:
    """One row as text: seconds of CPU, microseconds per step."""
    parts = [f"{key} {row[key]:.2f} s" for key in ("cold start", "warm start")]
    for key in ("step", "MuJoCo", "old"):
        value = row.get(key)
        if value is not None:
            parts.append(f"{key} {value:.3g} us" if isinstance(value, float) else f"{key} {value}")
    return f"{name:16} {', '.join(parts)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", metavar="REV", help="a revision to measure as well")
    parser.add_argument("--most", type=int, default=max(CHAINS), help="links of the longest chain")
    parser.add_argument("--out", type=Path, help="a JSON file to write")
    asked = parser.parse_args()
    with machine.alone(), tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if asked.against is None:
            table = measured(asked.most, folder, None)
        else:
            with checked_out(asked.against, folder / "old") as old:
                table = measured(asked.most, folder, old)
    if asked.out is not None:
        asked.out.write_text(json.dumps(table, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
