# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`python -m benchmarks.fuzz --seed N`: damaged files, then random scenes; finds are written down.

With --out, --minutes 9 ends the slice and the same command goes on where it ended.
RB_SIM_INTERPRETED=1 spares the compiling of contacts, which takes longer than the runs.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
import time
from collections import Counter
from functools import cache
from pathlib import Path

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
    options.add_argument("--out", type=Path, help="folder for what was found; goes on from there")
    options.add_argument("--minutes", type=float, default=math.inf, help="end the slice then")
    given = options.parse_args()
    if given.only is not None:
        verdict, text = of_number("scene", given.only, given)
        return report("scene", given.only, verdict, text, given.out)
    end = time.monotonic() + 60.0 * given.minutes
    progress = Progress(given)
    for what, most in (("file", given.files), ("scene", given.scenes)):
        while progress.next(what) < most:
            if time.monotonic() > end:
                print(progress.words(), flush=True)
                return 1 if progress.finds else 0
            i = progress.next(what)
            verdict, text = of_number(what, i, given)
            progress.note(what, verdict.kind, report(what, i, verdict, text, given.out))
            if (i + 1) % SHOWN == 0:
                print(progress.words(), flush=True)
    print(progress.words(), flush=True)
    return 1 if progress.finds else 0


def of_number(what: str, i: int, given: argparse.Namespace) -> tuple[judge.Verdict, str]:
    """(verdict, text) of the file or scene of that number."""
    rng = random.Random(f"{what} {given.seed} {i}")
    if what == "file":
        text = mutate.damaged(rng.choice(originals()), rng)
        return judge.of_file(text, given.budget), text
    mapping = random_scenes.scene(rng, given.contacts)
    return judge.of_scene(mapping, given.budget), yaml.safe_dump(mapping, sort_keys=False)


@cache
def originals() -> list[str]:
    return mutate.texts(CONFIG)


class Progress:
    """How far the hunt has come, kept in the folder of what it finds: the next slice goes on."""

    def __init__(self, given: argparse.Namespace) -> None:
        self._path = None if given.out is None else given.out / f"progress-{given.seed}.json"
        self._counts: dict[str, Counter[str]] = {"file": Counter(), "scene": Counter()}
        self.finds = 0
        if self._path is not None and self._path.exists():
            known = json.loads(self._path.read_text(encoding="utf-8"))
            self.finds = known.pop("finds")
            self._counts = {what: Counter(counts) for what, counts in known.items()}

    def next(self, what: str) -> int:
        """Number of the next file or scene."""
        return self._counts[what].total()

    def note(self, what: str, kind: str, find: int) -> None:
        """Count a verdict."""
        self._counts[what][kind] += 1
        self.finds += find
        if self._path is not None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._path.write_text(json.dumps(self._counts | {"finds": self.finds}))

    def words(self) -> str:
        files, scenes = (f"{c.total()} {dict(c)}" for c in self._counts.values())
        return f"files: {files}; scenes: {scenes}; finds: {self.finds}"


def report(what: str, i: int, verdict: judge.Verdict, text: str, out: Path | None) -> int:
    """Print and keep a find; 1 if it is one."""
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
