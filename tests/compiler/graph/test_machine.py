# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Machine code does bit for bit what Python does, from every thread and process."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rb_sim.compiler.graph import emit, machine, store
from rb_sim.compiler.graph.machine import PlainLaw, compile_law
from rb_sim.compiler.graph.symbols import (
    External,
    Graph,
    atan2,
    call,
    cos,
    divide,
    floor,
    rarely,
    sin,
    sqrt,
    where,
)

POINTER = ctypes.POINTER(ctypes.c_double)
LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)


def run(law, count, t, y, p=()):
    """The law's outputs; through its address if it has one."""
    y, p, out = np.array(y, dtype=float), np.array([*p, 0.0], dtype=float), np.zeros(count)
    if isinstance(law, PlainLaw):
        law(t, y, p, out)
    else:
        LAW(law.address)(t, *(a.ctypes.data_as(POINTER) for a in (y, p, out)))
    return out


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """An empty cache, and nothing that is loaded already."""
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    monkeypatch.setattr(machine, "_LOADED", type(machine._LOADED)())
    return tmp_path


def everything(t, y, p):
    """A law with every operation."""
    a, b, c = y
    return (
        sqrt(a * a + b * b) / (1.0 + c * c),
        where((a < b) & ~(c <= 0.0), sin(a) - 2.0, cos(b) * t),
        where((a >= b) | (c > 1.0), atan2(a, b), floor(10.0 * c)),
        abs(a - b) + p[0],
        -(a + b) * (a - b),
        divide(a, b),
        rarely(a < b, c, a * 2.0),
        7.5,
        c,
    )


def traced(law, coordinates, inputs):
    graph = Graph()
    y, p = graph.vector("y", coordinates), graph.vector("p", inputs)
    return law(graph.input("t"), y, p)


finite = st.floats(-1e3, 1e3)


@settings(max_examples=60, deadline=None)
@given(t=finite, y=st.tuples(finite, finite, finite), p=finite)
def test_graph_equals_python_bit_for_bit(t, y, p):
    outputs = traced(everything, 3, 1)
    expected = np.array(everything(t, y, (p,)), dtype=float)
    for law in (compile_law(outputs), PlainLaw(outputs)):
        np.testing.assert_array_equal(run(law, len(outputs), t, y, (p,)), expected)


@pytest.mark.parametrize("power", [2, 3, 4])
def test_powers_are_products(power):
    """Python asks the C library, which may be off by one in the last place, as is (a - b) ** 2 of
    the first of these states."""
    outputs = traced(lambda t, y, p: [(y[0] - y[1]) ** power], 2, 0)
    rng = np.random.default_rng(2)
    for a, b in [(200.5966436037004, -540.4714278089602), *rng.uniform(-9, 9, (50, 2))]:
        expected = math.prod([a - b] * power)
        assert expected == pytest.approx((a - b) ** power, rel=1e-15)
        for law in (compile_law(outputs), PlainLaw(outputs)):
            assert run(law, 1, 0.0, (a, b))[0] == expected


def chaos(seed, length):
    """A long law without structure: each operation takes results from anywhere before it."""

    def law(t, y, p):
        draw = random.Random(seed)
        known = [t, *y]
        for _ in range(length):
            a, b = draw.choice(known), draw.choice(known)
            kind = draw.randrange(5)
            if kind == 0:
                known.append(0.5 * (a + b))
            elif kind == 1:
                known.append(sin(a * b))
            elif kind == 2:
                known.append(where(a < b, a, b - 1.0))
            elif kind == 3:
                known.append((a - b) / (2.0 + b * b))
            else:
                known.extend(call(MEAN, a, b))
        return known[-40:]

    return law


def mean_plain(a, b):
    return 0.5 * (a + b), a - b


@ctypes.CFUNCTYPE(None, POINTER, POINTER)
def mean_compiled(arguments, results):
    results[0], results[1] = mean_plain(arguments[0], arguments[1])


MEAN = External(
    "test_mean", 2, mean_plain, lambda: ctypes.cast(mean_compiled, ctypes.c_void_p).value or 0
)


def test_a_law_cut_into_pieces_is_the_same_law():
    outputs = traced(chaos(3, 900), 4, 0)
    y = (0.3, -0.2, 0.7, 0.1)
    expected = run(PlainLaw(outputs), 40, 0.25, y)
    assert expected.tolist() == list(chaos(3, 900)(0.25, y, ()))
    for piece in (10_000, 100, 7):
        pieces = emit.Pieces(outputs, piece)
        law = machine.load(
            [machine._compile(text) for text in emit.modules(pieces)],
            {f.name: f.address() for f in pieces.externals},
            pieces.externals,
        )
        assert run(law, 40, 0.25, y).tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("outputs", "y", "p"),
    [
        (traced(everything, 3, 1), (0.4, -1.3, 2.2), (1.7,)),
        (traced(chaos(5, 900), 4, 0), (0.3, -0.2, 0.7, 0.1), ()),
    ],
)
def test_a_draft_has_the_same_bits_and_a_file_of_its_own(fresh, monkeypatch, outputs, y, p):
    monkeypatch.setenv("RB_SIM_DRAFT", "0")
    law = compile_law(outputs)
    expected = run(law, len(outputs), 0.25, y, p)
    files = {path for path in fresh.rglob("*") if path.is_file()}
    monkeypatch.setenv("RB_SIM_DRAFT", "1")
    draft = compile_law(outputs)
    more = {path for path in fresh.rglob("*") if path.is_file()} - files
    assert draft is not law and len(more) == 1
    assert run(draft, len(outputs), 0.25, y, p).tobytes() == expected.tobytes()


