"""Machine code of loops that is kept: only what is on its own, and the same numbers."""

from __future__ import annotations

import ctypes
import math

import numpy as np
import pytest

from rb_sim.loops import compiled, kept

NEAREST = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)


def on_its_own(arguments, results):
    results[0] = math.exp(arguments[0]) / arguments[1]


def that_may_fail(arguments, results):
    if arguments[0] < 0.0:
        raise ValueError("must not be negative")
    results[0] = math.sqrt(arguments[0])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled, "folder", lambda: tmp_path)
    return tmp_path


def called(address: int, *arguments: float) -> float:
    given, result = np.array(arguments), np.zeros(1)
    NEAREST(address)(given.ctypes.data, result.ctypes.data)
    return float(result[0])


def codes(folder) -> list[str]:
    return [path.name for path in folder.glob("*.code")]


def test_what_is_on_its_own_is_kept_and_gives_the_same(folder, monkeypatch):
    first = compiled.routine(on_its_own)
    assert called(first.address, 1.25, 0.0) == math.inf  # as numba divides, and C
    (name,) = codes(folder)
    assert name.endswith("on_its_own.code")
    monkeypatch.setattr(compiled.numba, "cfunc", None)  # nobody compiles it again
    second = compiled.routine(on_its_own)
    for x in (-3.0, 0.1, 1.25):
        assert called(second.address, x, 3.0) == called(first.address, x, 3.0)
        assert called(second.address, x, 3.0) == pytest.approx(math.exp(x) / 3.0, rel=1e-15)


def test_another_processor_has_a_folder_of_its_own(tmp_path, monkeypatch):
    """Machines of a cluster share a home directory: an instruction that one lacks would end it."""
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    here = compiled.folder.__wrapped__()
    triple, _, features = compiled.target_data()
    monkeypatch.setattr(compiled, "target_data", lambda: (triple, "another", features))
    assert compiled.folder.__wrapped__() not in (None, here)


def test_what_may_raise_stays_with_numba(folder):
    routine = compiled.routine(that_may_fail)
    assert called(routine.address, 2.25) == 1.5
    assert codes(folder) == []


def test_damaged_code_is_compiled_anew(folder):
    assert compiled.routine(on_its_own).address
    (name,) = codes(folder)
    (folder / name).write_bytes(b"no machine code")
    assert kept.kept(folder, name) is None
    assert called(compiled.routine(on_its_own).address, 0.0, 4.0) == 0.25


def test_without_a_folder_all_the_same(monkeypatch):
    monkeypatch.setattr(compiled, "folder", lambda: None)
    assert called(compiled.routine(on_its_own).address, 0.0, 4.0) == 0.25


def test_a_library_without_the_passes_keeps_nothing(folder, monkeypatch):
    monkeypatch.delattr(kept.llvm, "create_new_module_pass_manager")
    assert called(compiled.routine(on_its_own).address, 0.0, 4.0) == 0.25
    assert codes(folder) == []
