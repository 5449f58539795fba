# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""List the loops that are shipped: loops.json, which the compiler reads when the package is built.

    python -m tools.loops           write the list
    python -m tools.loops --check   exit 1 if it is not that of these sources

Loops that C calls know the kinds of their arguments. Those that Python calls are compiled for what
they are called with: every shipped scene is run a little by each method, some go together in
lanes, and messages of one are packed.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import pkgutil
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

import rb_sim
from rb_sim import RbSimError, Simulation
from rb_sim.compiler import program, ship
from rb_sim.compiler.program import words_of
from rb_sim.io.messages.topics import TopicTable
from rb_sim.mechanics.methods import METHODS
from rb_sim.scene.load import load_scene
from rb_sim.sweeps.batch import LaneRunner
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.sweeps.plan import load_plan, points

CONFIG = Path(__file__).resolve().parents[1] / "config"
STEPPING = "time_stepping"
PUSH = {"type": "commanded_wrench"}
"""An effect whose law the loops call by its address."""
PLAN = {
    "scene": "heavy_top",
    "vary": {"spin": {"path": "bodies.top.angular_velocity[1]", "uniform": [20.0, 150.0]}},
    "draws": 32,
    "outputs": {"energy": "mean(energy)"},
}
LANES: tuple[dict[str, Any], ...] = (
    {"method": "rk4", "step": 0.003},
    {"method": "dopri853", "tolerance": 1e-6},
)
SPAN = 0.02
"""Simulated time of a run [s]; what it calls, it calls at its start."""


def import_all() -> None:
    """Import every module that can be imported here; optional libraries may be absent."""
    for module in pkgutil.walk_packages(rb_sim.__path__, f"{rb_sim.__name__}."):
        if not module.name.endswith("__main__"):
            with contextlib.suppress(ImportError):
                importlib.import_module(module.name)


def scenes() -> Iterator[tuple[Any, str]]:
    """(scene, method): all shipped scenes by each; stacks of hard cases, where solvers differ."""
    for path in sorted(CONFIG.glob("*.yaml")):
        if "bodies" in (content := yaml.safe_load(path.read_text(encoding="utf-8"))):
            yield from ((content, method) for method in METHODS)
    for path in sorted((CONFIG / "hard_cases").glob("*.yaml")):
        scene = yaml.safe_load(path.read_text(encoding="utf-8"))["scene"]
        if isinstance(scene, dict):
            yield scene, STEPPING
            scene["effects"] = {
                **scene.get("effects", {}),
                "pushed": PUSH | {"body": [*scene["bodies"]][0]},
            }
            yield scene, STEPPING


def run_all() -> None:
    """Call the loops as users' runs do."""
    warnings.simplefilter("ignore")
    for scene, method in scenes():
        with contextlib.suppress(RbSimError, ZeroDivisionError):
            Simulation(load_scene(scene, method=method), announce=None).run(SPAN)
    for simulation in LANES:
        plan = load_plan({**PLAN, "simulation": {"duration": SPAN, "rate": 100.0, **simulation}})
        values = points(plan.plan)
        rows = [dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True)]
        LaneRunner(PlanRunner(plan, rows[:2])).rows(rows)
    commanded = Simulation(load_scene(CONFIG / "rolling_sphere_commanded.yaml"), announce=None)
    TopicTable(commanded.scene, commanded.layout).warm(commanded.layout)


def found() -> list[list[Any]]:
    """The list, as of the functions that are imported and of what has called them."""
    rows = []
    for owner in program.PROGRAMS:
        name = [owner.function.__module__, owner.function.__qualname__]
        if "<locals>" in name[1] or not name[0].startswith(f"{rb_sim.__name__}."):
            continue
        if isinstance(owner, program.ForC):
            rows.append([*name, None])
        else:
            rows += [[*name, [words_of(kind) for kind in kinds]] for kinds in owner.called_with]
    return sorted(rows, key=json.dumps)


def main() -> int:
    """Write or check the list."""
    parser = argparse.ArgumentParser(prog="python -m tools.loops")
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    import_all()
    run_all()
    rows = found()
    text = "[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n"
    if check:
        same = ship.LIST.exists() and ship.LIST.read_text(encoding="utf-8") == text
        print(
            "" if same else f"{ship.LIST.name} is not that of these sources: python -m tools.loops"
        )
        return 0 if same else 1
    ship.LIST.write_text(text, encoding="utf-8")
    print(f"{len(rows)} loops in {ship.LIST}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
