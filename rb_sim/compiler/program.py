# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Functions that C or Python calls, compiled when they are first needed and kept on disk.

Any number of threads and processes may compile at once: what one has written, the others take, and
what two make at the same time is the same.
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
from rb_sim.graph import store
from rb_sim.graph.machine import ENTRY, Law, interpreted, load, target_data
from rb_sim.graph.machine import folder as laws_folder

if TYPE_CHECKING:
    from rb_sim.compiler.unit import Unit


# Arguments of Python's for compiled functions, and back: numbers and addresses in slots.


_NUMBERS = {"real": REAL, "integer": INTEGER, "boolean": BOOLEAN, "complex": COMPLEX}
_SLOTS = {"double": "d", "i64": "q", "i1": "q", "ptr": "q"}
_place_of = ctypes.addressof
_first_byte: Any = ctypes.c_char.from_buffer
_KNOWN: dict[int, tuple[np.ndarray, int]] = {}
"""Arrays that have been asked for lately, and where they are; what is held keeps its id."""
MOST_KNOWN, MOST_HELD = 128, 1 << 20
"""How many arrays are held, and bytes of one above which it is not."""


def address_of(array: np.ndarray) -> int:
    """Where the numbers of a C-contiguous array are; numpy takes ten times as long to tell."""
    known = _KNOWN.get(id(array))
    if known is not None:
        return known[1]
    try:
        place = _place_of(_first_byte(array))
    except (TypeError, ValueError):  # empty, not to be written to, or not in one piece
        if not array.flags.c_contiguous:
            raise TypeError("an array of a compiled function is C-contiguous") from None
        place = array.ctypes.data
    if array.nbytes <= MOST_HELD:
        if len(_KNOWN) >= MOST_KNOWN:
            _KNOWN.clear()
        _KNOWN[id(array)] = array, place
    return place


Arrays = dict[tuple[int, tuple[int, ...]], np.ndarray]
"""Arrays by where they are and by their lengths: a view may begin where its array does."""
Flattened = tuple[tuple[Any, ...], list[Any], Arrays]


def flattened(arguments: Sequence[Any]) -> Flattened:
    """(what tells arguments of other kinds apart, the numbers of the arguments in turn, the arrays
    among them by where they are)."""
    tokens: list[Any] = []
    numbers: list[Any] = []
    arrays: Arrays = {}
    for argument in arguments:
        _tell(argument, tokens, numbers, arrays)
    return tuple(tokens), numbers, arrays


def _tell(argument: Any, tokens: list[Any], numbers: list[Any], arrays: Arrays) -> None:
    """Append the tokens and numbers of one argument."""
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
    """The kind of an argument."""
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
    """A compiled function for arguments of its kinds."""

    def __init__(self, law: Any, kinds: Sequence[Kind], result: Kind, new: bool) -> None:
        """new: there may be arrays in the result that the function has made."""
        self._law, self._result, self._new = law, result, new
        self._call = _CALL(law.address)
        given = [leaf for kind in kinds for leaf in kind.leaves]
        self._into = struct.Struct("=q" + "".join(_SLOTS[leaf] for leaf in given))
        self._out = struct.Struct("=" + "".join(_SLOTS[leaf] for leaf in result.leaves))
        self._at = self._into.size
        self._buffers: list[Any] = []
        """Slots that nobody uses at the moment."""

    def __call__(self, numbers: list[Any], arrays: Arrays) -> Any:
        """Call the code with the numbers; arrays in its result are those given or new copies."""
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
        if self._new and _FIRST.unpack_from(buffer)[0]:  # made, and copied by now: free them
            self._call(buffer)
        self._buffers.append(buffer)
        return result


def _back(kind: Kind, leaves: Iterator[Any], arrays: Arrays) -> Any:
    """A value of Python's from its leaves."""
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
    """A copy of the array at the place."""
    dtype = next(dtype for dtype, element in DTYPES.items() if element == kind.element)
    count = math.prod(shape)
    data = (ctypes.c_char * (count * dtype.itemsize)).from_address(place)
    return np.frombuffer(bytes(data), dtype).reshape(shape).copy()


def words_of(kind: Kind) -> Any:
    """The kind as words that can be written down."""
    if isinstance(kind, Tuple):
        of = None if kind.of is None else [kind.of.__module__, kind.of.__qualname__]
        return ["tuple", of, *(words_of(k) for k in kind.kinds)]
    if isinstance(kind, Array):
        return ["array", kind.element, kind.ndim]
    if isinstance(kind, Object):
        return "nothing"
    return next((word for word, k in _NUMBERS.items() if k == kind), type(kind).__name__.lower())


def kind_from(words: Any) -> Kind:
    """The kind of which these are the words."""
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
"""One function is made at a time: it is mostly Python, and nobody makes what another one makes."""
Hook = Callable[[], None]
_hooks: list[tuple[Hook, Hook]] = []


@contextmanager
def on_compilation(announce: Hook, done: Hook = lambda: None) -> Iterator[None]:
    """Inside the block, call `announce` whenever a function begins to be compiled, `done` when that
    ends.

    What comes from the disk is not compiled.
    """
    hooks = announce, done
    _hooks.append(hooks)
    try:
        yield
    finally:
        _hooks.remove(hooks)


