# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The golden corpus: what the program does with a fixed set of inputs, and whether it still does.

    python -m tools.golden check [PART ...]     compare with tools/golden/*.tsv; exit 1 if different
    python -m tools.golden record [PART ...]    write those files anew

A change that is meant to move code and not motion leaves every line as it is; any other difference
is explained in the commit that makes it. The corpus proves nothing about right or wrong: closed
forms and references do that (tests/).

A line is: input, outcome, digest. The digest is of the bytes of a bag, of samples or of texts. Bits
depend on the processor (LAPACK, libm), so compare on one machine: record at the revision before,
check at the revision after. `--loose` compares outcomes and not digests, for another machine.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import chdir
from functools import cache
from itertools import groupby
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "tools" / "golden"
CONFIG = ROOT / "config"
SEED = 20261128
RANDOM = 2000
"""Random scenes, and tosses."""

SETTINGS: dict[str, tuple[str, ...]] = {
    "as given": (),
    "dopri853": ("--method", "dopri853"),
    "taylor": ("--method", "taylor"),
    "radau5": ("--method", "radau5", "--tolerance", "1e-9"),
    "rk4": ("--method", "rk4", "--step", "0.001"),
    "gauss6": ("--method", "gauss6", "--step", "0.002"),
    "euler": ("--method", "euler", "--step", "0.0005"),
    "time_stepping": ("--method", "time_stepping", "--step", "0.001"),
}
"""Ways to run a shipped scene; a method that refuses the scene says so, which is kept as well."""

BUDGET = 60.0
"""CPU time that one random scene or toss may take [s]."""

COSTS = re.compile(
    r'"(nanoseconds_per_step|processor_time|wall_time|real_time_factor|file|advice|finer_step|text)'
    r'": [^\n]*\n'
)
"""Entries of a summary that say what a run cost and where its scene lies, and advice, which is
searched for a limited time."""


class Line(NamedTuple):
    """What one input gave."""

    input: str
    outcome: str
    digest: str

    def __str__(self) -> str:
        return "\t".join(self)


def digest(*parts: bytes | str) -> str:
    """Of bytes and texts, short enough to read."""
    found = hashlib.sha256()
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else part)
    return found.hexdigest()[:16]


def command(*arguments: str) -> tuple[int, str, str]:
    """(exit code, stdout, stderr) of `rb_sim` with these arguments, in this process."""
    from typer.testing import CliRunner

    from rb_sim.cli.main import app

    with warnings.catch_warnings():
        warnings.simplefilter("always")  # not once a process
        done = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "100"})
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        return 70, "", f"{type(done.exception).__name__}: {done.exception}"
    return done.exit_code, done.stdout, done.stderr


def run_here(scene: str, text: str, *options: str) -> tuple[int, str]:
    """(exit code, stderr) of a run of the scene's text into the folder o of the present one. The
    scene's path is in the bag: here it has no folder, wherever the checkout lies."""
    file = Path(f"{scene}.yaml")
    file.write_text(text, encoding="utf-8")
    quiet = ("--no-plots", "--no-rerun", "--quiet")
    code, _, said = command("run", str(file), "--out", "o", *quiet, *options)
    return code, said


def run_line(name: str, scene: str, text: str, options: tuple[str, ...] = ()) -> Line:
    """A run by the command line: the bytes of its bag, the messages alone, its summary but for
    costs, what it prints on stderr. scene: name of the file with the text."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        code, said = run_here(scene, text, *options)
        bags = sorted(Path("o").glob("bag/*.mcap"))
        summary = Path("o/summary.json")
        made = COSTS.sub("", summary.read_text(encoding="utf-8")) if summary.exists() else ""
        found = digest(*[bag.read_bytes() for bag in bags]), recorded(bags), digest(made)
    # without the advice, and without how long the run would take on a machine as busy as this one
    first = [
        line.split("; ")[0] for line in said.splitlines() if line and "at this pace" not in line
    ]
    words = " | ".join(first)
    return Line(
        name, f"exit {code} {words}".strip(), "bag {} messages {} summary {}".format(*found)
    )


def recorded(bags: list[Path]) -> str:
    """The digest of the messages alone: a bag has its summary beside them."""
    from mcap.reader import make_reader

    parts: list[bytes | str] = []
    for bag in bags:
        with bag.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages():
                parts += [f"{channel.topic} {message.log_time}", message.data]
    return digest(*parts)


def shipped(name: str) -> list[Line]:
    """A shipped scene by each method, its duration at most a second where it is not as given."""
    text = (CONFIG / f"{name}.yaml").read_text(encoding="utf-8")
    lines = []
    for setting, options in SETTINGS.items():
        short = ("--duration", "1") if options else ()
        lines.append(run_line(f"{name} {setting}", name, text, (*options, *short)))
    return lines


def hard_case(path: str) -> list[Line]:
    """A hard case's scene by each of its settings, two seconds of it at most."""
    case = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    scene, lines = case["scene"], []
    if isinstance(scene, str):
        text, length = (CONFIG / f"{scene}.yaml").read_text(encoding="utf-8"), 1.0
    else:
        text = yaml.safe_dump(scene, sort_keys=False)
        length = float(scene.get("simulation", {}).get("duration", 10.0))
    for setting in case["runs"]:
        given = dict(setting)
        given["duration"] = min(float(given.get("duration", length)), 2.0)
        options = [word for key, value in given.items() for word in (f"--{key}", str(value))]
        name = " ".join([Path(path).stem, *options])
        lines.append(run_line(name, Path(path).stem, text, tuple(options)))
    return lines


def documented(path: str) -> list[Line]:
    """The scenes in the YAML blocks of a page of the documentation."""
    from tests.docs.blocks import blocks

    lines = []
    for number, block in enumerate(b for b in blocks(Path(path)) if b.language == "yaml"):
        data = yaml.safe_load(block.text) if "..." not in block.text else None
        if isinstance(data, dict) and "bodies" in data and "supports" not in data:
            name = f"{Path(path).relative_to(ROOT / 'docs').with_suffix('')} {number}"
            lines.append(run_line(name, "scene", block.text, ("--duration", "1")))
    return lines


Judge = Callable[[dict[str, Any], Any], str]


def sampled(mapping: dict[str, Any], judge: Judge | None = None) -> str:
    """Outcome and digest of a scene run through the Python interface, with a tab between.

    judge: says of the trajectory of the mapping in a word or two whether it is right.
    """
    from rb_sim import Simulation, load_scene
    from rb_sim.base.errors import RbSimError

    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run = Simulation(load_scene(mapping)).run(check=False)
    except RbSimError as error:
        # how fine a step would do is searched for as long as the machine lets it
        return f"refused\t{digest(str(error).partition('; ')[0])}"
    except Exception as error:  # noqa: BLE001 (a traceback is an outcome)
        return f"traceback {type(error).__name__}\t{digest(str(error))}"
    block = run.block
    columns = (block.t, block.position, block.orientation, block.reaction_force, block.energy)
    words = [str(finding) for finding in run.findings]
    finite = all(bool(np.isfinite(column).all()) for column in columns)
    outcome = [
        *(["warned"] if words else []),
        "ran" if finite else "not finite",
        *([judge(mapping, run)] if judge else []),
    ]
    return f"{' '.join(outcome)}\t{digest(*[column.tobytes() for column in columns], *words)}"


@cache
def ready() -> None:
    """Import what runs need and load the loops, once for all processes that begin as copies of this
    one: they would take ten times as long without."""
    for method in ("dopri853", "rk4", "time_stepping"):
        scene = yaml.safe_load((CONFIG / "dropped_box.yaml").read_text(encoding="utf-8"))
        scene["simulation"] = {"duration": 0.5, "method": method}
        sampled(scene)


def apart(mapping: dict[str, Any], judge: Judge | None = None) -> tuple[str, str]:
    """(outcome, digest) of a scene, in a process of its own that may take BUDGET."""
    from benchmarks.contact.toss_verdicts import apart as in_its_own_process

    ready()
    text = in_its_own_process(mapping, BUDGET, lambda scene: sampled(scene, judge))
    outcome, _, found = text.partition("\t")
    return outcome, found


def random_scenes(numbers: str) -> list[Line]:
    """Random scenes "first-last", those of the fuzzer, a second of each at most."""
    from benchmarks.fuzz import random_scenes as scenes

    lines = []
    for number in _range(numbers):
        rng = random.Random(f"scene {SEED} {number}")
        mapping = scenes.scene(rng, 0.3)
        options = mapping.setdefault("simulation", {})
        options["duration"] = min(float(options.get("duration", 1.0)), 1.0)
        lines.append(Line(f"scene {number}", *apart(mapping)))
    return lines


def tosses(numbers: str) -> list[Line]:
    """Random tosses "first-last" of bodies onto supports: the verdict of each, and its samples."""
    from benchmarks.contact.toss_scenes import toss
    from benchmarks.contact.toss_verdicts import verdict

    return [
        Line(f"toss {number} {found.shape} {found.support}", *apart(found.mapping, verdict))
        for number in _range(numbers)
        for found in [toss(SEED, number)]
    ]


def references(path: str) -> list[Line]:
    """The reference cases of tests/oracles that are scenes of the catalogue."""
    from tests.oracles.to_scene import scene_of

    lines = []
    for case in json.loads(Path(path).read_text(encoding="utf-8"))["cases"]:
        try:
            mapping = scene_of(case)
        except (KeyError, ValueError, StopIteration):
            continue  # has a form of its own in the tests
        mapping["simulation"] = {"duration": 1.0, "rate": 50.0}
        lines.append(Line(f"reference {case['id']}", *apart(mapping)))
    return lines


def foreign(path: str) -> list[Line]:
    """A scene on which this program or another was wrong once, by its own settings."""
    name = Path(path).stem
    return [run_line(name, name, Path(path).read_text(encoding="utf-8"))]


def damaged_bags(numbers: str) -> list[Line]:
    """A bag with bytes changed, cut or taken out: what `info` and `recover` say of it."""
    lines = []
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        run_here("pendulum", (CONFIG / "pendulum.yaml").read_text(encoding="utf-8"))
        whole = Path("o/bag/bag_0.mcap").read_bytes()
        for number in _range(numbers):
            rng = random.Random(f"bag {SEED} {number}")
            Path("o/bag/bag_0.mcap").write_bytes(_damaged(whole, rng))
            info = command("info", "o/bag")
            back = command("recover", "o/bag", f"r{number}")
            made = b"".join(bag.read_bytes() for bag in sorted(Path(f"r{number}").rglob("*.mcap")))
            said = [re.sub(r"\d+\.\d+ s ago", "", text) for text in (*info[1:], *back[1:])]
            lines.append(Line(f"bag {number}", f"exit {info[0]}, {back[0]}", digest(*said, made)))
    return lines


def _damaged(data: bytes, rng: random.Random) -> bytes:
    kind, at = rng.randrange(3), rng.randrange(len(data))
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :]
    return data[:at] + data[at + rng.randrange(1, 4000) :]


def statics(name: str) -> list[Line]:
    """A shipped scene of statics."""
    code, out, said = command("statics", name)
    return [Line(f"statics {name}", f"exit {code}", digest(out, said))]


def helps(_: str) -> list[Line]:
    """The help of every verb."""
    from typer.main import get_command

    from rb_sim.cli.main import app

    verbs = sorted(getattr(get_command(app), "commands"))  # noqa: B009 (a click group)
    return [
        Line(f"help {verb}", f"exit {code}", digest(out, said))
        for verb in ["", *verbs]
        for code, out, said in [command(*([verb] if verb else []), "--help")]
    ]


def _range(numbers: str) -> range:
    first, last = map(int, numbers.split("-"))
    return range(first, last)


def _slices(count: int, each: int = 25) -> list[str]:
    return [f"{i}-{min(i + each, count)}" for i in range(0, count, each)]


def _scenes(folder: str) -> list[str]:
    found = (CONFIG / folder).glob("*.yaml")
    return sorted(path.stem for path in found if not path.stem.endswith(".params"))


PARTS: dict[str, tuple[Callable[[str], list[Line]], Callable[[], list[str]]]] = {
    "shipped": (shipped, lambda: _scenes("")),
    "hard_cases": (
        hard_case,
        lambda: [str(p) for p in sorted((CONFIG / "hard_cases").glob("*.yaml"))],
    ),
    "documented": (documented, lambda: [str(p) for p in sorted((ROOT / "docs").rglob("*.md"))]),
    "references": (
        references,
        lambda: [str(p) for p in sorted((ROOT / "tests/oracles").glob("cases_*.json"))],
    ),
    "foreign": (foreign, lambda: [str(p) for p in sorted((KEPT / "foreign").glob("*.yaml"))]),
    "scenes": (random_scenes, lambda: _slices(RANDOM)),
    "tosses": (tosses, lambda: _slices(RANDOM)),
    "bags": (damaged_bags, lambda: _slices(100, 50)),
    "statics": (statics, lambda: _scenes("statics")),
    "help": (helps, lambda: [""]),
}
"""Parts of the corpus: what makes the lines of one job, and the jobs."""


def made(part: str, workers: int) -> Iterator[list[Line]]:
    """The lines of a part, job by job; each job in a process of its own."""
    make, jobs = PARTS[part]
    os.environ["RB_SIM_DRAFT"] = "1"  # laws compile faster
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    with get_context("spawn").Pool(workers, maxtasksperchild=4) as pool:
        yield from pool.imap(make, jobs())


def kept(part: str) -> dict[str, Line]:
    """The lines of a part's file, by input."""
    text = (KEPT / f"{part}.tsv").read_text(encoding="utf-8")
    return {line.input: line for row in text.splitlines() for line in [Line(*row.split("\t"))]}


def check(part: str, workers: int, loose: bool) -> int:
    """Print what differs from the file; the number of differences."""
    before, different = kept(part), 0
    seen = set()
    for lines in made(part, workers):
        for line in lines:
            seen.add(line.input)
            old = before.get(line.input)
            if old is None or old.outcome != line.outcome or not (loose or old == line):
                different += 1
                was = "nothing" if old is None else f"{old.outcome} [{old.digest}]"
                print(f"{line.input}\n  was {was}", flush=True)
                print(f"  is  {line.outcome} [{line.digest}]", flush=True)
    for name in before.keys() - seen:
        different += 1
        print(f"{name}\n  was {before[name].outcome}\n  is  nothing", flush=True)
    print(f"{part}: {len(seen)} inputs, {different} different", flush=True)
    return different


def record(part: str, workers: int) -> None:
    """Write the file of a part."""
    KEPT.mkdir(exist_ok=True)
    lines = []
    with (KEPT / f"{part}.tsv").open("w", encoding="utf-8") as file:
        for found in made(part, workers):
            lines += found
            file.writelines(f"{line}\n" for line in found)
            file.flush()
    outcomes = sorted(line.outcome.split(" ")[0] for line in lines)
    counts = ", ".join(f"{len(list(found))} {word}" for word, found in groupby(outcomes))
    print(f"{part}: {len(lines)} inputs recorded ({counts})", flush=True)


def main() -> int:
    """Check or record the parts that are named, all without."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("act", choices=("check", "record"))
    options.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    options.add_argument("--workers", type=int, default=2, help="processes at a time")
    options.add_argument("--loose", action="store_true", help="compare outcomes, not digests")
    given = options.parse_args()
    parts = given.parts or list(PARTS)
    if unknown := [part for part in parts if part not in PARTS]:
        options.error(f"PART: got {unknown[0]!r}; must be one of {', '.join(PARTS)}")
    if given.act == "record":
        for part in parts:
            record(part, given.workers)
        return 0
    return 1 if sum([check(part, given.workers, given.loose) for part in parts]) else 0


if __name__ == "__main__":
    sys.exit(main())
