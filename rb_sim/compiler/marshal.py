"""Arguments of Python's for compiled functions, and back: numbers and addresses in slots."""

from __future__ import annotations

import ctypes
import importlib
import math
import struct
from collections.abc import Iterator, Sequence
from itertools import islice
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
    Number,
    Object,
    Tuple,
)

_NUMBERS = {"real": REAL, "integer": INTEGER, "boolean": BOOLEAN, "complex": COMPLEX}
_SLOTS = {"double": "d", "i64": "q", "i1": "q", "ptr": "q"}
_place_of = ctypes.addressof
_first_byte: Any = ctypes.c_char.from_buffer
_KNOWN: dict[int, tuple[np.ndarray, int]] = {}
"""Arrays that have been asked for lately, and where they are; what is held keeps its id."""
MOST_KNOWN, MOST_HELD = 128, 1 << 20
"""How many arrays are held, and bytes of one above which it is not."""


def address_of(array: np.ndarray) -> int:
    """Where the numbers of a C-contiguous array are; numpy takes ten times as long to tell."""
    known = _KNOWN.get(id(array))
    if known is not None:
        return known[1]
    try:
        place = _place_of(_first_byte(array))
    except (TypeError, ValueError):  # empty, not to be written to, or not in one piece
        if not array.flags.c_contiguous:
            raise TypeError("an array of a compiled function is C-contiguous") from None
        place = array.ctypes.data
    if array.nbytes <= MOST_HELD:
        if len(_KNOWN) >= MOST_KNOWN:
            _KNOWN.clear()
        _KNOWN[id(array)] = array, place
    return place


Arrays = dict[tuple[int, tuple[int, ...]], np.ndarray]
"""Arrays by where they are and by their lengths: a view may begin where its array does."""
Flattened = tuple[tuple[Any, ...], list[Any], Arrays]


def flattened(arguments: Sequence[Any]) -> Flattened:
    """(what tells arguments of other kinds apart, the numbers of the arguments in turn, the arrays
    among them by where they are)."""
    tokens: list[Any] = []
    numbers: list[Any] = []
    arrays: Arrays = {}
    for argument in arguments:
        _tell(argument, tokens, numbers, arrays)
    return tuple(tokens), numbers, arrays


def _tell(argument: Any, tokens: list[Any], numbers: list[Any], arrays: Arrays) -> None:
    """Append the tokens and numbers of one argument."""
    kind = argument.__class__
    if kind is np.ndarray:
        tokens.append((argument.dtype.char, argument.ndim))
        place, shape = address_of(argument), argument.shape
        arrays[place, shape] = argument
        numbers.append(place)
        numbers += shape
    elif kind is float or kind is np.float64:
        tokens.append("real")
        numbers.append(argument)
    elif kind is bool or kind is np.bool_:
        tokens.append("boolean")
        numbers.append(bool(argument))
    elif kind is int or isinstance(argument, (int, np.integer)):
        tokens.append("integer")
        numbers.append(int(argument))
    elif isinstance(argument, tuple):
        tokens.append(kind)
        tokens.append(len(argument))
        for entry in argument:
            _tell(entry, tokens, numbers, arrays)
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


_FIRST = struct.Struct("=q")
_CALL = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)


class Program:
    """A compiled function for arguments of its kinds."""

    def __init__(self, law: Any, kinds: Sequence[Kind], result: Kind, new: bool) -> None:
        """new: there may be arrays in the result that the function has made."""
        self._law, self._result, self._new = law, result, new
        self._call = _CALL(law.address)
        given = [leaf for kind in kinds for leaf in kind.leaves]
        self._into = struct.Struct("=q" + "".join(_SLOTS[leaf] for leaf in given))
        self._out = struct.Struct("=" + "".join(_SLOTS[leaf] for leaf in result.leaves))
        self._at = self._into.size
        self._buffers: list[Any] = []
        """Slots that nobody uses at the moment."""

    def __call__(self, numbers: list[Any], arrays: Arrays) -> Any:
        try:
            buffer = self._buffers.pop()
        except IndexError:
            buffer = ctypes.create_string_buffer(self._at + self._out.size)
        self._into.pack_into(buffer, 0, 0, *numbers)
        self._call(buffer)
        result = None
        if self._out.size:
            leaves = self._out.unpack_from(buffer, self._at)
            single = self._result in (REAL, INTEGER)
            result = leaves[0] if single else _back(self._result, iter(leaves), arrays)
        if self._new and _FIRST.unpack_from(buffer)[0]:  # made, and copied by now: free them
            self._call(buffer)
        self._buffers.append(buffer)
        return result


def _back(kind: Kind, leaves: Iterator[Any], arrays: Arrays) -> Any:
    """A value of Python's from its leaves."""
    if isinstance(kind, Number):
        return bool(next(leaves)) if kind is BOOLEAN else next(leaves)
    if isinstance(kind, Tuple):
        parts = [_back(k, leaves, arrays) for k in kind.kinds]
        return tuple(parts) if kind.of is None else kind.of(*parts)
    if isinstance(kind, Array):
        place = next(leaves)
        shape = tuple(islice(leaves, kind.ndim))
        found = arrays.get((place, shape))
        return _copied(kind, place, shape) if found is None else found
    return complex(next(leaves), next(leaves)) if kind == COMPLEX else None


def _copied(kind: Array, place: int, shape: Sequence[int]) -> np.ndarray:
    """A copy of the array at the place."""
    dtype = next(dtype for dtype, element in DTYPES.items() if element == kind.element)
    count = math.prod(shape)
    data = (ctypes.c_char * (count * dtype.itemsize)).from_address(place)
    return np.frombuffer(bytes(data), dtype).reshape(shape).copy()


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
