"""How functions of catalogue and contact are marked: what is compiled, and how it is chosen.

Functions stay plain Python, which the trace of a law and RB_SIM_INTERPRETED=1 run as they are; what
compiled code calls is compiled with it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from rb_sim.compiler.dispatch import dispatch
from rb_sim.compiler.program import Entry, on_compilation
from rb_sim.graph.functions import explored
from rb_sim.loops.compiled import by_address

__all__ = ["branching", "by_address", "dispatch", "entry", "inline", "on_compilation"]

Kernel = Callable[..., Any]


def inline(function: Kernel) -> Any:
    """Mark a function that is compiled with its callers; called from Python it is as it is."""
    return function


def branching(function: Kernel) -> Any:
    """As `inline`, for a short function that branches on numbers: traced, every way is taken."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        return explored(function, *arguments)

    call.compiled_as = function  # type: ignore[attr-defined]
    return call


def entry(function: Kernel) -> Any:
    """Compile a function for calls from Python with arrays, numbers and tuples of them."""
    return Entry(function)


def python_of(function: Any) -> Any:
    """The plain Python function of what is called: it compiles nothing."""
    return getattr(function, "function", function)
