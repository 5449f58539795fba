# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Functions that C or Python calls, compiled on first use and kept on disk.

Several threads and processes may compile at once: each uses what another one has written, and
results made at the same time are equal.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import importlib
import json
import math
import pathlib
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import islice
from types import FunctionType
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakSet

import llvmlite
import numpy as np

from rb_sim.compiler import shipped
from rb_sim.compiler.builder import (
    BOOLEAN,
    COMPLEX,
    DTYPES,
    INTEGER,
    NOTHING,
    REAL,
    Array,
    Kind,
    Number,
    Object,
    Tuple,
)
from rb_sim.compiler.graph import store
from rb_sim.compiler.graph.machine import ENTRY, Law, interpreted, load, target_data
from rb_sim.compiler.graph.machine import folder as laws_folder

if TYPE_CHECKING:
    from rb_sim.compiler.unit import Unit


# Conversion of Python arguments and results of compiled functions to numbers and addresses in
# slots.


_NUMBERS = {"real": REAL, "integer": INTEGER, "boolean": BOOLEAN, "complex": COMPLEX}
_SLOTS = {"double": "d", "i64": "q", "i1": "q", "ptr": "q"}
_place_of = ctypes.addressof
_first_byte: Any = ctypes.c_char.from_buffer
_KNOWN: dict[int, tuple[np.ndarray, int]] = {}
"""Recently used arrays with their addresses, by id; an array that is kept alive keeps its id."""
MOST_KNOWN, MOST_HELD = 128, 1 << 20
"""Most arrays in this cache, and largest size of one [bytes]."""


def address_of(array: np.ndarray) -> int:
    """Address of the elements of a C-contiguous array; cached, as numpy takes ten times as long.

    Raises TypeError for an array that is not C-contiguous.
    """
    known = _KNOWN.get(id(array))
    if known is not None:
        return known[1]
    try:
        place = _place_of(_first_byte(array))
    except (TypeError, ValueError):  # empty, read-only or not contiguous
        if not array.flags.c_contiguous:
            raise TypeError("an array of a compiled function is C-contiguous") from None
        place = array.ctypes.data
    if array.nbytes <= MOST_HELD:
        if len(_KNOWN) >= MOST_KNOWN:
            _KNOWN.clear()
        _KNOWN[id(array)] = array, place
    return place


Arrays = dict[tuple[int, tuple[int, ...]], np.ndarray]
"""Arrays by address and shape: a view may begin at the address of its array."""
Flattened = tuple[tuple[Any, ...], list[Any], Arrays]


def flattened(arguments: Sequence[Any]) -> Flattened:
    """(tokens of the argument kinds, numbers of the arguments in order, arrays by address and
    shape)."""
    tokens: list[Any] = []
    numbers: list[Any] = []
    arrays: Arrays = {}
    for argument in arguments:
        _tell(argument, tokens, numbers, arrays)
    return tuple(tokens), numbers, arrays


def _tell(argument: Any, tokens: list[Any], numbers: list[Any], arrays: Arrays) -> None:
    """Append the tokens and numbers of one argument. Raises TypeError for an unsupported type."""
    kind = argument.__class__
    if kind is np.ndarray:
        tokens.append((argument.dtype.char, argument.ndim))
        place, shape = address_of(argument), argument.shape
        arrays[place, shape] = argument
        numbers.append(place)
        numbers += shape
    elif kind is float or kind is np.float64:
        tokens.append("real")
        numbers.append(argument)
    elif kind is bool or kind is np.bool_:
        tokens.append("boolean")
        numbers.append(bool(argument))
    elif kind is int or isinstance(argument, (int, np.integer)):
        tokens.append("integer")
        numbers.append(int(argument))
    elif isinstance(argument, tuple):
        tokens.append(kind)
        tokens.append(len(argument))
        for entry in argument:
            _tell(entry, tokens, numbers, arrays)
    else:
        raise TypeError(f"{kind.__name__} is nothing that a compiled function takes")


