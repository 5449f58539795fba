"""Arguments of Python's for compiled functions, and back: numbers and addresses in slots."""

from __future__ import annotations

import ctypes
import importlib
import math
import struct
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.compiler.kinds import (
    BOOLEAN,
    COMPLEX,
    DTYPES,
    INTEGER,
    NOTHING,
    REAL,
    Array,
    Kind,
    Object,
    Tuple,
)

_NUMBERS = {"real": REAL, "integer": INTEGER, "boolean": BOOLEAN, "complex": COMPLEX}
_SLOTS = {"double": "d", "i64": "q", "i1": "q", "ptr": "q"}
_ADDRESSES: dict[int, tuple[weakref.ref[np.ndarray], int]] = {}
"""Where the numbers of arrays are that have been asked for: numpy takes a microsecond to tell."""


def address_of(array: np.ndarray) -> int:
    """Where the numbers of an array are, as long as it lives."""
    key = id(array)
    found = _ADDRESSES.get(key)
    if found is not None and found[0]() is array:
        return found[1]
    if not array.flags.c_contiguous:
        raise TypeError("an array of a compiled function is C-contiguous")
    address = array.ctypes.data
    _ADDRESSES[key] = weakref.ref(array, lambda _: _ADDRESSES.pop(key, None)), address
    return address


def told(arguments: Sequence[Any]) -> tuple[tuple[Any, ...], list[Any]]:
    """(what tells arguments of other kinds apart, the numbers of the arguments in turn)."""
    tokens: list[Any] = []
    numbers: list[Any] = []
    for argument in arguments:
        _tell(argument, tokens, numbers)
    return tuple(tokens), numbers


def _tell(argument: Any, tokens: list[Any], numbers: list[Any]) -> None:
    """Append the tokens and numbers of one argument."""
    kind = argument.__class__
    if kind is np.ndarray:
        tokens.append(argument.dtype.char)
        tokens.append(argument.ndim)
        numbers.append(address_of(argument))
        numbers.extend(argument.shape)
    elif kind is float or kind is np.float64:
        tokens.append("real")
        numbers.append(argument)
    elif kind is bool or kind is np.bool_:
        tokens.append("boolean")
        numbers.append(bool(argument))
    elif isinstance(argument, (int, np.integer)):
        tokens.append("integer")
        numbers.append(int(argument))
    elif isinstance(argument, tuple):
        tokens.append(kind)
        tokens.append(len(argument))
        for entry in argument:
            _tell(entry, tokens, numbers)
    else:
        raise TypeError(f"{kind.__name__} is nothing that a compiled function takes")


def kind_of(argument: Any) -> Kind:
    """The kind of an argument."""
    if isinstance(argument, np.ndarray):
        return Array(DTYPES[argument.dtype], argument.ndim)
    if isinstance(argument, tuple):
        of = None if type(argument) is tuple else type(argument)
        return Tuple(tuple(kind_of(entry) for entry in argument), of)
    if isinstance(argument, (bool, np.bool_)):
        return BOOLEAN
    return INTEGER if isinstance(argument, (int, np.integer)) else REAL


class Program:
    """A compiled function for arguments of its kinds."""

    def __init__(self, law: Any, kinds: Sequence[Kind], result: Kind) -> None:
        from rb_sim.compiler.program import CALL

        self._law, self._result = law, result
        self._call = CALL(law.address)
        given = [leaf for kind in kinds for leaf in kind.leaves]
        self._into = struct.Struct("=q" + "".join(_SLOTS[leaf] for leaf in given))
        self._out = struct.Struct("=" + "".join(_SLOTS[leaf] for leaf in result.leaves))
        self._at = self._into.size
        self._rooms: list[Any] = []
        """Slots that nobody uses at the moment."""

    def __call__(self, numbers: list[Any], arguments: Sequence[Any]) -> Any:
        try:
            room = self._rooms.pop()
        except IndexError:
            room = ctypes.create_string_buffer(self._at + self._out.size)
        self._into.pack_into(room, 0, 0, *numbers)
        self._call(room)
        if self._out.size == 0:
            result = None
        else:
            leaves = self._out.unpack_from(room, self._at)
            single = self._result in (REAL, INTEGER)
            result = leaves[0] if single else _back(self._result, iter(leaves), arguments)
        if any(room[:8]):  # arrays that it has made, which are copied by now
            self._call(room)
        self._rooms.append(room)
        return result


def _back(kind: Kind, leaves: Any, arguments: Sequence[Any]) -> Any:
    """A value of Python's from its leaves."""
    if isinstance(kind, Tuple):
        parts = [_back(k, leaves, arguments) for k in kind.kinds]
        return tuple(parts) if kind.of is None else kind.of(*parts)
    if isinstance(kind, Array):
        place, *shape = (next(leaves) for _ in kind.leaves)
        found = _array_at(place, tuple(shape), arguments)
        return _copied(kind, place, shape) if found is None else found
    if isinstance(kind, Object):
        return kind.value
    if kind == COMPLEX:
        return complex(next(leaves), next(leaves))
    value = next(leaves)
    return bool(value) if kind == BOOLEAN else value


def _copied(kind: Array, place: int, shape: Sequence[int]) -> np.ndarray:
    """A copy of the array at the place."""
    dtype = next(dtype for dtype, element in DTYPES.items() if element == kind.element)
    count = math.prod(shape)
    data = (ctypes.c_char * (count * dtype.itemsize)).from_address(place)
    return np.frombuffer(bytes(data), dtype).reshape(shape).copy()


def _array_at(place: int, shape: tuple[int, ...], arguments: Sequence[Any]) -> Any:
    """The array among the arguments that is at the place; None where none is."""
    for argument in arguments:
        if isinstance(argument, tuple):
            found = _array_at(place, shape, argument)
            if found is not None:
                return found
        elif isinstance(argument, np.ndarray) and argument.shape == shape:
            if address_of(argument) == place:
                return argument
    return None


def words_of(kind: Kind) -> Any:
    """The kind as words that can be written down."""
    if isinstance(kind, Tuple):
        of = None if kind.of is None else [kind.of.__module__, kind.of.__qualname__]
        return ["tuple", of, *(words_of(k) for k in kind.kinds)]
    if isinstance(kind, Array):
        return ["array", kind.element, kind.ndim]
    if isinstance(kind, Object):
        return "nothing"
    return next((word for word, k in _NUMBERS.items() if k == kind), type(kind).__name__.lower())


def kind_from(words: Any) -> Kind:
    """The kind of which these are the words."""
    if words == "nothing":
        return NOTHING
    if isinstance(words, str):
        return _NUMBERS[words]
    if words[0] == "array":
        return Array(words[1], words[2])
    of = None if words[1] is None else getattr(importlib.import_module(words[1][0]), words[1][1])
    return Tuple(tuple(kind_from(w) for w in words[2:]), of)
