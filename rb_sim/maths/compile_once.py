"""What numba does at every inner function of a kernel and need not: LLVM, level by level.

numba optimises every inner function together with all that it calls, and translates it to machine
code, and then does it all again in the kernel, where everything ends up.  Inner functions that
Python cannot call are only linked here; LLVM sees the kernel alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite.binding import Linkage
from numba import _dynfunc
from numba.core.codegen import CPUCodeLibrary as Library
from numba.core.cpu import CPUContext


@contextmanager
def llvm_once(outermost: str) -> Iterator[None]:
    """Inside the block, let LLVM work only on the library named `outermost`."""
    optimise, finish = Library._optimize_final_module, Library._finalize_final_module
    executable = CPUContext.get_executable
    only_linked: set[Any] = set()
    environments: list[tuple[str, Any]] = []

    def optimise_outermost(library: Any) -> None:
        if library.name == outermost:
            keep_to_itself(library)
            optimise(library)

    def finish_or_link(library: Any) -> None:
        if library not in only_linked:
            finish(library)
            return
        library._finalize_dynamic_globals()
        library._finalized = True

    def executable_or_stand_in(context: Any, library: Any, function: Any, environment: Any) -> Any:
        if library.name != outermost and not defines(library, function.llvm_cpython_wrapper_name):
            only_linked.add(library)
            library._ensure_finalized()
            environments.append((context.get_env_name(function), environment))
            names = function.lookup_module(), function.qualname, ""
            return _dynfunc.make_function(*names, 0, environment, (library,))
        found = executable(context, library, function, environment)
        if library.name == outermost:
            for name, inner in environments:
                if library.codegen._engine.is_symbol_defined(name):
                    library.codegen.set_env(name, inner)
        return found

    Library._optimize_final_module = optimise_outermost
    Library._finalize_final_module = finish_or_link
    CPUContext.get_executable = executable_or_stand_in
    try:
        yield
    finally:
        Library._optimize_final_module = optimise
        Library._finalize_final_module = finish
        CPUContext.get_executable = executable


def keep_to_itself(library: Any) -> None:
    """Make the inner functions internal: LLVM may then drop the arguments that they do not use.

    An array is nine arguments, of which a function reads three.
    """
    for function in library._final_module.functions:
        if not function.is_declaration and function.linkage is Linkage.linkonce_odr:
            function.linkage = Linkage.internal


def defines(library: Any, name: str) -> bool:
    """True if the library has the body of the function `name`."""
    try:
        return not library._final_module.get_function(name).is_declaration
    except NameError:
        return False
