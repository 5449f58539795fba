# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Machine code of loops that comes with the package: made when it is built, see `ship`.

One file for each kind of machine holds one object for each loop. A loop of exactly these sources is
found by its name; where a source has changed, by the IR that it is translated to. What is damaged,
or is for another processor, is not there.
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
from rb_sim.graph.machine import target_data

HERE = pathlib.Path(__file__).resolve().parent
PACKAGE = HERE.parents[len(__name__.split(".")) - 3]
"""Folder of the whole package."""


class Target(NamedTuple):
    """A processor, and with it all that have its instructions."""

    triple: str
    processor: str
    needs: tuple[str, ...]
    """Names by which LLVM knows what a processor must be able to do."""

    @property
    def name(self) -> str:
        """Triple and processor, as the names of kept code have them."""
        return f"{self.triple}-{self.processor}"

    def machine(self, level: int) -> Any:
        """LLVM for this target, optimising at the level: code that may lie anywhere in memory, and
        its constants as far from it as they like. The small code model takes them to be within
        2 GB, which in a process that maps as much between both they are not: it ends there."""
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
"""Kinds of machines for which loops are shipped, by the name that `uname -m` gives."""


def compiled_here() -> bool:
    """Whether no shipped loop is to be used: each is compiled on first use, for exactly this
    processor (RB_SIM_COMPILE)."""
    return os.environ.get("RB_SIM_COMPILE", "0") not in ("", "0")


@cache
def target() -> Target | None:
    """The target of loops on this machine; None where it is the machine's own processor."""
    target_data()  # makes LLVM ready
    found = TARGETS.get(platform.machine()) if platform.system() == "Linux" else None
    able: Mapping[str, bool] = llvm.get_host_cpu_features()
    fits = found is not None and all(able.get(need) for need in found.needs)
    return found if fits and not compiled_here() else None


@cache
def digest() -> str:
    """Of all sources of the package, and of whether bounds are checked."""
    found = hashlib.sha256(f"{checked():d}".encode())
    for source in sources():
        found.update(os.path.relpath(source, PACKAGE).encode())
        with open(source, "rb", buffering=0) as file:
            found.update(file.read())
    return found.hexdigest()


def sources() -> list[str]:
    """All sources of the package."""
    walk = os.walk(PACKAGE)
    return sorted(
        os.path.join(folder, name)
        for folder, _, names in walk
        for name in names
        if name[-3:] == ".py"
    )


def path_for(machine: str) -> pathlib.Path:
    """The file of loops for a kind of machine."""
    return HERE / f"loops-{machine}-linux.bin"


class Shipped(NamedTuple):
    """A file of loops.

    named: (key of its code, what is to be known of it) of each loop by its name.
    places: (first byte, length, SHA-256) of code by its key.
    """

    sources: str
    named: dict[str, tuple[str, str]]
    places: dict[str, tuple[int, int, str]]
    body: memoryview

    def code(self, key: str) -> bytes | None:
        """The object code of this key; None where there is none or it is damaged."""
        if key not in self.places:
            return None
        first, length, total = self.places[key]
        found = bytes(self.body[first : first + length])
        return found if hashlib.sha256(found).hexdigest() == total else None


NOTHING = Shipped("", {}, {}, memoryview(b""))
_HEAD = struct.Struct("<Q32s")
"""Length and SHA-256 of what comes next: all but the code, as JSON."""


def packed(sources: str, loops: Mapping[str, tuple[str, str, bytes]]) -> bytes:
    """The file of loops, each by its name: (key, what is to be known of it, code)."""
    places, body = dict[str, Any](), b""
    for key, _, code in loops.values():
        if key not in places:
            places[key] = len(body), len(code), hashlib.sha256(code).hexdigest()
            body += code + bytes(-len(code) % 16)
    named = {name: (key, known) for name, (key, known, _) in loops.items()}
    index = json.dumps([sources, named, places]).encode()
    return _HEAD.pack(len(index), hashlib.sha256(index).digest()) + index + body


def read(path: pathlib.Path) -> Shipped:
    """The file of loops; NOTHING where it is absent or damaged."""
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
    """(object code, what is to be known of it) of the loop of exactly these sources; None where it
    has to be made."""
    shipped = loops()
    if name not in shipped.named or shipped.sources != digest():
        return None
    key, known = shipped.named[name]
    code = shipped.code(key)
    return None if code is None else (code, known)
