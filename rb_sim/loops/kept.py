"""Machine code of loops, kept on disk beside numba's own cache: to load it takes no numba.

numba gives the LLVM IR of a function that C can call. Where that is on its own (it calls nothing of
numba's or of Python's, since nothing in it can fail), its object code is kept as that of a law is:
the next start links it in a millisecond, where numba first sets up all that it could compile, and
imports scipy's linear algebra for it.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm

from rb_sim.graph import store
from rb_sim.graph.machine import ENTRY, Law, assembled, load, new_module, pack, unpack

LEVEL = 3
"""At which LLVM chooses the instructions, as numba has it."""

KNOWN = {
    *("atan", "atan2", "asin", "acos", "cos", "exp", "expm1", "fmod", "hypot", "log", "log1p"),
    *("pow", "sin", "sincos", "sqrt", "tan", "cbrt", "ceil", "floor", "memcpy", "memmove"),
    "memset",
}
"""Functions that every process has."""


def kept(folder: Any, name: str) -> Law | None:
    """The function of this name in the folder; None where it is not there, or damaged."""
    data = store.read(folder, name)
    objects = None if data is None else unpack(data)
    return None if objects is None else load(objects)


def keep(folder: Any, name: str, text: str, symbol: str) -> Law | None:
    """Keep the function `symbol` of a module of LLVM IR under this name, and load it; None where it
    is not on its own."""
    module = alone(text, symbol)
    if module is None:
        return None
    objects = [assembled(module, LEVEL)]
    store.write(folder, name, pack(objects))
    return load(objects)


def alone(text: str, symbol: str) -> Any | None:
    """The module with its function `symbol`, called ENTRY, and what that calls; None where it calls
    something that a process without numba does not have.

    What the other functions return becomes known to LLVM as they are no longer for anybody else: a
    call that cannot fail loses the way to an exception of Python's.
    """
    passes = getattr(llvm, "create_new_module_pass_manager", None)
    if passes is None:  # up to llvmlite 0.44
        return None
    module = new_module(text)
    for function in module.functions:
        if not function.is_declaration:
            function.linkage = "external" if function.name == symbol else "internal"
    manager = passes()
    manager.add_ipsccp_pass()
    manager.add_simplify_cfg_pass()
    manager.add_global_dead_code_eliminate_pass()
    manager.run(module, _builder())
    strange = [
        value.name
        for value in (*module.functions, *module.global_variables)
        if value.is_declaration and not value.name.startswith("llvm.") and value.name not in KNOWN
    ]
    if strange:
        return None
    module.get_function(symbol).name = ENTRY
    module.verify()
    return module


def _builder() -> Any:
    """What a pass manager of LLVM wants to know."""
    from rb_sim.graph.machine import target_machine

    return llvm.create_pass_builder(target_machine(LEVEL), llvm.create_pipeline_tuning_options())