def kind_of(argument: Any) -> Kind:
    """The kind of a Python argument."""
    if isinstance(argument, np.ndarray):
        return Array(DTYPES[argument.dtype], argument.ndim)
    if isinstance(argument, tuple):
        of = None if type(argument) is tuple else type(argument)
        return Tuple(tuple(kind_of(entry) for entry in argument), of)
    if isinstance(argument, (bool, np.bool_)):
        return BOOLEAN
    return INTEGER if isinstance(argument, (int, np.integer)) else REAL


_FIRST = struct.Struct("=q")
_CALL = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)


class Program:
    """A compiled function for one combination of argument kinds."""

    def __init__(self, law: Any, kinds: Sequence[Kind], result: Kind, new: bool) -> None:
        """new: whether the result may contain arrays made by the function."""
        self._law, self._result, self._new = law, result, new
        self._call = _CALL(law.address)
        given = [leaf for kind in kinds for leaf in kind.leaves]
        self._into = struct.Struct("=q" + "".join(_SLOTS[leaf] for leaf in given))
        self._out = struct.Struct("=" + "".join(_SLOTS[leaf] for leaf in result.leaves))
        self._at = self._into.size
        self._buffers: list[Any] = []
        """Argument buffers that are not in use."""

    def __call__(self, numbers: list[Any], arrays: Arrays) -> Any:
        """Call the code; arrays in the result are arguments or copies of new arrays."""
        try:
            buffer = self._buffers.pop()
        except IndexError:
            buffer = ctypes.create_string_buffer(self._at + self._out.size)
        self._into.pack_into(buffer, 0, 0, *numbers)
        self._call(buffer)
        result = None
        if self._out.size:
            leaves = self._out.unpack_from(buffer, self._at)
            single = self._result in (REAL, INTEGER)
            result = leaves[0] if single else _back(self._result, iter(leaves), arrays)
        if self._new and _FIRST.unpack_from(buffer)[0]:  # new arrays, copied by now
            self._call(buffer)
        self._buffers.append(buffer)
        return result


def _back(kind: Kind, leaves: Iterator[Any], arrays: Arrays) -> Any:
    """A Python value from its leaves."""
    if isinstance(kind, Number):
        return bool(next(leaves)) if kind is BOOLEAN else next(leaves)
    if isinstance(kind, Tuple):
        parts = [_back(k, leaves, arrays) for k in kind.kinds]
        return tuple(parts) if kind.of is None else kind.of(*parts)
    if isinstance(kind, Array):
        place = next(leaves)
        shape = tuple(islice(leaves, kind.ndim))
        found = arrays.get((place, shape))
        return _copied(kind, place, shape) if found is None else found
    return complex(next(leaves), next(leaves)) if kind == COMPLEX else None


def _copied(kind: Array, place: int, shape: Sequence[int]) -> np.ndarray:
    """A copy of the array at this address."""
    dtype = next(dtype for dtype, element in DTYPES.items() if element == kind.element)
    count = math.prod(shape)
    data = (ctypes.c_char * (count * dtype.itemsize)).from_address(place)
    return np.frombuffer(bytes(data), dtype).reshape(shape).copy()


def words_of(kind: Kind) -> Any:
    """The kind as JSON data."""
    if isinstance(kind, Tuple):
        of = None if kind.of is None else [kind.of.__module__, kind.of.__qualname__]
        return ["tuple", of, *(words_of(k) for k in kind.kinds)]
    if isinstance(kind, Array):
        return ["array", kind.element, kind.ndim]
    if isinstance(kind, Object):
        return "nothing"
    return next((word for word, k in _NUMBERS.items() if k == kind), type(kind).__name__.lower())


def kind_from(words: Any) -> Kind:
    """The kind from its JSON data; inverse of `words_of`."""
    if words == "nothing":
        return NOTHING
    if isinstance(words, str):
        return _NUMBERS[words]
    if words[0] == "array":
        return Array(words[1], words[2])
    of = None if words[1] is None else getattr(importlib.import_module(words[1][0]), words[1][1])
    return Tuple(tuple(kind_from(w) for w in words[2:]), of)


FORMAT = "3"

