"""`python -m benchmarks.fuzz --seed N`: damaged files, then random scenes; finds are written down.

NUMBA_DISABLE_JIT=1 spares the compiling of contacts, which takes longer than the runs.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from benchmarks.fuzz import judge, mutate, random_scenes

SHOWN = 50
"""Scenes after which the counts are shown, so that a run broken off tells how far it came."""

CONFIG = Path(__file__).resolve().parents[2] / "config"


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--files", type=int, default=2000, help="damaged scene files")
    options.add_argument("--scenes", type=int, default=200, help="random scenes that are run")
    options.add_argument("--contacts", type=float, default=0.3, help="share of scenes with them")
    options.add_argument("--budget", type=float, default=60.0, help="processor time for each [s]")
    options.add_argument("--only", type=int, help="number of the one scene to run")
    options.add_argument("--out", type=Path, help="folder for what was found")
    given = options.parse_args()
    finds = 0
    originals = mutate.texts(CONFIG)
    counts: Counter[str] = Counter()
    for i in range(given.files):
        rng = random.Random(f"file {given.seed} {i}")
        text = mutate.damaged(rng.choice(originals), rng)
        verdict = judge.of_file(text, given.budget)
        finds += told("file", i, verdict, text, given.out, counts)
    print(f"files: {dict(counts)}", flush=True)
    counts.clear()
    numbers = range(given.scenes) if given.only is None else [given.only]
    for i in numbers:
        mapping = random_scenes.scene(random.Random(f"scene {given.seed} {i}"), given.contacts)
        verdict = judge.of_scene(mapping, given.budget)
        text = yaml.safe_dump(mapping, sort_keys=False)
        finds += told("scene", i, verdict, text, given.out, counts)
        if counts.total() % SHOWN == 0:
            print(f"scenes so far: {dict(counts)}", flush=True)
    print(f"scenes: {dict(counts)}")
    return 1 if finds else 0


def told(
    what: str, i: int, verdict: judge.Verdict, text: str, out: Path | None, counts: Any
) -> int:
    """Count the verdict; print and keep a find; 1 if it is one."""
    counts[verdict.kind] += 1
    if not verdict.find:
        return 0
    print(f"{what} {i}: {verdict.kind}: {verdict.find.strip().splitlines()[-1]}", flush=True)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / f"{what}-{i}.yaml").write_text(text, encoding="utf-8", errors="replace")
        (out / f"{what}-{i}.txt").write_text(verdict.find, encoding="utf-8")
    return 1


if __name__ == "__main__":
    sys.exit(main())
