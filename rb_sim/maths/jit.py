"""How functions of catalogue and contact are marked: what is compiled, and how it is chosen.

Functions stay plain Python, which the trace of a law and RB_SIM_INTERPRETED=1 run as they are; what
compiled code calls is compiled with it.  `dispatch` chooses a kernel by the class of its first
argument: what a scene does not name is not in its machine code.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from rb_sim.compiler.kinds import Kind, Tuple
from rb_sim.compiler.program import Entry, on_compilation
from rb_sim.graph.functions import explored
from rb_sim.loops.compiled import by_address

__all__ = ["branching", "by_address", "dispatch", "entry", "inline", "on_compilation", "plain"]

Kernel = Callable[..., Any]


def inline(function: Kernel) -> Any:
    """Mark a function that is compiled with its callers; called from Python it is as it is."""
    return function


plain = inline


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
    """What is called, as plain Python, which compiles nothing."""
    return getattr(function, "function", function)


def dispatch(stub: Kernel) -> Any:
    """A function that calls the kernel registered for the class of its first argument.

    Kernels are added by the decorator `name.register(*classes)`; `name.kernels` maps the classes
    to them.  The stub gives name, arguments and meaning.
    """
    kernels: dict[type, Any] = {}

    @functools.wraps(stub)
    def call(first: Any, *others: Any) -> Any:
        return kernels[type(first)](first, *others)

    def chosen(kinds: list[Kind]) -> Kernel:
        """The kernel for arguments of these kinds."""
        kind = kinds[0]
        of = kind.of if isinstance(kind, Tuple) else type(kind)
        if of not in kernels:
            raise TypeError(f"{stub.__name__}: no kernel for {of}")
        return kernels[of]

    def register(*kinds: type) -> Callable[[Kernel], Any]:
        def add(kernel: Kernel) -> Any:
            for kind in kinds:
                kernels[kind] = kernel
            return kernel

        return add

    of_stub: Any = call
    of_stub.kernels, of_stub.register, of_stub.chosen = kernels, register, chosen
    return call