_LOCK = threading.RLock()
"""Only one function is compiled at a time: translation is mostly Python, and none is compiled
twice."""
Hook = Callable[[], None]
_hooks: list[tuple[Hook, Hook]] = []


@contextmanager
def on_compilation(announce: Hook, done: Hook = lambda: None) -> Iterator[None]:
    """Context in which `announce` is called when a compilation begins, and `done` when it ends.

    Code that is read from disk is not compiled.
    """
    hooks = announce, done
    _hooks.append(hooks)
    try:
        yield
    finally:
        _hooks.remove(hooks)


@cache
def folder(root: str) -> pathlib.Path | None:
    """Cache folder of functions of exactly these sources, on this processor; None if it is not
    writable.

    Machines of a cluster may share it. root: of the cache, only a key; tests change it.
    """
    del root
    version = (FORMAT, llvmlite.__version__, *target_data(), shipped.digest())
    return store.version_folder("loops", "\n".join(version))


def made(name: str, translate: Callable[[Unit], Any]) -> tuple[Law, Any]:
    """(machine code, JSON data) of the function of this name: shipped, from disk, or compiled.

    translate: writes the function ENTRY into a unit, and returns the JSON data.
    """
    code, known = shipped.kept(name) or _kept(name) or _translated(name, translate)
    return load([code], {}), json.loads(known)


def _kept(name: str) -> tuple[bytes, str] | None:
    """(object code, JSON data) from an earlier process, if they are on disk."""
    found = store.read(folder(str(store.cache_root())), name)
    parts = None if found is None else store.unpack(found)
    if parts is None:
        return None
    key, known = (part.decode() for part in parts)
    code = _code_of(key)
    return None if code is None else (code, known)


def _code_of(key: str) -> bytes | None:
    """The object code with this key for this machine, shipped or on disk; else None."""
    code = shipped.loops().code(key)
    return kept_code(key, shipped.target()) if code is None else code


def kept_code(key: str, target: shipped.Target | None) -> bytes | None:
    """The object code of this key for a target (None: exactly this processor) on disk."""
    found = store.read(laws_folder(str(store.cache_root())), _file_of(key, target))
    parts = None if found is None else store.unpack(found)
    return parts[0] if parts else None


def keep_code(key: str, target: shipped.Target | None, code: bytes) -> None:
    """Keep object code for `kept_code`."""
    place = laws_folder(str(store.cache_root()))
    store.write(place, _file_of(key, target), store.pack([code]))


def _file_of(key: str, target: shipped.Target | None) -> str:
    return f"loop-{'native' if target is None else target.processor}-{key}"


def _translated(name: str, translate: Callable[[Unit], Any]) -> tuple[bytes, str]:
    """(object code, JSON data) of a function: it is translated, which is fast, and compiled only if
    no object code of the same IR exists."""
    from rb_sim.compiler.unit import Unit, object_code  # a cached function needs no compiler

    unit = Unit()
    words = translate(unit)
    text, known = unit.text(), json.dumps(words)
    key = key_of(text)
    code = _code_of(key)
    if code is None:
        code = _compiled(lambda: object_code(text, shipped.target()))
        keep_code(key, shipped.target(), code)
    store.write(folder(str(store.cache_root())), name, store.pack([key.encode(), known.encode()]))
    return code, known


def key_of(text: str) -> str:
    """Key of the object code of a module of IR."""
    return hashlib.sha256(f"{FORMAT} {text}".encode()).hexdigest()[:40]


def _compiled(work: Callable[[], bytes]) -> bytes:
    """Result of a compilation; listeners are called at its begin and end."""
    for announce, _ in list(_hooks):
        announce()
    try:
        return aside(work)
    finally:
        for _, done in list(_hooks):
            done()


_left: list[threading.Event] = []
"""End events of compilations whose caller was interrupted by a signal."""


def left_alone() -> bool:
    """Whether an abandoned compilation still runs in LLVM: the interpreter must not exit yet."""
    return not all(done.is_set() for done in _left)