def test_code_comes_from_disk(fresh, monkeypatch):
    outputs = traced(everything, 3, 1)
    first = run(compile_law(outputs), 9, 0.5, (1.0, 2.0, 3.0), (4.0,))
    monkeypatch.setattr(machine, "_LOADED", type(machine._LOADED)())
    monkeypatch.setattr(machine, "_compile", lambda *text: pytest.fail("compiled again"))
    again = run(compile_law(outputs), 9, 0.5, (1.0, 2.0, 3.0), (4.0,))
    assert first.tobytes() == again.tobytes()


def test_a_damaged_file_is_compiled_again(fresh, monkeypatch):
    outputs = traced(everything, 3, 1)
    expected = run(compile_law(outputs), 9, 0.5, (1.0, 2.0, 3.0), (4.0,))
    monkeypatch.setattr(machine, "_LOADED", type(machine._LOADED)())
    files = [path for path in fresh.rglob("*") if path.is_file()]
    assert files
    for path in files:
        path.write_bytes(path.read_bytes()[:-5])
    assert (
        run(compile_law(outputs), 9, 0.5, (1.0, 2.0, 3.0), (4.0,)).tobytes() == expected.tobytes()
    )


def test_folders_of_older_versions_go(tmp_path, monkeypatch):
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    for age in range(6):
        folder = store.version_folder("laws", f"version {age}")
        assert folder is not None
        os.utime(folder, (1e9 + age, 1e9 + age))
    (tmp_path / "other").mkdir()
    newest = store.version_folder("laws", "newest")
    kept = sorted(path.name for path in tmp_path.glob("laws-*"))
    assert newest is not None and newest.name in kept and len(kept) == store.VERSIONS_KEPT
    assert (tmp_path / "other").is_dir()


def test_threads_compile_at_once(fresh):
    results: dict[int, np.ndarray] = {}

    def work(k):
        outputs = traced(chaos(k % 4, 300), 4, 0)
        results[k] = run(compile_law(outputs), 40, 0.25, (0.3, -0.2, 0.7, 0.1))

    threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k in range(8):
        expected = list(chaos(k % 4, 300)(0.25, (0.3, -0.2, 0.7, 0.1), ()))
        assert results[k].tolist() == expected


PROGRAM = """
import sys
sys.path.insert(0, sys.argv[1])
from test_machine import chaos, compile_law, run, traced
print(run(compile_law(traced(chaos(5, 400), 4, 0)), 40, 0.25, (0.3, -0.2, 0.7, 0.1)).sum().hex())
"""


def test_processes_compile_at_once(fresh):
    here = os.path.dirname(__file__)
    command = [sys.executable, "-c", PROGRAM, here]
    running = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    outs = [process.communicate() for process in running]
    assert all(process.returncode == 0 for process in running), outs
    expected = (
        math.fsum([0.0])
        + np.array(chaos(5, 400)(0.25, (0.3, -0.2, 0.7, 0.1), ()), dtype=float).sum()
    )
    assert {out.strip() for out, _ in outs} == {expected.hex()}


def test_a_signal_ends_a_compilation_between_pieces(fresh, monkeypatch):
    monkeypatch.setattr(emit, "PIECE", 300)

    class StoppedError(Exception):
        pass

    def stop(number, frame):
        raise StoppedError

    outputs = traced(chaos(9, 20_000), 4, 0)
    pieces = len(emit.Pieces(outputs).parts)
    compiled = []
    original = machine._compile

    def counted(text, level):
        if len(compiled) == 2:
            os.kill(os.getpid(), signal.SIGUSR1)
            time.sleep(0)
        compiled.append(text)
        return original(text, level)

    before = signal.signal(signal.SIGUSR1, stop)
    try:
        with pytest.MonkeyPatch.context() as patch, pytest.raises(StoppedError):
            patch.setattr(machine, "_compile", counted)
            compile_law(outputs)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert len(compiled) <= 3 < pieces


def test_a_law_that_comes_again_is_not_linked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs that differ in a number have the same laws, of which none outlives its run."""
    compile_law([Graph().input("y") * 3.125])
    gc.collect()
    monkeypatch.setattr(machine, "load", None)
    compile_law([Graph().input("y") * 3.125])


CYCLES = """
import gc
from rb_sim.compiler.graph.machine import compile_law
from rb_sim.compiler.graph.symbols import Graph

class Owner:
    pass

for i in range(100):
    owner = Owner()
    owner.law, owner.itself = compile_law([Graph().input("y") * float(i) + 2.0]), owner
    if i % 7 == 0:
        gc.collect()
gc.collect()
"""


def test_laws_in_cycles_are_collected_without_a_crash() -> None:
    """In a process of its own: disposing of engines in the wrong order ends it by a signal."""
    ended = subprocess.run([sys.executable, "-c", CYCLES], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
