# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A module of machine code: a function and all functions that it calls, optimised together."""

from __future__ import annotations

from collections.abc import Sequence
from types import FunctionType
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from rb_sim.compiler.arithmetic import converted
from rb_sim.compiler.builder import (
    DTYPES,
    ELEMENTS,
    HERE,
    Builder,
    Kind,
    Value,
    from_nowhere,
    origins_of,
    real_text,
)
from rb_sim.compiler.graph.machine import new_module, target_machine
from rb_sim.compiler.shipped import Target
from rb_sim.compiler.source import parameters_of, result_type, taken_apart
from rb_sim.compiler.translate import AgainError, CompileError, Translation

LEVEL = 2
"""Optimisation level of LLVM."""

KNOWN = {
    *("atan", "atan2", "asin", "acos", "cos", "exp", "expm1", "fmod", "hypot", "log", "log1p"),
    *("pow", "sin", "sincos", "sqrt", "tan", "tanh", "memcpy", "memmove", "memset"),
    *("malloc", "calloc", "free", "abort"),
}
"""Library functions that exist in every process."""

MOST_TRIES = 40
"""Most translations of one function; each knows more kinds than the previous one."""

_INTRINSICS = """
declare double @llvm.sqrt.f64(double)
declare double @llvm.sin.f64(double)
declare double @llvm.cos.f64(double)
declare double @llvm.exp.f64(double)
declare double @llvm.log.f64(double)
declare double @llvm.pow.f64(double, double)
declare double @llvm.fabs.f64(double)
declare double @llvm.floor.f64(double)
declare double @llvm.rint.f64(double)
declare double @llvm.copysign.f64(double, double)
declare i64 @llvm.abs.i64(i64, i1)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
declare noalias ptr @malloc(i64)
declare void @free(ptr)
declare void @abort() noreturn
!0 = !{}
"""

_MEMORY = """
define internal ptr @obtain(i64 %size, ptr %owner) nounwind {
  %whole = add i64 %size, 16
  %node = call ptr @malloc(i64 %whole)
  %next = load ptr, ptr %owner, align 8
  store ptr %next, ptr %node, align 8
  store ptr %node, ptr %owner, align 8
  %data = getelementptr i8, ptr %node, i64 16
  ret ptr %data
}
define internal void @release(ptr %owner) nounwind {
begin:
  %first = load ptr, ptr %owner, align 8
  br label %look
look:
  %node = phi ptr [ %first, %begin ], [ %next, %each ]
  %none = icmp eq ptr %node, null
  br i1 %none, label %done, label %each
each:
  %next = load ptr, ptr %node, align 8
  call void @free(ptr %node)
  br label %look
done:
  store ptr null, ptr %owner, align 8
  ret void
}
"""
"""Functions for new arrays, which form a linked list that a function frees when it ends."""


