"""Instances of one kind: which of their numbers are in the kernel, which come from a table.

What is 0, 1 or -1 is in the kernel, so that it does not compute with zeros; other numbers are
constants of each instance, and what changes between steps is an input of the law.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.splines import Pieces
from rb_sim.graph.program import Field, Program
from rb_sim.graph.symbols import Symbol

PATTERNS = 6
"""Patterns of zeros and ones for which a kind gets kernels of their own; with more, none does."""


class UntabledError(Exception):
    """A law that cannot be written over tables."""


def shape_of(x: Any) -> Hashable:
    """What remains of nested tuples without their numbers."""
    if isinstance(x, float | Symbol):
        return float
    if isinstance(x, tuple):
        return type(x), tuple(map(shape_of, x))
    if isinstance(x, np.ndarray | Pieces):  # a kernel in a loop calls no functions by address
        raise UntabledError
    return x


def leaves_of(x: Any) -> list[Any]:
    """The numbers of nested tuples: floats, or symbols of inputs."""
    if isinstance(x, tuple):
        return [leaf for entry in x for leaf in leaves_of(entry)]
    if isinstance(x, Symbol) and x.op != "p":
        raise UntabledError
    return [x] if isinstance(x, float | Symbol) else []


def joined(shape: Any, leaves: Any) -> Any:
    """The nested tuples of this shape with the numbers that the iterator gives."""
    if shape is float:
        return next(leaves)
    if isinstance(shape, tuple):
        kind, entries = shape
        made = [joined(entry, leaves) for entry in entries]
        return kind._make(made) if hasattr(kind, "_make") else tuple(made)
    return shape


class Instance(NamedTuple):
    """One of the things to which a kernel applies."""

    thing: Any
    """nested tuples, without numpy arrays."""
    inputs: tuple[tuple[str, int, int], ...]
    """base, place and width of each field that it takes."""
    outputs: tuple[tuple[str, int], ...]
    """base and place of each field that it gives."""


def marks_of(leaves: Sequence[Any]) -> tuple[Any, ...]:
    """0, 1 and -1 as they are, None for other numbers, "p" for inputs."""
    return tuple(
        "p" if isinstance(x, Symbol) else x if x in (0.0, 1.0, -1.0) else None for x in leaves
    )


def run(
    program: Program,
    name: Hashable,
    function: Callable[..., Any],
    instances: Sequence[Instance],
) -> None:
    """f(thing, t, *inputs) for every instance, one kernel for those of one kind.

    name: tells the function apart from all others.
    """
    kinds: dict[tuple[Hashable, ...], dict[tuple, list[tuple[Instance, list[Any]]]]] = {}
    for instance in instances:
        leaves = leaves_of(instance.thing)
        taken = tuple((base, width) for base, _, width in instance.inputs)
        kind = shape_of(instance.thing), taken, tuple(base for base, _ in instance.outputs)
        kinds.setdefault(kind, {}).setdefault(marks_of(leaves), []).append((instance, leaves))
    for (shape, *_), patterns in kinds.items():
        if len(patterns) > PATTERNS:
            marks = tuple("p" if "p" in each else None for each in zip(*patterns, strict=True))
            patterns = {marks: [entry for entries in patterns.values() for entry in entries]}
        for marks, entries in patterns.items():
            _run_kind(program, (name, shape, marks), function, entries)


def _run_kind(
    program: Program,
    key: tuple[Hashable, Any, tuple[Any, ...]],
    function: Callable[..., Any],
    entries: Sequence[tuple[Instance, list[Any]]],
) -> None:
    """One kernel over a table of instances with zeros and ones at the same places."""
    name, shape, marks = key
    free = [k for k, mark in enumerate(marks) if mark is None]
    varied = [k for k, mark in enumerate(marks) if mark == "p"]
    inputs = []
    for k, (base, _, width) in enumerate(entries[0][0].inputs):
        inputs.append(Field(base, width, [instance.inputs[k][1] for instance, _ in entries]))
    own = len(inputs)
    if free:
        places = [program.keep([leaves[k] for k in free]) for _, leaves in entries]
        inputs.append(Field("const", len(free), places))
    for k in varied:
        inputs.append(Field("p", 1, [leaves[k].operands[0] for _, leaves in entries]))
    outputs = [
        (base, [instance.outputs[k][1] for instance, _ in entries])
        for k, (base, _) in enumerate(entries[0][0].outputs)
    ]

    def on_fields(t: Any, *fields: tuple[Any, ...]) -> Any:
        leaves = list(marks)
        given = iter(fields[own:])
        if free:
            for k, value in zip(free, next(given), strict=True):
                leaves[k] = value
        for k in varied:
            (leaves[k],) = next(given)
        return function(joined(shape, iter(leaves)), t, *fields[:own])

    program.run((name, shape, marks), on_fields, inputs, outputs)
