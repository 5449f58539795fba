# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Machine code is kept on disk, by sources and processor; what is damaged is made anew."""

from __future__ import annotations

import ctypes
import math
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from rb_sim.compiler import program
from rb_sim.compiler.builder import VECTOR
from rb_sim.compiler.program import Entry, ForC, on_compilation

CALL = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)


def quotient(arguments, results):
    results[0] = math.exp(arguments[0]) / arguments[1]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    found = program.folder(str(tmp_path))
    assert found is not None
    return found


def routine() -> ForC:
    return ForC(quotient, (VECTOR, VECTOR), None)


def called(one: ForC, *arguments: float) -> float:
    """What the routine gives; it lives as long as it is called."""
    given, result = np.array(arguments), np.zeros(1)
    CALL(one.address)(given.ctypes.data, result.ctypes.data)
    return float(result[0])


def test_what_is_kept_is_not_compiled_again(folder: Path) -> None:
    reported: list[str] = []
    with on_compilation(lambda: reported.append("begun"), lambda: reported.append("done")):
        first = routine()
        assert called(first, 1.25, 0.0) == math.inf  # as IEEE 754 divides
        assert reported == ["begun", "done"]
        second = routine()
        for x in (-3.0, 0.1, 1.25):
            assert called(second, x, 3.0) == called(first, x, 3.0)
            assert called(second, x, 3.0) == pytest.approx(math.exp(x) / 3.0, rel=1e-15)
        assert reported == ["begun", "done"]


def test_damaged_code_is_compiled_anew(folder: Path) -> None:
    assert routine().address
    paths = [path for path in folder.parent.rglob("*") if path.is_file()]
    assert len(paths) == 2  # what is known of it, and the code of its IR
    for path in paths:
        path.write_bytes(b"no machine code")
        assert called(routine(), 0.0, 4.0) == 0.25
        assert path.read_bytes() != b"no machine code"


def test_other_sources_with_the_same_ir_are_translated_and_not_compiled(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An edit elsewhere, or of a comment, costs no seconds."""
    assert routine().address
    reported: list[str] = []
    monkeypatch.setattr(program, "folder", lambda root: folder.parent)  # knows nothing yet
    with on_compilation(lambda: reported.append("begun")):
        assert called(routine(), 0.0, 4.0) == 0.25
    assert not reported


def test_without_a_folder_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program, "folder", lambda root: None)
    assert called(routine(), 0.0, 4.0) == 0.25


def test_another_processor_or_another_source_has_a_folder_of_its_own(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Machines of a cluster share a home directory: an instruction that one lacks would end it."""
    find = program.folder.__wrapped__
    triple, processor, features = program.target_data()
    with monkeypatch.context() as patch:
        patch.setattr(program, "target_data", lambda: (triple, "another", features))
        assert find(str(tmp_path)) not in (None, folder)
    with monkeypatch.context() as patch:
        patch.setattr(program.shipped, "digest", lambda: "of other sources")
        assert find(str(tmp_path)) not in (None, folder)
    assert find(str(tmp_path)) == folder


def doubled(x):
    return 2.0 * x


def test_threads_that_need_one_function_get_one_machine_code(folder: Path) -> None:
    """The code of a second maker would take the place of that which runs, and free it."""
    one, addresses = routine(), []
    reported: list[bool] = []
    with on_compilation(lambda: reported.append(True)):
        threads = [threading.Thread(target=lambda: addresses.append(one.address)) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert len(set(addresses)) == 1 and reported == [True]


PROCESS = """
from tests.compiler.test_program import called, routine
print(called(routine(), 0.0, 4.0))
"""


def test_processes_at_once(folder: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.getcwd()}
    command = [sys.executable, "-c", PROCESS]
    runs = [
        subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    assert [run.communicate()[0] for run in runs] == ["0.25\n"] * 3


def test_an_entry_runs_as_plain_python_where_nothing_is_compiled(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "interpreted", lambda: True)
    reported: list[bool] = []
    with on_compilation(lambda: reported.append(True)):
        assert Entry(doubled)(3.0) == 6.0
        assert ForC(quotient, (VECTOR, VECTOR), None).address is quotient
    assert not reported


INTERRUPTED = """
import os, signal, sys, threading, traceback
from rb_sim.compiler import program

go_on, main = threading.Event(), threading.main_thread().ident

def calls():
    return [frame.f_code.co_name for frame, _ in traceback.walk_stack(sys._current_frames()[main])]

def work():
    while calls()[:3] != ["wait", "wait", "aside"]:
        pass
    os.kill(os.getpid(), signal.SIGINT)
    go_on.wait()  # as a call of LLVM: nothing of it can be broken off
    return b""

try:
    program.aside(work)
except KeyboardInterrupt:
    print(program.left_alone())
    go_on.set()
    sys.exit(7)
"""


def test_a_signal_is_answered_within_a_call_of_llvm() -> None:
    environment = {**os.environ, "PYTHONPATH": os.getcwd()}
    run = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], env=environment, capture_output=True, text=True,
        timeout=240,
    )  # fmt: skip
    assert (run.stdout, run.returncode) == ("True\n", 7)


def test_what_fails_aside_fails_here() -> None:
    def fail() -> bytes:
        raise ValueError("no code")

    assert program.aside(lambda: b"code") == b"code"
    with pytest.raises(ValueError, match="no code"):
        program.aside(fail)


BEYOND = """
import numpy as np
from rb_sim.compiler.program import Entry
from tests.compiler.test_program import third
print(Entry(third)(np.zeros(3)), flush=True)
Entry(third)(np.zeros(2))
print("went on")
"""


def third(a):
    return a[2]


def test_an_index_beyond_its_array_ends_the_process_where_bounds_are_checked(folder: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.getcwd(), "RB_SIM_CHECK_BOUNDS": "1"}
    run = subprocess.run(
        [sys.executable, "-c", BEYOND], env=environment, capture_output=True, text=True
    )
    assert run.stdout == "0.0\n" and run.returncode != 0
