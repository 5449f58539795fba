# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Machine code of a graph by llvmlite, kept on disk by a hash of the graph; or Python functions."""

from __future__ import annotations

import ctypes
import hashlib
import os
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any
from weakref import WeakValueDictionary

import llvmlite
import llvmlite.binding as llvm

from rb_sim.compiler.graph import store, symbols
from rb_sim.compiler.graph.emit import Pieces, constant, modules, python_source
from rb_sim.compiler.graph.symbols import External
from rb_sim.compiler.graph.typed_pointers import with_typed_pointers

FORMAT = "2"
"""Version of the files on disk and of the signature of a law."""

ENTRY = "law"
"""Name of the entry function in stored machine code."""

_LOADED: WeakValueDictionary[tuple[Any, str], Law] = WeakValueDictionary()
"""By the root of the cache on disk, which has them too, and their names there."""
_RECENT: deque[Law] = deque(maxlen=64)
"""Laws loaded last, which stay: runs that differ in a number have the same laws, one after the
other (fits, sweeps)."""
_LOCK = threading.Lock()


def interpreted() -> bool:
    """True if nothing shall be compiled (RB_SIM_INTERPRETED)."""
    return os.environ.get("RB_SIM_INTERPRETED", "0") not in ("", "0")


def draft() -> bool:
    """True if compilation shall be fast rather than the code (RB_SIM_DRAFT).

    LLVM then takes a fifth of its time, and a law twice its own; the numbers are the same to the
    last bit.
    """
    return os.environ.get("RB_SIM_DRAFT", "0") not in ("", "0")


class Law:
    """Compiled law void law(double t, const double *y, const double *p, double *out) in memory.

    The code lives as long as the object.
    """

    def __init__(self, address: int, owner: Any, others: Sequence[Any]) -> None:
        self.address = address
        self._owner = owner, tuple(others)


class PlainLaw:
    """A law as a Python function of arrays: law(t, y, p, out)."""

    def __init__(self, outputs: Sequence[Any]) -> None:
        self.call = plain_function(python_source(outputs), Pieces(outputs))

    def __call__(self, t: float, y: Any, p: Any, out: Any) -> None:
        """Write the law at (t, y) with the inputs p into out."""
        self.call(float(t), y, p, out)


def plain_function(source: str, pieces: Pieces) -> Callable[..., None]:
    """The function defined by `emit.python_source`."""
    names = ("sqrt", "sin", "cos", "floor", "atan2", "divide")
    space: dict[str, Any] = {name: getattr(symbols, name) for name in names}
    space["external"] = {f.name: f.plain for f in pieces.externals}
    exec(source, space)
    return space["law"]


