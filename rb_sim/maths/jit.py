"""What kernels see of numba: `inline` helpers, `dispatch` by type, `entry` kernels.

The compiled program of a scene is chosen by *types*: every effect, coordinate set and method is a
NamedTuple class, and `dispatch` binds a call to the kernel registered for the class of its first
argument while numba compiles.  What a scene does not name is therefore not in its machine code at
all; there is no table to walk and no flag to test.  With NUMBA_DISABLE_JIT=1 the same sources run
as plain Python.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import inspect
import os
import pathlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numba
from numba.core import event
from numba.extending import overload

from rb_sim.graph.functions import explored
from rb_sim.graph.machine import interpreted
from rb_sim.loops.compiled import INNER, LAW

_OPTIONS: Any = {"error_model": "numpy"}
_config: Any = numba.config  # type: ignore[attr-defined]

Kernel = Callable[..., Any]


def _compiled_as(function: Kernel, choose: Callable[..., Any]) -> None:
    """Let compiled callers of `function` call what `choose` gives for their types."""
    overload(function, strict=False, jit_options=INNER)(choose)


def inline(function: Kernel) -> Any:
    """`function` is compiled with its callers; called from Python it stays plain Python."""
    _compiled_as(function, lambda *arguments: function)
    return function


plain = inline


def branching(function: Kernel) -> Any:
    """As `inline`, for a short function that branches on numbers: traced, every way is taken."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        return explored(function, *arguments)

    _compiled_as(call, lambda *arguments: function)
    return call


def sources_in(package: pathlib.Path, places: Sequence[str]) -> list[pathlib.Path]:
    """The sources at these places of the package: files, and folders with all that is in them."""
    paths = [package / place for place in places]
    return [
        source
        for path in paths
        for source in (sorted(path.rglob("*.py")) if path.is_dir() else [path])
    ]


_PLACES = (
    "graph", "loops", "maths", "catalogue", "engine",
    "contact/friction.py", "contact/geometry", "contact/grid.py", "contact/system",
    "contact/events",
)  # fmt: skip
"""Sources of the package that entries call; a test of the architecture misses what is not here."""


def cache_directory() -> pathlib.Path:
    """Folder of the compiled code for exactly these sources.

    numba does not notice a change in a file that a cached kernel only calls into, so the folder's
    name is a hash of all sources that entries call.
    """
    root = os.environ.get("RB_SIM_CACHE")
    if not root:
        base = os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache"
        root = str(pathlib.Path(base) / "rb_sim")
    package = pathlib.Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sources_in(package, _PLACES):
        digest.update(source.read_bytes())
    return pathlib.Path(root) / digest.hexdigest()[:16]


_CACHE_DIRECTORY = str(cache_directory())


def entry(function: Kernel) -> Any:
    """Compile `function` for calls from Python, cached on disk; module-level functions only.

    (Closures never hit numba's cache: issue 6264 of numba.)
    """
    previous, _config.CACHE_DIR = _config.CACHE_DIR, _CACHE_DIRECTORY
    try:
        return numba.njit(cache=True, **_OPTIONS)(function)
    except (OSError, RuntimeError):  # no writable cache folder: compile in every process
        return numba.njit(**_OPTIONS)(function)
    finally:
        _config.CACHE_DIR = previous


def python_of(function: Any) -> Any:
    """The entry as plain Python, which compiles nothing."""
    return getattr(function, "py_func", function)


@contextmanager
def on_compilation(
    announce: Callable[[], None], done: Callable[[], None] = lambda: None
) -> Iterator[None]:
    """Inside the block, call `announce` whenever numba begins to compile a function, `done` when it
    ends.

    What comes from the cache is not compiled.
    """

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            _garbage.begin()
            announce()

        def on_end(self, event: Any) -> None:
            _garbage.end()
            done()

    listener = Listener()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
        _garbage.leave()


class _Garbage:
    """How often Python looks for garbage: seldom while numba compiles, under its lock.

    A compiler makes many objects that stay; to walk over them again and again is a sixth of the
    time of numba's front end, and to do so seldom costs 20 MB.
    """

    SELDOM = (100_000, 20, 50)

    def __init__(self) -> None:
        self.depth = 0
        self.often: tuple[int, int, int] | None = None

    def begin(self) -> None:
        self.depth += 1
        if 0 < gc.get_threshold()[0] < self.SELDOM[0]:
            self.often = gc.get_threshold()
            gc.set_threshold(*self.SELDOM)

    def end(self) -> None:
        self.depth -= 1
        if self.depth <= 0:
            self.leave()

    def leave(self) -> None:
        """As before; also after a signal, which ends a compilation without its `end`."""
        self.depth = 0
        if self.often is not None and gc.get_threshold() == self.SELDOM:
            gc.set_threshold(*self.often)


_garbage = _Garbage()


def by_type(
    stub: Kernel,
    choose: Callable[..., Kernel | None],
    choose_plain: Kernel,
    *,
    fused: bool = True,
) -> Kernel:
    """A function whose implementation is chosen from its argument types.

    stub: gives name, signature and docstring.
    choose: gets numba types, returns the Python function to compile (same signature as the stub).
    choose_plain: the implementation that runs when called from plain Python.
    fused: dissolve in the caller; False for long bodies called from several places, which are then
        compiled once.
    """
    names = ", ".join(inspect.signature(stub).parameters)
    space: dict[str, Any] = {"choose": choose, "run": choose_plain}
    exec(f"def typed({names}):\n    return choose({names})\n", space)
    exec(f"def call({names}):\n    return run({names})\n", space)
    call: Kernel = space["call"]
    call.__name__, call.__doc__, call.__qualname__ = stub.__name__, stub.__doc__, stub.__name__
    _compiled_as(call, space["typed"])
    return call


def dispatch(stub: Kernel, fused: bool = True) -> Any:
    """A function that calls the kernel registered for the class of its first argument.

    Kernels are added by the decorator `name.register(*NamedTuple classes)`; `name.kernels` maps
    the classes to them.  The stub gives name, arguments and meaning.
    """
    kernels: dict[type, Any] = {}

    def typed(*arguments: Any) -> Kernel | None:
        kind = getattr(arguments[0], "instance_class", type(arguments[0]))
        return kernels.get(kind)  # itself: a function around it would be a module more to compile

    def plain_call(*arguments: Any) -> Any:
        return kernels[type(arguments[0])](*arguments)

    call: Any = by_type(stub, typed, plain_call, fused=fused)

    def register(*kinds: type) -> Callable[[Kernel], Any]:
        def add(kernel: Kernel) -> Any:
            compiled = inline(kernel)
            for kind in kinds:
                kernels[kind] = compiled
            return compiled

        return add

    call.kernels, call.register = kernels, register
    return call


class ByAddress:
    """A function void f(t, y, p, out) of a floor above the loops that they call by its address."""

    def __init__(self, function: Kernel) -> None:
        self.function = function
        self._compiled: Any = None

    @property
    def address(self) -> Any:
        """Compiles it where it is not yet; the function itself where nothing is compiled."""
        if interpreted():
            return self.function
        if self._compiled is None:
            previous, _config.CACHE_DIR = _config.CACHE_DIR, _CACHE_DIRECTORY
            try:
                self._compiled = numba.cfunc(LAW, cache=True, **_OPTIONS)(self.function)
            except (OSError, RuntimeError):
                self._compiled = numba.cfunc(LAW, **_OPTIONS)(self.function)
            finally:
                _config.CACHE_DIR = previous
        return self._compiled.address


def by_address(function: Kernel) -> ByAddress:
    """Compile the function for calls by address, when it is first needed."""
    return ByAddress(function)
