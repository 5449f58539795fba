# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The same random scenes at many settings: `python -m benchmarks.contact.settings`.

The places and attitudes of all bodies are compared with those of a run at a tolerance of 1e-12.
A run is right if it stays within what its setting promises, told if a check spoke, refused if it
ended in one line.  What is neither is silent, and printed.  Where that run itself and one at 1e-11
part by more than OPEN the motion magnifies errors without bound, or the laws leave it open: no
setting is judged there.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import warnings
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.contact.hunt import SCENES, commanded, warm
from benchmarks.contact.toss_verdicts import apart, run

Options = dict[str, Any]
REFERENCE: Options = {"method": "dopri853", "tolerance": 1e-12}
SECOND: Options = {"method": "dopri853", "tolerance": 1e-11}
SETTINGS: dict[str, Options] = {
    "default": {},
    "1e-4": {"tolerance": 1e-4},
    "1e-6": {"tolerance": 1e-6},
    "1e-8": {"tolerance": 1e-8},
    "gauss6 2e-3": {"method": "gauss6", "step": 2e-3},
    "rk4 1e-3": {"method": "rk4", "step": 1e-3},
    "rk4 3e-3": {"method": "rk4", "step": 3e-3},
    "rk4 1e-2": {"method": "rk4", "step": 1e-2},
}
DEFAULT_TOLERANCE = 1e-10
OPEN = 1e-7
"""Share of the motion by which the two sharpest runs may part."""
FIXED = 1e-2
"""Share of the motion by which a fixed step may err without a word, and at most any tolerance."""
GROWN = 1e4
"""Tolerances, as shares of the motion, that steps and bounces may add up to."""
RATE = 200.0
"""Of the samples [Hz]."""


def with_options(mapping: Options, options: Options) -> Options:
    """The scene, integrated so; what it says of impacts and of its start stays."""
    own = {k: v for k, v in mapping["simulation"].items() if k not in ("method", "step")}
    own.pop("tolerance", None)
    return mapping | {"simulation": own | {"rate": RATE} | options}


def allowed(options: Options) -> float:
    """Share of the motion that is no error."""
    if "step" in options:
        return FIXED
    return min(FIXED, GROWN * options.get("tolerance", DEFAULT_TOLERANCE))


def error_of(found: Any, reference: Any) -> float:
    """Largest distance of places over the largest way, and of turns over what is turned in all."""
    p, q = reference["position"], reference["orientation"]
    way = max(float(np.linalg.norm(p - p[0], axis=2).max()), 1e-9)
    spin = np.linalg.norm(reference["angular_velocity"], axis=2).max(axis=0)
    worst = float(np.linalg.norm(found.position - p, axis=2).max()) / way
    for i in range(p.shape[1]):
        turn = Rotation.from_quat(q[:, i]).inv() * Rotation.from_quat(found.orientation[:, i])
        turned = max(1.0, float(spin[i]) * float(reference["t"][-1]))
        worst = max(worst, float(turn.magnitude().max()) / turned)
    return worst


def moved(mapping: Options, file: Path, beside: bool) -> str:
    """Run; without a motion beside it keep it in the file, else compare: JSON of (error, told)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = run(mapping, commanded)
    if isinstance(found, str):
        return found
    if not beside:
        block = found.block
        kept = {"t": block.t, "position": block.position, "orientation": block.orientation}
        np.savez(file, **kept, angular_velocity=block.angular_velocity)
        return "fine"
    with np.load(file) as reference:
        error = error_of(found.block, reference)
    return "error: " + json.dumps([error, [f.check for f in found.findings]])


def verdict(text: str, options: Options) -> tuple[str, str]:
    """(verdict, what there is to say)."""
    kind, _, detail = text.partition(": ")
    if kind != "error":
        return kind, detail
    error, check_list = json.loads(detail)
    if error <= allowed(options):
        return (
            "false alarm" if check_list and error <= 0.01 * allowed(options) else "right"
        ), detail
    return ("told" if check_list else "silent"), detail


def judged(mapping: Options, names: list[str], seconds: float, folder: Path) -> dict[str, Any]:
    """Of each setting its verdict; or of the reference, why there is none."""
    file = folder / "reference.npz"

    def runs(options: Options, beside: bool = True) -> str:
        return apart(with_options(mapping, options), seconds, lambda m: moved(m, file, beside))

    text = runs(REFERENCE, beside=False)
    if text != "fine":
        return {"reference": ("no reference", text)}
    kind, detail = verdict(runs(SECOND), SECOND)
    error = (
        json.loads(detail)[0] if kind in ("right", "told", "silent", "false alarm") else math.inf
    )
    if error > OPEN:
        return {"reference": ("open", f"{error:.2g}" if error < math.inf else f"{kind}: {detail}")}
    return {name: verdict(runs(SETTINGS[name]), SETTINGS[name]) for name in names}


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--scenes", choices=SCENES, default="random")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=20.0, help="CPU time that one may take")
    parser.add_argument("--settings", nargs="+", default=list(SETTINGS), choices=SETTINGS)
    parser.add_argument("--all", action="store_true", help="print every verdict")
    options = parser.parse_args()
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    warm(with_options(SCENES[options.scenes](options.seed, options.first)[0], SECOND))
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.first, options.first + options.count):
            mapping, kind = SCENES[options.scenes](options.seed, number)
            found = judged(mapping, options.settings, options.seconds, Path(folder))
            for name, (word, detail) in found.items():
                counts[name][word] += 1
                if options.all or word not in ("right", "told", "refused", "open"):
                    print(number, kind, "|", name, "|", word, detail, flush=True)
    print(f"{options.scenes}, seed {options.seed}, {options.first} to {number}:")
    for name, seen in counts.items():
        print(f"  {name}: " + ", ".join(f"{n} {word}" for word, n in seen.most_common()))


if __name__ == "__main__":
    main()
