"""Functions that C or Python calls, compiled when they are first needed and kept on disk.

Any number of threads and processes may compile at once: what one has written, the others take, and
what two make at the same time is the same.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import pathlib
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from types import FunctionType
from typing import TYPE_CHECKING, Any

import llvmlite

from rb_sim.compiler.arrays import checked
from rb_sim.compiler.kinds import Kind
from rb_sim.compiler.marshal import Program, kind_from, kind_of, told, words_of
from rb_sim.graph import store
from rb_sim.graph.machine import ENTRY, Law, interpreted, load, target_data

if TYPE_CHECKING:
    from rb_sim.compiler.unit import Unit

FORMAT = "1"

ROOMS = ("compiler", "graph", "loops", "maths", "catalogue", "engine", "contact")
"""Folders of the package in which functions lie that are compiled; a test sees that it is all."""

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


def sources() -> list[pathlib.Path]:
    """All sources of ROOMS."""
    package = pathlib.Path(__file__).resolve().parent.parent
    return [source for room in ROOMS for source in sorted((package / room).rglob("*.py"))]


@cache
def folder(root: str) -> pathlib.Path | None:
    """The folder of compiled functions of exactly these sources, on this processor; None if it
    cannot be written. Machines of a cluster may share it.

    root: of the cache; tests change it.
    """
    del root
    digest = hashlib.sha256()
    for source in sources():
        digest.update(source.read_bytes())
    version = (FORMAT, f"{checked()}", llvmlite.__version__, *target_data(), digest.hexdigest())
    return store.version_folder("loops", "\n".join(version))


def made(name: str, translate: Callable[[Unit], Any]) -> tuple[Law, Any]:
    """The function of this name and what `translate` has told of it: from disk, or translated.

    translate: writes the function ENTRY into a unit, and returns what is to be known of it.
    """
    place = folder(str(store.cache_root()))
    kept = store.read(place, name)
    parts = None if kept is None else store.unpack(kept)
    if parts is None:
        parts = _compiled(translate)
        store.write(place, name, store.pack(parts))
    code, told = parts
    externals, words = json.loads(told)
    return load([code], {symbol: _address_of(symbol) for symbol in externals}), words


def _compiled(translate: Callable[[Unit], Any]) -> list[bytes]:
    """Machine code, and what is to be known of it."""
    for announce, _ in list(_hooks):
        announce()
    from rb_sim.compiler.unit import Unit, object_code  # what is kept needs no compiler

    try:
        unit = Unit()
        words = translate(unit)
        code = aside(lambda: object_code(unit.text()))
        return [code, json.dumps([sorted(unit.externals), words]).encode()]
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


def _address_of(symbol: str) -> int:
    """Where a function is that no C library has."""
    from rb_sim.compiler.lapack import address

    return address(symbol)


def name_of(function: FunctionType, tokens: str) -> str:
    """The name under which a function is kept, for arguments that the tokens tell."""
    digest = hashlib.sha256(tokens.encode()).hexdigest()[:12]
    return f"{function.__module__}.{function.__qualname__}.{digest}"


class ForC:
    """A function for calls by its address.

    kinds: of its arguments; result: kind of the number that it returns, None of nothing.
    """

    def __init__(self, function: Any, kinds: Sequence[Kind], result: Kind | None) -> None:
        self.function, self.kinds, self.result = function, tuple(kinds), result
        self._code: Law | None = None

    @property
    def address(self) -> Any:
        """Compiles it where it is not yet; the function itself where nothing is compiled."""
        if interpreted():
            return self.function
        if self._code is None:
            tokens = f"{[words_of(kind) for kind in self.kinds]} {self.result}"
            with _LOCK:  # what another thread has made by now may be running
                if self._code is None:
                    self._code, _ = made(name_of(self.function, tokens), self._translated)
        return self._code.address

    def _translated(self, unit: Unit) -> str:
        unit.for_c(self.function, self.kinds, self.result, ENTRY)
        return ""


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
        self._plain = interpreted()

    def __call__(self, *arguments: Any) -> Any:
        if self._plain:
            return self.function(*arguments)
        tokens, numbers, arrays = told(arguments)
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

        def translated(unit: Unit) -> list[Any]:
            result, new = unit.for_python(self.function, kinds, ENTRY)
            return [words_of(result), new]

        name = name_of(self.function, str([words_of(kind) for kind in kinds]))
        law, (words, new) = made(name, translated)
        return Program(law, kinds, kind_from(words), new)
