# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""python -m benchmarks.peers [--scenes ...] [--engines ...] [--out DIR] [--budget SECONDS]."""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks import machine
from benchmarks.peers import engine, scenes
from benchmarks.peers.measure import in_child, silent
from benchmarks.peers.plot import plot
from benchmarks.peers.report import markdown, ratios

PACKAGES = ("numpy", "scipy", "llvmlite")


def main() -> int:
    """Measure, and write peers.md, peers.json and one plot per scene."""
    options = _options()
    found, skipped = _load(options.engines)
    if not found:
        print("no engine is installed: nothing to measure", file=sys.stderr)
        return 1
    options.out.mkdir(parents=True, exist_ok=True)
    with machine.alone():
        results = _measure(found, skipped, options.scenes, options.budget)
    results["ratios"] = ratios(results)
    (options.out / "peers.json").write_text(json.dumps(results, indent=1), encoding="utf-8")
    text = markdown(results)
    (options.out / "peers.md").write_text(text, encoding="utf-8")
    for name, entry in results["scenes"].items():
        title = results["machine_line"]
        plot(name, entry, results["kinds"], title, options.out / f"{name}.png")
    print(text)
    print(f"written: {options.out}/peers.md, peers.json and {len(results['scenes'])} plots")
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--scenes", nargs="+", choices=scenes.NAMES, default=scenes.NAMES)
    parser.add_argument("--engines", nargs="+", choices=engine.ENGINES, default=engine.ENGINES)
    parser.add_argument("--out", type=Path, default=Path("out/peers"))
    parser.add_argument(
        "--budget", type=float, default=1200.0, help="CPU seconds for the whole run"
    )
    return parser.parse_args()


def _load(names: list[str]) -> tuple[dict[str, ModuleType], list[str]]:
    """Adapters whose engine is installed, and the names of the others."""
    found, skipped = {}, []
    for name in names:
        try:
            with silent():
                found[name] = importlib.import_module(f"benchmarks.peers.engine_{name}")
        except ImportError as problem:
            skipped.append(name)
            print(f"skipped {name}: not installed ({problem})", file=sys.stderr)
    return found, skipped


def _measure(
    found: dict[str, ModuleType], skipped: list[str], names: list[str], budget: float
) -> dict[str, Any]:
    share = budget / (len(names) * len(found))
    about = machine.describe([*PACKAGES, *(module.PACKAGE for module in found.values())])
    results: dict[str, Any] = {
        "machine": about,
        "machine_line": machine.line(about),
        "kinds": {name: module.KIND for name, module in found.items()},
        "skipped": skipped,
        "scenes": {},
    }
    for name in names:
        entry: dict[str, Any] = {"duration": scenes.load(name).duration, "engines": {}}
        for who in found:
            points, notes = in_child(name, who, share)
            rows = [point._asdict() for point in points]
            for row in rows:
                row["error"] = row["error"] if math.isfinite(row["error"]) else None
            entry["engines"][who] = {"points": rows, "notes": notes}
            print(f"{name}: {who}: {len(points)} points", file=sys.stderr, flush=True)
        results["scenes"][name] = entry
    about["load_after"] = machine.describe()["load"]
    return results


if __name__ == "__main__":
    sys.exit(main())
