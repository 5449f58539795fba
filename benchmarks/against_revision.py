# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""CPU time per step of this tree over that of another revision, on scenes without contact.

    python -m benchmarks.against_revision REV [SCENE ...] [--rounds N] [--json FILE]

REV is checked out into a temporary worktree and has a cache of its own.  A process of each of the
two trees measures in turn, so that both share the machine's state; given are the medians and the
median and quartiles of the rounds' ratios, new over old.  A SCENE is a name that both trees have,
or a file that both can read.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks import machine

ROOT = Path(__file__).resolve().parents[1]
METHODS = ("rk4", "dopri853")
STEP, COUNT = 1e-4, 10_000
"""[s], and steps of one measurement."""


class Compared(NamedTuple):
    """One scene under one method."""

    old: float
    """median [ns per step]."""
    new: float
    ratio: float
    """median of new over old, round by round."""
    quartiles: tuple[float, float]


def without_contact(folder: Path) -> set[str]:
    """Names of the scenes of a tree in which nothing is in contact."""
    return {
        path.stem
        for path in (folder / "config").glob("*.yaml")
        if "bodies:" in (text := path.read_text(encoding="utf-8")) and "type: contact" not in text
    }


def chosen(asked: Sequence[str], trees: Sequence[Path]) -> list[str]:
    """The scenes asked for, or all; raises SystemExit for one that is not in every tree."""
    common = set.intersection(*(without_contact(tree) for tree in trees))
    missing = sorted(name for name in set(asked) - common if not Path(name).is_file())
    if missing:
        raise SystemExit(f"not in both trees, or in contact: {', '.join(missing)}")
    return sorted(asked or common)


@contextmanager
def checked_out(revision: str, folder: Path) -> Iterator[Path]:
    """A worktree of the revision in a new folder, removed afterwards."""
    git = ["git", "-C", str(ROOT), "worktree"]
    done = subprocess.run(
        [*git, "add", "--detach", str(folder), revision],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SystemExit(f"{revision}: {done.stderr.strip().splitlines()[-1]}")
    try:
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=False)


@contextmanager
def measuring(tree: Path, cache: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that steps the rb_sim of a tree (see `stepping`)."""
    source = Path(__file__).with_name("stepping.py").read_text(encoding="utf-8")
    environment = {**os.environ, "RB_SIM_CACHE": str(cache), "PYTHONPATH": str(tree)}
    process = subprocess.Popen(
        [sys.executable, "-c", source], cwd=tree, env=environment, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.communicate()


def file_of(name: str, tree: Path) -> Path:
    """A scene of the tree, or the file of that name."""
    own = tree / "config" / f"{name}.yaml"
    return own if own.is_file() else Path(name).resolve()


def ask(process: subprocess.Popen[str], scene: Path, method: str) -> float:
    """Nanoseconds per step."""
    assert process.stdin is not None and process.stdout is not None
    asked = {"scene": str(scene), "method": method, "step": STEP, "count": COUNT}
    process.stdin.write(json.dumps(asked) + "\n")
    process.stdin.flush()
    line = process.stdout.readline()
    if not line:
        raise SystemExit(f"{scene}, {method}: the process that measures ended")
    return float(json.loads(line)["ns"])


def summary(old: Sequence[float], new: Sequence[float]) -> Compared:
    """Of paired rounds."""
    ratios = [n / o for n, o in zip(new, old, strict=True)]
    low, middle, high = statistics.quantiles(ratios, n=4, method="inclusive")
    return Compared(statistics.median(old), statistics.median(new), middle, (low, high))


def compare(
    trees: Sequence[Path], caches: Path, names: Sequence[str], rounds: int
) -> dict[str, Compared]:
    """Every scene and method; trees: old, new."""
    cases = [(name, method) for name in names for method in METHODS]
    taken: dict[tuple[str, str], list[list[float]]] = {case: [[], []] for case in cases}
    with (
        measuring(trees[0], caches / "old") as old,
        measuring(trees[1], caches / "new") as new,
    ):
        pair = list(zip((old, new), trees, strict=True))
        for turn in range(rounds + 1):
            for name, method in cases:
                for side in (0, 1) if turn % 2 else (1, 0):
                    process, tree = pair[side]
                    ns = ask(process, file_of(name, tree), method)
                    if turn:  # the first one compiles
                        taken[name, method][side].append(ns)
    return {f"{Path(name).stem}, {method}": summary(*taken[name, method]) for name, method in cases}


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.against_revision")
    parser.add_argument("revision")
    parser.add_argument("scenes", nargs="*", help="all without contact, if left out")
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(given)
    if options.rounds < 2:
        parser.error(f"--rounds: got {options.rounds}; must be at least 2")
    return options


def main() -> None:
    """Measure and print the table."""
    options = arguments()
    with tempfile.TemporaryDirectory() as folder, machine.alone():
        with checked_out(options.revision, Path(folder) / "old") as old:
            names = chosen(options.scenes, (old, ROOT))
            table = compare((old, ROOT), Path(folder), names, options.rounds)
    about: dict[str, Any] = machine.describe(["numpy", "llvmlite"])
    print(machine.line(about))
    print(f"{'case':36s} {'old ns':>8s} {'new ns':>8s} {'ratio':>7s}   quartiles")
    for name, row in table.items():
        low, high = row.quartiles
        print(f"{name:36s} {row.old:8.0f} {row.new:8.0f} {row.ratio:7.3f}   {low:.3f} {high:.3f}")
    if options.json:
        plain = {name: row._asdict() for name, row in table.items()}
        text = json.dumps(
            {"machine": about, "revision": options.revision, "steps": plain}, indent=1
        )
        options.json.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
