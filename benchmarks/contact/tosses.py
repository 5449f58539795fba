# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random tosses of bodies onto supports and each other: `python -m benchmarks.contact.tosses`.

Each toss follows from the seed and its number alone.  It is fine if the body never overlaps its
support by more than 1e-9 of its size (unless the support gives way), gains no energy, and the run
ends; a run that is refused has to say so in one line.  Depths below planes and in round supports
are found from the pose alone, others from the gaps that the run reports.

What is found is kept in a file, a line for each toss; a run goes on where the one before it ended.
Tosses of one pair of shape and support follow each other, some of each pair in turn.
"""

from __future__ import annotations

import argparse
import json
import random
import time
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import islice, zip_longest
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.contact.toss_scenes import SHAPES, SUPPORTS, toss
from benchmarks.contact.toss_verdicts import apart, judged

Row = dict[str, Any]
KINDS = ("fine", "refused", "endless", "gains", "overlaps", "unclear", "traceback")


def batches(options: argparse.Namespace, done: set[int]) -> list[list[int]]:
    """Numbers of the tosses that are left, those of one pair of shape and support together, `each`
    at a time; at first one batch for every pair."""
    left: dict[tuple[str, str], list[int]] = defaultdict(list)
    for number in range(options.first, options.first + options.count):
        found = toss(options.seed, number, options.shapes, options.supports)
        left[found.shape, found.support].append(number)
    queues = {
        pair: [numbers[i : i + options.each] for i in range(0, len(numbers), options.each)]
        for pair, numbers in left.items()
    }
    pairs = random.Random(options.seed).sample(sorted(queues), len(queues))
    out = []
    for row in zip_longest(*(queues[pair] for pair in pairs), fillvalue=[]):
        out += [kept for batch in row if (kept := [n for n in batch if n not in done])]
    return out


def tossed(options: argparse.Namespace, numbers: list[int]) -> list[Row]:
    """The rows of these tosses; in a process of its own."""
    rows, traced = [], set()
    for number in numbers:
        found = toss(options.seed, number, options.shapes, options.supports)
        if found.law not in traced:
            compile_for(found.mapping)
            traced.add(found.law)
        text = apart(found.mapping, options.seconds)
        kind, _, detail = text.partition(": ")
        what = {"shape": found.shape, "support": found.support, "law": found.law}
        rows.append({"number": number} | what | {"verdict": kind, "detail": detail})
    return rows


def compile_for(mapping: dict[str, Any]) -> None:
    """Compile what tosses with this law need, before their processes part from this one."""
    short = mapping["simulation"] | {"duration": 1e-3, "rate": 1000.0}
    judged(mapping | {"simulation": short})


def read(path: Path) -> list[Row]:
    """The rows of a file; none where there is no file yet."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def table(rows: list[Row]) -> str:
    """Counts by shape, support and verdict, in Markdown."""
    seen: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for row in rows:
        seen[row["shape"], row["support"]][row["verdict"]] += 1
    kinds = [kind for kind in KINDS if any(counts[kind] for counts in seen.values())]
    lines = [
        "| shape | support | tosses | " + " | ".join(kinds) + " |",
        "|---|---|---|" + "---|" * len(kinds),
    ]
    for (shape, support), counts in sorted(seen.items()):
        numbers = " | ".join(str(counts[kind] or "") for kind in kinds)
        lines.append(f"| {shape} | {support} | {counts.total()} | {numbers} |")
    all_of = Counter(row["verdict"] for row in rows)
    lines.append(f"| all | | {len(rows)} | " + " | ".join(str(all_of[k]) for k in kinds) + " |")
    return "\n".join(lines)


def run(options: argparse.Namespace, path: Path) -> None:
    """Toss what is not in the file yet."""
    done = {row["number"] for row in read(path)}
    end = time.monotonic() + options.minutes * 60.0
    # a process of its own for each batch: what it has loaded is given back
    pool = ProcessPoolExecutor(options.workers, get_context("spawn"), max_tasks_per_child=1)
    with pool, path.open("a", encoding="utf-8") as file:
        waiting = iter(batches(options, done))
        tasks = {pool.submit(tossed, options, b) for b in islice(waiting, options.workers)}
        while tasks:
            task = next(as_completed(tasks))
            tasks.remove(task)
            for row in task.result():
                file.write(json.dumps(row) + "\n")
                if row["verdict"] != "fine":
                    print(" ".join(str(value) for value in row.values()), flush=True)
            file.flush()
            batch = next(waiting, None) if time.monotonic() < end else None
            if batch is not None:
                tasks.add(pool.submit(tossed, options, batch))


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first toss")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="CPU time that a toss may take")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="time of all of it")
    parser.add_argument("--each", type=int, default=10, help="tosses of one pair at a time")
    parser.add_argument("--workers", type=int, default=1, help="processes at a time")
    parser.add_argument("--shapes", nargs="+", default=SHAPES, choices=SHAPES)
    parser.add_argument("--supports", nargs="+", default=SUPPORTS, choices=SUPPORTS)
    parser.add_argument("--out", type=Path, help="left out: tosses_SEED.jsonl, here")
    parser.add_argument("--table", action="store_true", help="only show what the file has")
    options = parser.parse_args()
    path = options.out or Path(f"tosses_{options.seed}.jsonl")
    if not options.table:
        run(options, path)
    print(f"seed {options.seed}, {options.count} tosses asked for")
    print(table(read(path)))


if __name__ == "__main__":
    main()