class Unit:
    """The functions that are translated into one module."""

    def __init__(self) -> None:
        self.declarations: set[str] = set()
        self._instances: dict[tuple[Any, tuple[Kind, ...]], tuple[str, Kind] | None] = {}
        self._texts: list[str] = []
        self._tables: dict[tuple[str, bytes], str] = {}

    def instance(self, function: FunctionType, kinds: tuple[Kind, ...]) -> tuple[str, Kind]:
        """(name, kind of the result) of the function for arguments of these kinds."""
        key = function, kinds
        if key in self._instances:
            found = self._instances[key]
            if found is None:
                raise CompileError(f"{function.__qualname__} calls itself")
            return found
        self._instances[key] = None
        name = f'@"{function.__qualname__}.{len(self._instances)}"'
        text, result = self._translated(function, kinds, name)
        self._texts.append(text)
        self._instances[key] = name, result
        return name, result

    def _translated(
        self, function: FunctionType, kinds: tuple[Kind, ...], name: str
    ) -> tuple[str, Kind]:
        """(definition, kind of the result) of a function for arguments of these kinds."""
        known_kinds: dict[str, Kind] = {}
        words = [word for word, _ in parameters_of(function)]
        for _ in range(MOST_TRIES):
            arguments = {
                word: Value(kind, tuple(f"%{word}.{i}" for i in range(len(kind.leaves))))
                for word, kind in zip(words, kinds, strict=True)
            }
            try:
                return Translation(self, function, known_kinds).function_text(name, arguments)
            except AgainError:
                continue
        raise CompileError(f"{function.__qualname__}: kinds of variables that never agree")

    def table(self, array: np.ndarray) -> str:
        """Name of the table of a constant array."""
        element = DTYPES[array.dtype]
        data = np.ascontiguousarray(array)
        key = element, data.tobytes()
        if key not in self._tables:
            name = f"@table.{len(self._tables)}"
            numbers = data.ravel().tolist()
            texts = [real_text(x) if element == "real" else str(int(x)) for x in numbers]
            inside = ", ".join(f"{ELEMENTS[element]} {x}" for x in texts)
            self._texts.append(
                f"{name} = private unnamed_addr constant [{len(texts)} x {ELEMENTS[element]}] "
                f"[{inside}], align 16\n"
            )
            self._tables[key] = name
        return self._tables[key]

    def for_c(
        self, function: FunctionType, kinds: Sequence[Kind], result: Kind | None, name: str
    ) -> None:
        """Add the function with a C signature: its arguments in order; returns a number or
        nothing."""
        callee, made = self.instance(function, tuple(kinds))
        if HERE in origins_of(made):
            raise CompileError(f"{function.__qualname__} returns an array that it has made")
        f = Builder()
        leaves = [leaf for kind in kinds for leaf in kind.leaves]
        given = ", ".join(f"{leaf} %a{i}" for i, leaf in enumerate(leaves))
        call = f"call fastcc {result_type(made)} {callee}({given})"
        if result is None:
            f.do(call)
            f.do("ret void")
        else:
            value = converted(f, taken_apart(f, f.get(call), made), result)
            f.do(f"ret {result_type(result)} {value.leaf}")
        head = f"define {'void' if result is None else result_type(result)} @{name}({given})"
        self._texts.append(f"{head} nounwind {{\n{f.text()}\n}}\n")

    def for_python(
        self, function: FunctionType, kinds: Sequence[Kind], name: str
    ) -> tuple[Kind, bool]:
        """Add the function as void f(slots): arguments in slots of eight bytes, followed by the
        results.

        Returns (kind of the result, whether it may contain arrays made by the function). Slot 0
        gets the list of these arrays, or 0; a call with a nonzero slot 0 only frees them.
        """
        callee, made = self.instance(function, tuple(kinds))
        f, given, at = Builder(), [], 1
        free, go_on = f.label("free"), f.label("call")
        f.part(f.get(f"icmp ne i64 {f.load('i64', '%slots')}, 0"), free, go_on)
        f.begin(free)
        f.do("call void @release(ptr %slots)")
        f.do("ret void")
        f.begin(go_on)
        for kind in kinds:
            for leaf in kind.leaves:
                given.append(f"{leaf} {_from_slot(f, leaf, at)}")
                at += 1
        if HERE in origins_of(made):
            given.append("ptr %slots")
        call = f"call fastcc {result_type(made)} {callee}({', '.join(given)})"
        if made.leaves:
            value = taken_apart(f, f.get(call), made)
            for leaf, type_ in zip(value.leaves, made.leaves, strict=True):
                _into_slot(f, leaf, type_, at)
                at += 1
        else:
            f.do(call)
        f.do("ret void")
        self._texts.append(f"define void @{name}(ptr %slots) nounwind {{\n{f.text()}\n}}\n")
        return from_nowhere(made), HERE in origins_of(made)

    def text(self) -> str:
        """The module as LLVM IR."""
        return "\n".join([*sorted(self.declarations), _INTRINSICS, _MEMORY, *self._texts])


def _from_slot(f: Builder, kind: str, at: int) -> str:
    """The value in a slot."""
    place = f.place("i64", "%slots", str(at))
    if kind == "i1":
        return f.get(f"trunc i64 {f.load('i64', place)} to i1")
    return f.load(kind, place)


def _into_slot(f: Builder, leaf: str, kind: str, at: int) -> None:
    """Store a value in a slot."""
    place = f.place("i64", "%slots", str(at))
    if kind == "i1":
        leaf, kind = f.get(f"zext i1 {leaf} to i64"), "i64"
    f.store(kind, leaf, place)


def object_code(text: str, target: Target | None = None) -> bytes:
    """Object code of the module, optimised for the target or for this machine's processor.

    Raises CompileError for a call of a function that is not in KNOWN.
    """
    machine = target_machine(LEVEL) if target is None else target.machine(LEVEL)
    module = new_module(text)
    if target is not None:
        module.triple, module.data_layout = target.triple, str(machine.target_data)
    _optimise(module, machine)
    for function in module.functions:
        name = function.name
        if function.is_declaration and not name.startswith("llvm.") and name not in KNOWN:
            raise CompileError(f"{name}: a function that not every process has")
    return machine.emit_object(module)


def _optimise(module: Any, machine: Any) -> None:
    """Run LLVM's optimisation passes on the module."""
    if hasattr(llvm, "create_new_module_pass_manager"):
        options = llvm.create_pipeline_tuning_options(speed_level=LEVEL)
        passes = llvm.create_pass_builder(machine, options)
        passes.getModulePassManager().run(module, passes)
        return
    old: Any = llvm  # up to llvmlite 0.43
    builder, manager = old.create_pass_manager_builder(), old.create_module_pass_manager()
    builder.opt_level, builder.inlining_threshold = LEVEL, 225
    builder.loop_vectorize = builder.slp_vectorize = True
    machine.add_analysis_passes(manager)
    builder.populate(manager)
    manager.run(module)
