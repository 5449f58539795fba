"""What numba does at every inner function of a kernel and need not: LLVM, level by level.

numba links every inner function with all that it calls, optimises it and translates it to machine
code, and then does it all again in the kernel, where everything ends up.  Inner functions that
Python cannot call are only kept here; the kernel links each of them once, and LLVM sees it alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from weakref import WeakSet

from llvmlite.binding import Linkage
from numba import _dynfunc
from numba.core.codegen import CPUCodeLibrary as Library
from numba.core.cpu import CPUContext

INNER: WeakSet[Library] = WeakSet()
"""Libraries of inner functions: without the code of what they call."""


@contextmanager
def llvm_once(outermost: str) -> Iterator[None]:
    """Inside the block, let LLVM work only on the library named `outermost`."""
    finalize, optimise = Library.finalize, Library._optimize_final_module
    executable = CPUContext.get_executable
    environments: list[tuple[str, Any]] = []

    def optimise_outermost(library: Any) -> None:
        if library.name == outermost:
            keep_to_itself(library)
            optimise(library)

    def finalize_or_keep(library: Any) -> None:
        if library in INNER:
            library._finalize_dynamic_globals()
            library._finalized = True
            return
        library._linking_libraries = called_by(library)
        finalize(library)

    def executable_or_stand_in(context: Any, library: Any, function: Any, environment: Any) -> Any:
        if library.name != outermost and not defines(library, function.llvm_cpython_wrapper_name):
            INNER.add(library)
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
    Library.finalize = finalize_or_keep
    CPUContext.get_executable = executable_or_stand_in
    try:
        yield
    finally:
        Library._optimize_final_module = optimise
        Library.finalize = finalize
        CPUContext.get_executable = executable


def called_by(library: Any) -> list[Any]:
    """All libraries whose code the library needs, callers first: LLVM links what is asked for."""
    found = list(dict.fromkeys(library._linking_libraries))
    seen = set(found)
    for one in found:
        if one in INNER:
            more = [inner for inner in one._linking_libraries if inner not in seen]
            found.extend(dict.fromkeys(more))
            seen.update(more)
    return found


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