@cache
def folder(root: str) -> pathlib.Path | None:
    """The folder of what is known of functions of exactly these sources, on this processor; None
    if it cannot be written. Machines of a cluster may share it.

    root: of the cache; tests change it.
    """
    del root
    version = (FORMAT, llvmlite.__version__, *target_data(), shipped.digest())
    return store.version_folder("loops", "\n".join(version))


def made(name: str, translate: Callable[[Unit], Any]) -> tuple[Law, Any]:
    """The function of this name and what `translate` knows of it: shipped, from disk, or
    translated.

    translate: writes the function ENTRY into a unit, and returns what is to be known of it.
    """
    code, known = shipped.kept(name) or _kept(name) or _translated(name, translate)
    return load([code], {}), json.loads(known)


def _kept(name: str) -> tuple[bytes, str] | None:
    """(object code, what is to be known of it) as an earlier start has left it on disk."""
    found = store.read(folder(str(store.cache_root())), name)
    parts = None if found is None else store.unpack(found)
    if parts is None:
        return None
    key, known = (part.decode() for part in parts)
    code = _code_of(key)
    return None if code is None else (code, known)


def _code_of(key: str) -> bytes | None:
    """The object code of this key for this machine, shipped or on disk."""
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
    """(object code, what is to be known of it) of a function: translated, which is quick; compiled
    only where no source has ever been translated to the same."""
    from rb_sim.compiler.unit import Unit, object_code  # what is kept needs no compiler

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
    """The name of the object code of a module of IR."""
    return hashlib.sha256(f"{FORMAT} {text}".encode()).hexdigest()[:40]


def _compiled(work: Callable[[], bytes]) -> bytes:
    """What LLVM makes; listeners hear of begin and end."""
    for announce, _ in list(_hooks):
        announce()
    try:
        return aside(work)
    finally:
        for _, done in list(_hooks):
            done()


_left: list[threading.Event] = []
"""The ends of compilations of which a signal has called the caller away."""


def left_alone() -> bool:
    """Whether LLVM is still at work for nobody: Python may not take itself apart meanwhile."""
    return not all(done.is_set() for done in _left)


def aside(work: Callable[[], bytes]) -> bytes:
    """Do the work and return its result.

    Called in the main thread, another one does it: no signal is answered within a call of LLVM,
    which may take seconds.
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
    """The name under which a function is kept, for arguments that the tokens tell."""
    digest = hashlib.sha256(tokens.encode()).hexdigest()[:12]
    return f"{function.__module__}.{function.__qualname__}.{digest}"


class Translated(NamedTuple):
    """What `made` takes: the name of a function, and what writes it into a unit."""

    name: str
    translate: Callable[[Unit], Any]


PROGRAMS: WeakSet[Any] = WeakSet()
"""All functions that C or Python calls, of the modules that are imported."""


class ForC:
    """A function for calls by its address.

    kinds: of its arguments; result: kind of the number that it returns, None of nothing.
    """

    def __init__(self, function: Any, kinds: Sequence[Kind], result: Kind | None) -> None:
        self.function, self.kinds, self.result = function, tuple(kinds), result
        self._code: Law | None = None
        PROGRAMS.add(self)

    @property
    def address(self) -> Any:
        """Compiles it where it is not yet; the function itself where nothing is compiled."""
        if interpreted():
            return self.function
        if self._code is None:
            with _LOCK:  # what another thread has made by now may be running
                if self._code is None:
                    self._code, _ = made(*self.translated())
        return self._code.address

    def translated(self) -> Translated:
        """The function as C calls it."""
        tokens = f"{[words_of(kind) for kind in self.kinds]} {self.result}"

        def translate(unit: Unit) -> str:
            unit.for_c(self.function, self.kinds, self.result, ENTRY)
            return ""

        return Translated(name_of(self.function, tokens), translate)


class Entry:
    """A function that Python calls with numbers, arrays and tuples of them, compiled for each
    combination of their kinds.

    Arrays in what it returns are those that it was given.  Python's lock is kept meanwhile: nobody
    else changes what the function works on.
    """

    def __init__(self, function: Any) -> None:
        self.function = function
        self.__doc__, self.__name__ = function.__doc__, function.__name__
        self.__qualname__, self.__module__ = function.__qualname__, function.__module__
        self._programs: dict[tuple[Any, ...], Any] = {}
        self.called_with: list[list[Kind]] = []
        """Kinds of arguments with which it has been called; `ship` keeps a list of them."""
        self._plain = interpreted()
        PROGRAMS.add(self)

    def __call__(self, *arguments: Any) -> Any:
        """Call the function; compile it first for kinds of arguments that are new."""
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
        """The function for arguments like these."""
        kinds = [kind_of(argument) for argument in arguments]
        law, (words, new) = made(*self.translated(kinds))
        self.called_with.append(kinds)
        return Program(law, kinds, kind_from(words), new)

    def translated(self, kinds: Sequence[Kind]) -> Translated:
        """The function for arguments of these kinds, as Python calls it."""

        def translate(unit: Unit) -> list[Any]:
            result, new = unit.for_python(self.function, kinds, ENTRY)
            return [words_of(result), new]

        return Translated(
            name_of(self.function, str([words_of(kind) for kind in kinds])), translate
        )
