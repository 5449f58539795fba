"""Random scenes with contacts, judged by invariants: `python -m benchmarks.contact.hunt`.

Each scene follows from the seed and its number alone (`--show N` writes one, as JSON, which is
YAML).  A run is fine if it keeps to the invariants or is refused in one line; what is neither is
printed.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from typing import Any

from benchmarks.contact.invariants import broken
from benchmarks.contact.random_scenes import random_scene
from benchmarks.contact.toss_verdicts import apart, run


def judged(mapping: dict[str, Any]) -> str:
    """What became of a scene: "fine", or what is wrong with it."""
    found = run(mapping)
    if isinstance(found, str):
        return found
    problems = broken(mapping, found)
    return f"broken: {'; '.join(problems)}" if problems else "fine"


def warm(mapping: dict[str, Any]) -> None:
    """Compile the loops before processes part from this one."""
    run(mapping | {"simulation": mapping["simulation"] | {"duration": 1e-3}})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=20.0, help="CPU time that one may take")
    parser.add_argument("--refused", action="store_true", help="print what is refused, too")
    parser.add_argument("--show", type=int, help="only write the scene of this number")
    options = parser.parse_args()
    if options.show is not None:
        print(json.dumps(random_scene(options.seed, options.show).mapping, indent=1))
        return
    counts: Counter[str] = Counter()
    warmed: set[bool] = set()
    for number in range(options.first, options.first + options.count):
        mapping, kind = random_scene(options.seed, number)
        method = mapping["simulation"].get("method", "")
        if (method == "time_stepping") not in warmed:
            warmed.add(method == "time_stepping")
            warm(mapping)
        text = apart(mapping, options.seconds, judged)
        verdict = text.partition(":")[0]
        counts[verdict] += 1
        if verdict not in ("fine", "refused") or (options.refused and verdict == "refused"):
            print(number, kind, method, text, flush=True)
    print(f"seed {options.seed}, {options.first} to {options.first + options.count - 1}:")
    print(", ".join(f"{count} {verdict}" for verdict, count in counts.most_common()))


if __name__ == "__main__":
    main()
