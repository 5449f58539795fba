# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Shipped loops: complete, checked before they are taken, and running wherever they lie."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import pytest

from rb_sim.compiler import program, ship, shipped
from tools.loops import import_all

LOOPS = {"one": ("k1", "[[], 1]", b"code of one"), "two": ("k2", "[[], 2]", b"other code")}


def written(folder: Path, sources: str = "these") -> Path:
    path = folder / "loops.bin"
    path.write_bytes(shipped.packed(sources, LOOPS))
    return path


def test_what_was_packed_is_read(tmp_path: Path) -> None:
    found = shipped.read(written(tmp_path))
    assert found.sources == "these" and set(found.named) == {"one", "two"}
    for name, (key, known, code) in LOOPS.items():
        assert tuple(found.named[name]) == (key, known) and found.code(key) == code


def test_nothing_of_a_damaged_file_is_taken(tmp_path: Path) -> None:
    path = written(tmp_path)
    whole = path.read_bytes()
    (length,) = struct.unpack_from("<Q", whole)
    for end in (0, 7, 45, 40 + length // 2):  # within the head and within the index
        path.write_bytes(whole[:end])
        assert shipped.read(path) is shipped.NOTHING
    broken = bytearray(whole)
    broken[whole.index(b"code of one")] ^= 1
    path.write_bytes(broken)
    found = shipped.read(path)
    assert found.code("k1") is None and found.code("k2") == b"other code"
    path.write_bytes(whole[:-10])
    assert shipped.read(path).code("k2") is None


def test_names_are_those_of_exactly_these_sources(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shipped, "loops", lambda: shipped.read(written(tmp_path, "others")))
    assert shipped.kept("one") is None
    monkeypatch.setattr(shipped, "loops", lambda: shipped.read(written(tmp_path, shipped.digest())))
    assert shipped.kept("one") == (b"code of one", "[[], 1]")


def test_a_processor_that_lacks_an_instruction_gets_code_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shipped.target_data()
    monkeypatch.setattr(shipped.llvm, "get_host_cpu_features", dict)
    assert shipped.target.__wrapped__() is None


def test_all_loops_that_c_calls_are_listed() -> None:
    """Those that Python calls are found by running scenes: `python -m tools.loops --check`."""
    import_all()
    named = {(module, name) for module, name, _ in ship.listed()}
    for loop in program.PROGRAMS:
        place = loop.function.__module__, loop.function.__qualname__
        if isinstance(loop, program.ForC) and place[0].startswith("rb_sim."):
            assert place in named or "<locals>" in place[1]


def test_all_that_is_listed_is_found() -> None:
    assert len([*ship.functions()]) == len(ship.listed())


# Loops run wherever the system lays their code and their constants.


PROGRAM = """
import mmap
kept = []
def map_more():
    kept.extend(mmap.mmap(-1, 1 << 30) for _ in range(3))  # never touched: no memory is used
map_more()
from rb_sim import Simulation, load_scene
for options in ({}, {"method": "time_stepping", "step": 1e-3}, {"method": "rk4", "step": 1e-3}):
    Simulation(load_scene("dropped_box", duration=0.05, **options)).run(checks=False)
    map_more()
print("ran")
"""


def test_gigabytes_between_code_and_constants_do_no_harm():
    """A code model that takes both to be within 2 GB ended the process in LLVM."""
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0 and "ran" in done.stdout, done.stderr[-500:]


def test_a_loop_is_made_for_a_machine_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Building a package compiles only what another source leads to, for any machine."""
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    made: list[str] = []
    monkeypatch.setattr(ship, "object_code", lambda text, to: made.append(text) or to.name.encode())
    for _ in range(2):
        for target in shipped.TARGETS.values():
            assert ship.code_for("text", target) == target.name.encode()
    assert made == ["text"] * len(shipped.TARGETS)