@cache
def target_data() -> tuple[str, str, str]:
    """(triple, processor, features) of this machine; initialises LLVM once."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features().flatten()
    return llvm.get_process_triple(), llvm.get_host_cpu_name(), features


def target_machine(level: int = 2) -> Any:
    """LLVM target machine of this computer, with an optimisation level."""
    triple, processor, features = target_data()
    target = llvm.Target.from_triple(triple)
    return target.create_target_machine(cpu=processor, features=features, opt=level, jit=True)


@cache
def folder(root: str) -> Any:
    """Folder of laws below the cache root for this machine, version of LLVM and format."""
    del root  # only the cache key: tests change it
    version = "\n".join((FORMAT, llvmlite.__version__, *target_data()))
    return store.version_folder("laws", version)


def compile_law(outputs: Sequence[Any], *, often: bool = True) -> Law | PlainLaw:
    """The law that writes the outputs, symbols of one graph and numbers, in order into `out`.

    often: False for a rarely called law: a long one is compiled three times as fast, and takes
    twice the time. Machine code comes from this process, else from disk, else from LLVM. Several
    threads and processes may compile at once; a signal waits for at most one piece.
    """
    if interpreted():
        return PlainLaw(outputs)
    pieces = Pieces(outputs)
    texts = modules(pieces)
    return linked(texts, pieces.externals, 2 if often or len(texts) == 1 else 0)


def named_law(role: str, pieces: Pieces, level: int) -> tuple[str, Law]:
    """(name, law) of a law that others call by name (see `linked`); the name depends on its
    content."""
    texts = modules(pieces)
    name = f"rb_sim_{role}_{_hash_of(texts)[:40]}"
    return name, linked(texts, pieces.externals, level)


def _hash_of(texts: Sequence[str]) -> str:
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


def linked(
    texts: Sequence[str],
    externals: Sequence[External] = (),
    level: int = 2,
    others: Mapping[str, Law] = MappingProxyType({}),
) -> Law:
    """The law defined by modules of LLVM IR; from this process, else from disk, else compiled.

    others: laws that it calls, by their names.
    """
    level = _level(level)
    root, key = store.cache_root(), key_of(texts, level)
    with _LOCK:
        found = _LOADED.get((root, key))
    if found is not None:
        return found
    symbols = {f.name: f.address() for f in externals}
    symbols |= {name: other.address for name, other in others.items()}
    law = load(_objects(key, texts, level), symbols, (*externals, *others.values()))
    with _LOCK:
        law = _LOADED.setdefault((root, key), law)
        _RECENT.append(law)
        return law


def key_of(texts: Sequence[str], level: int = 2) -> str:
    """Name under which the law of these modules is stored."""
    return f"{_hash_of(texts)}-{_level(level)}"


def _level(wanted: int) -> int:
    """Effective optimisation level; part of the name of stored code."""
    return 0 if draft() else wanted


_MODULES: dict[str, Law] = {}


def loaded_module(name: str, text: str) -> Law:
    """The function `law` of a module, kept until the process ends: other code calls it by
    address."""
    level = _level(2)
    name = f"{name}-{level}"
    with _LOCK:
        found = _MODULES.get(name)
    if found is not None:
        return found
    law = load(_objects(name, [text], level), {}, ())
    with _LOCK:
        return _MODULES.setdefault(name, law)


def bound(function: int, numbers: Sequence[float], arguments: int) -> Law:
    """void f(const double *arguments, double *results): the function at this address with fixed
    first arguments `numbers`.

    Valid in this process only, so it is not stored on disk.
    """
    count = len(numbers) + arguments
    lines = [
        "define void @law(ptr %arguments, ptr %results) nounwind {",
        f"  %workspace = alloca [{count} x double], align 16",
    ]
    for i in range(count):
        lines.append(f"  %to{i} = getelementptr double, ptr %workspace, i64 {i}")
        value = f"%x{i}"
        if i < len(numbers):
            value = constant(numbers[i])
        else:
            at = i - len(numbers)
            lines.append(f"  %of{i} = getelementptr double, ptr %arguments, i64 {at}")
            lines.append(f"  %x{i} = load double, ptr %of{i}, align 8")
        lines.append(f"  store double {value}, ptr %to{i}, align 8")
    lines += [
        f"  %f = inttoptr i64 {function} to ptr",
        "  call void %f(ptr %to0, ptr %results)",
        "  ret void",
        "}",
        "",
    ]
    return load([_compile("\n".join(lines))], {}, ())


_POINTER = ctypes.POINTER(ctypes.c_double)
_CALL = ctypes.CFUNCTYPE(None, ctypes.c_double, _POINTER, _POINTER, _POINTER)


def evaluate(law: Law | Callable[..., None], t: float, y: Any, p: Any, out: Any) -> None:
    """Call the law from Python; y, p, out: contiguous arrays of float."""
    if isinstance(law, Law):
        _CALL(law.address)(t, *(a.ctypes.data_as(_POINTER) for a in (y, p, out)))
    else:
        law(t, y, p, out)


_CALL_ROWS = ctypes.PYFUNCTYPE(None, ctypes.c_double, *[ctypes.c_void_p] * 3)
"""Type of a law called with the GIL held: releasing it for each row costs more than most laws."""


def evaluate_rows(law: Law | PlainLaw, t: Any, y: Any, p: Any, out: Any) -> None:
    """Call the law for every t (n,) with the rows of y, into the rows of out; contiguous arrays."""
    if not isinstance(law, Law):
        for at in zip(t, y, out, strict=True):
            law(float(at[0]), at[1], p, at[2])
        return
    call, constants = _CALL_ROWS(law.address), p.ctypes.data
    state, result = y.ctypes.data, out.ctypes.data
    for k, at in enumerate(t.tolist()):
        call(at, state + k * y.strides[0], constants, result + k * out.strides[0])


def _objects(key: str, texts: Sequence[str], level: int) -> list[bytes]:
    """Object code of the modules, from disk or compiled."""
    place = folder(str(store.cache_root()))
    kept = store.read(place, key)
    objects = None if kept is None else store.unpack(kept)
    if objects is None:
        objects = [_compile(text, level) for text in texts]
        store.write(place, key, store.pack(objects))
    return objects


def _compile(text: str, level: int = 2) -> bytes:
    """Object code of one module.

    No passes over the IR: the graph has already shared and folded what they would find.
    """
    return assembled(new_module(text), level)


def new_module(text: str) -> Any:
    """The verified LLVM module of this IR for this machine."""
    if llvm.llvm_version_info[0] < 15:
        text = with_typed_pointers(text)
    module = llvm.parse_assembly(text, llvm.create_context())
    module.triple = target_data()[0]
    module.verify()
    return module


def assembled(module: Any, level: int) -> bytes:
    """Object code of a module for this machine."""
    return target_machine(level).emit_object(module)


@cache
def _context() -> Any:
    """The one LLVM context of all engines, never disposed of.

    A context must outlive its modules; for an engine and its own context in one reference cycle the
    garbage collector may dispose of the context first.
    """
    return llvm.create_context()


def load(
    objects: Sequence[bytes],
    symbols: Mapping[str, int] = MappingProxyType({}),
    owners: Sequence[Any] = (),
) -> Law:
    """Link object code into this process; symbols: addresses of the functions that it calls."""
    for name, address in symbols.items():
        llvm.add_symbol(name, address)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly("", _context()), target_machine())
    for code in objects:
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return Law(engine.get_function_address(ENTRY), engine, owners)
