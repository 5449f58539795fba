"""Says that machine code is being made, which takes seconds, once for each simulation."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from rb_sim.maths.jit import on_compilation

Announce = Callable[[str], None]


def tell(line: str) -> None:
    """To standard error."""
    print(f"rb_sim: {line}", file=sys.stderr, flush=True)


def compiling(name: str) -> str:
    """The line about a scene."""
    return f"compiling {name} (first use, some seconds; later starts take it from the cache)"


class Announced:
    """A context in which compiling is told, the first time that it is entered; later it is free.

    name: of the scene. announce: gets the line; None tells nobody.
    """

    def __init__(self, name: str, announce: Announce | None) -> None:
        self._name, self._announce = name, announce
        self._stack = ExitStack()
        self._entered = False

    def __enter__(self) -> None:
        if self._announce is not None:
            self._entered = True
            self._stack.enter_context(on_compilation(self._say))

    def __exit__(self, *_: Any) -> None:
        if self._entered:
            self._announce, self._entered = None, False  # what is called again is compiled
            self._stack.close()

    def _say(self) -> None:
        announce, self._announce = self._announce, None
        if announce is not None:
            announce(compiling(self._name))
