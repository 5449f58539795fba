"""Functions whose kernel is chosen by the class of their first argument.

What a scene does not name is not in its machine code: the choice is made while compiling.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from rb_sim.compiler.kinds import Kind, Tuple

Kernel = Callable[..., Any]


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
