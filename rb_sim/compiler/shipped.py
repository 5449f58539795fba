# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Machine code of loops that comes with the package, compiled when it is built (see `ship`).

One file per kind of machine holds one object per loop. A loop of unchanged sources is found by its
name; after a change of sources by the IR that it is translated to. Damaged code, or code for
another processor, is ignored.
"""

from __future__ import annotations

import hashlib
import json
import os
import pathlib
import platform
import struct
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import llvmlite.binding as llvm

from rb_sim.compiler.arrays import checked
from rb_sim.compiler.graph.machine import target_data

HERE = pathlib.Path(__file__).resolve().parent
PACKAGE = HERE.parents[len(__name__.split(".")) - 3]
"""Root folder of the package."""


class Target(NamedTuple):
    """A processor for which loops are compiled; the code runs on all with its instructions."""

    triple: str
    processor: str
    needs: tuple[str, ...]
    """LLVM's names of the required processor features."""

    @property
    def name(self) -> str:
        """Triple and processor, as in the names of stored code."""
        return f"{self.triple}-{self.processor}"

    def machine(self, level: int) -> Any:
        """LLVM target machine, with an optimisation level, for code and constants anywhere in
        memory.

        The small code model expects constants within 2 GB of the code; a process with large
        mappings in between would crash.
        """
        return llvm.Target.from_triple(self.triple).create_target_machine(
            cpu=self.processor, features="", opt=level, reloc="static", codemodel="large"
        )


TARGETS = {
    "x86_64": Target(
        "x86_64-unknown-linux-gnu",
        "x86-64-v2",
        ("cx16", "sahf", "popcnt", "sse3", "sse4.1", "sse4.2", "ssse3"),
    ),
    "aarch64": Target("aarch64-unknown-linux-gnu", "generic", ("neon",)),
}
"""Kinds of machines for which loops are shipped, by the name that `uname -m` prints."""


def compiled_here() -> bool:
    """Whether shipped loops are ignored, and each is compiled on first use for this processor
    (RB_SIM_COMPILE)."""
    return os.environ.get("RB_SIM_COMPILE", "0") not in ("", "0")


@cache
def target() -> Target | None:
    """Target of the loops on this machine; None for its own processor."""
    target_data()  # initialises LLVM
    found = TARGETS.get(platform.machine()) if platform.system() == "Linux" else None
    able: Mapping[str, bool] = llvm.get_host_cpu_features()
    fits = found is not None and all(able.get(need) for need in found.needs)
    return found if fits and not compiled_here() else None


@cache
def digest() -> str:
    """Hash of all sources of the package, and of whether bounds are checked."""
    found = hashlib.sha256(f"{checked():d}".encode())
    for source in sources():
        found.update(os.path.relpath(source, PACKAGE).encode())
        with open(source, "rb", buffering=0) as file:
            found.update(file.read())
    return found.hexdigest()


def sources() -> list[str]:
    """Paths of all sources of the package."""
    walk = os.walk(PACKAGE)
    return sorted(
        os.path.join(folder, name)
        for folder, _, names in walk
        for name in names
        if name[-3:] == ".py"
    )


def path_for(machine: str) -> pathlib.Path:
    """Path of the file of loops for a kind of machine."""
    return HERE / f"loops-{machine}-linux.bin"


class Shipped(NamedTuple):
    """Content of a file of loops.

    sources: hash of the sources. named: (key of its code, JSON data) of each loop by its name.
    places: (first byte, length, SHA-256) of code by its key.
    """

    sources: str
    named: dict[str, tuple[str, str]]
    places: dict[str, tuple[int, int, str]]
    body: memoryview

    def code(self, key: str) -> bytes | None:
        """The object code with this key; None if it is absent or damaged."""
        if key not in self.places:
            return None
        first, length, total = self.places[key]
        found = bytes(self.body[first : first + length])
        return found if hashlib.sha256(found).hexdigest() == total else None


NOTHING = Shipped("", {}, {}, memoryview(b""))
_HEAD = struct.Struct("<Q32s")
"""Length and SHA-256 of the index that follows (JSON: everything but code)."""


def packed(sources: str, loops: Mapping[str, tuple[str, str, bytes]]) -> bytes:
    """Content of the file of loops; each loop by its name: (key, JSON data, code)."""
    places, body = dict[str, Any](), b""
    for key, _, code in loops.values():
        if key not in places:
            places[key] = len(body), len(code), hashlib.sha256(code).hexdigest()
            body += code + bytes(-len(code) % 16)
    named = {name: (key, known) for name, (key, known, _) in loops.items()}
    index = json.dumps([sources, named, places]).encode()
    return _HEAD.pack(len(index), hashlib.sha256(index).digest()) + index + body


def read(path: pathlib.Path) -> Shipped:
    """A file of loops; NOTHING if it is absent or damaged."""
    try:
        data = path.read_bytes()
        length, total = _HEAD.unpack_from(data)
    except (OSError, struct.error):
        return NOTHING
    index, body = data[_HEAD.size : _HEAD.size + length], memoryview(data)[_HEAD.size + length :]
    if hashlib.sha256(index).digest() != total:
        return NOTHING
    sources, named, places = json.loads(index)
    return Shipped(sources, named, places, body)


@cache
def loops() -> Shipped:
    """The shipped loops that this machine can run."""
    return NOTHING if target() is None else read(path_for(platform.machine()))


def kept(name: str) -> tuple[bytes, str] | None:
    """(object code, JSON data) of a loop of unchanged sources; None if it must be compiled."""
    shipped = loops()
    if name not in shipped.named or shipped.sources != digest():
        return None
    key, known = shipped.named[name]
    code = shipped.code(key)
    return None if code is None else (code, known)
