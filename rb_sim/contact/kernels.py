"""How the loops of contact are compiled: once for all scenes, since they see only arrays.

A scene is data to them (tables of bodies, contacts and effects), so no scene waits for a compiler,
and with NUMBA_DISABLE_JIT=1 the same sources run as plain Python.
"""

from __future__ import annotations

import hashlib
import os
import pathlib
from collections.abc import Callable
from typing import Any

import numba
from numba.core import config as numba_config

from rb_sim.maths.jit import cache_directory, inline, sources_in

_OPTIONS: dict[str, Any] = {"error_model": "numpy"}
_PLACES = (
    "contact/kernels.py", "contact/problem.py", "contact/solvers", "contact/stepping",
    "contact/geometry", "maths", "catalogue", "engine/systems/many_bodies.py",
)  # fmt: skip
"""Sources of the package that kernels call."""
config: Any = numba_config


def kernel_directory() -> pathlib.Path:
    """Folder of the compiled kernels of exactly these sources, in the package's cache.

    numba does not see a change in a file that a cached kernel only calls into.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    package = pathlib.Path(__file__).resolve().parent.parent
    for source in sources_in(package, _PLACES):
        digest.update(source.read_bytes())
    return cache_directory().with_name(digest.hexdigest()[:16])


_DIRECTORY = str(kernel_directory())

inner = inline
"""Decorator of what only kernels call; called from Python it stays plain Python."""
once = numba.njit(inline="always", **_OPTIONS)
"""Decorator of what is called in one place only: it becomes a part of its caller, where otherwise
all that it calls would be optimised once more."""


def kernel(function: Callable[..., Any]) -> Any:
    """Compile `function` for calls from Python, cached on disk; module-level functions only."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        return function
    previous, config.CACHE_DIR = config.CACHE_DIR, _DIRECTORY
    try:
        return numba.njit(cache=True, **_OPTIONS)(function)
    except (OSError, RuntimeError):  # no writable cache folder: compile in every process
        return numba.njit(**_OPTIONS)(function)
    finally:
        config.CACHE_DIR = previous
