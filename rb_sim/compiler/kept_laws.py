"""Laws that are found again by what they were traced from: a second process does not trace them."""

from __future__ import annotations

import hashlib
import pickle
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

from rb_sim.compiler.program import folder
from rb_sim.graph import store
from rb_sim.graph.emit import Pieces, modules
from rb_sim.graph.machine import (
    Law,
    PlainLaw,
    compile_law,
    draft,
    interpreted,
    key_of,
    linked,
    load,
    pointer_type,
)
from rb_sim.graph.machine import folder as laws_folder

_LOADED: WeakValueDictionary[tuple[Path | None, str], Law] = WeakValueDictionary()
_LOCK = threading.Lock()


def kept_law(origin: Any, outputs: Callable[[], Sequence[Any]]) -> Law | PlainLaw:
    """The law of the outputs, which are asked for only where none is kept of the same origin.

    origin: all that the outputs depend on besides the sources. What cannot be pickled, and a law
    that calls other functions, whose addresses are another process's, are traced every time.
    """
    try:
        content = hashlib.sha256(pickle.dumps(origin)).hexdigest()
    except (pickle.PicklingError, AttributeError, TypeError):
        return compile_law(outputs())
    if interpreted():
        return PlainLaw(outputs())
    # the folder is that of exactly these sources
    place, name = folder(str(store.cache_root())), f"law-{content[:40]}-{draft():d}"
    with _LOCK:
        law = _LOADED.get((place, name)) or _found(place, name)
        if law is not None:
            return _LOADED.setdefault((place, name), law)
    pieces = Pieces(outputs())
    texts = modules(pieces, pointer_type())
    law = linked(texts, pieces.externals)
    if not pieces.externals:
        store.write(place, name, key_of(texts).encode())
    return law


def _found(place: Path | None, name: str) -> Law | None:
    """The law whose key is kept under this name, if both are on disk."""
    key = store.read(place, name)
    if key is None:
        return None
    kept = store.read(laws_folder(str(store.cache_root())), key.decode("ascii", "replace"))
    objects = None if kept is None else store.unpack(kept)
    return load(objects) if objects else None