def aside(work: Callable[[], bytes]) -> bytes:
    """Do the work, in another thread if called from the main one; returns its result.

    Signals are not handled within a call of LLVM, which may take seconds.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    found: list[bytes] = []
    failed: list[BaseException] = []

    def do() -> None:
        try:
            found.append(work())
        except BaseException as error:
            failed.append(error)
        finally:
            done.set()

    done = threading.Event()
    threading.Thread(target=do, daemon=True).start()
    try:
        while not done.wait(0.05):
            pass
    except BaseException:
        _left.append(done)
        atexit.register(done.wait)
        raise
    if failed:
        raise failed[0]
    return found[0]


def name_of(function: FunctionType, tokens: str) -> str:
    """Name under which a function is stored, for argument kinds given by the tokens."""
    digest = hashlib.sha256(tokens.encode()).hexdigest()[:12]
    return f"{function.__module__}.{function.__qualname__}.{digest}"


class Translated(NamedTuple):
    """Arguments of `made`: the name of a function, and the function that writes it into a unit."""

    name: str
    translate: Callable[[Unit], Any]


PROGRAMS: WeakSet[Any] = WeakSet()
"""All entries of the imported modules that C or Python calls."""


class ForC:
    """A function to be called by its address.

    kinds: of its arguments; result: kind of the returned number, None without one.
    """

    def __init__(self, function: Any, kinds: Sequence[Kind], result: Kind | None) -> None:
        self.function, self.kinds, self.result = function, tuple(kinds), result
        self._code: Law | None = None
        PROGRAMS.add(self)

    @property
    def address(self) -> Any:
        """Address of the code, compiled on first use; the Python function itself if interpreted."""
        if interpreted():
            return self.function
        if self._code is None:
            with _LOCK:  # another thread may have compiled it meanwhile
                if self._code is None:
                    self._code, _ = made(*self.translated())
        return self._code.address

    def translated(self) -> Translated:
        """Name and translation of the function as C calls it."""
        tokens = f"{[words_of(kind) for kind in self.kinds]} {self.result}"

        def translate(unit: Unit) -> str:
            unit.for_c(self.function, self.kinds, self.result, ENTRY)
            return ""

        return Translated(name_of(self.function, tokens), translate)


class Entry:
    """A function that Python calls with numbers, arrays and tuples, compiled for each combination
    of their kinds.

    Arrays that it returns are arguments or copies. The GIL is held meanwhile, so that no other
    thread changes the data.
    """

    def __init__(self, function: Any) -> None:
        self.function = function
        self.__doc__, self.__name__ = function.__doc__, function.__name__
        self.__qualname__, self.__module__ = function.__qualname__, function.__module__
        self._programs: dict[tuple[Any, ...], Any] = {}
        self.called_with: list[list[Kind]] = []
        """Kinds of arguments of all calls so far; `tools.loops` lists them for `ship`."""
        self._plain = interpreted()
        PROGRAMS.add(self)

    def __call__(self, *arguments: Any) -> Any:
        """Call the function; it is compiled first for new kinds of arguments."""
        if self._plain:
            return self.function(*arguments)
        tokens, numbers, arrays = flattened(arguments)
        program = self._programs.get(tokens)
        if program is None:
            with _LOCK:
                program = self._programs.get(tokens)
                if program is None:
                    program = self._programs[tokens] = self._program(arguments)
        return program(numbers, arrays)

    def _program(self, arguments: Sequence[Any]) -> Any:
        """The compiled function for arguments of these kinds."""
        kinds = [kind_of(argument) for argument in arguments]
        law, (words, new) = made(*self.translated(kinds))
        self.called_with.append(kinds)
        return Program(law, kinds, kind_from(words), new)

    def translated(self, kinds: Sequence[Kind]) -> Translated:
        """Name and translation of the function as Python calls it with these kinds."""

        def translate(unit: Unit) -> list[Any]:
            result, new = unit.for_python(self.function, kinds, ENTRY)
            return [words_of(result), new]

        return Translated(
            name_of(self.function, str([words_of(kind) for kind in kinds])), translate
        )
