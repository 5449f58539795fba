# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Compile all loops in advance for the machines in `shipped`; setup.py runs it.

    python -m rb_sim.compiler.ship [MACHINE ...]    names as of `uname -m`; default: all

The loops are those of loops.json in this folder, which `python -m tools.loops` writes.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import llvmlite.binding as llvm

from rb_sim.compiler import program, shipped
from rb_sim.compiler.program import kind_from
from rb_sim.compiler.unit import Unit, object_code

LIST = shipped.HERE / "loops.json"


def listed() -> list[tuple[str, str, list[Any] | None]]:
    """(module, function, kinds of its arguments or None if C calls it) of all loops."""
    return [tuple(loop) for loop in json.loads(LIST.read_text(encoding="utf-8"))]


def functions() -> Iterator[program.Translated]:
    """All loops of the list. Raises KeyError for a loop that no longer exists."""
    loops = listed()
    for module, _, _ in loops:
        importlib.import_module(module)
    found = {(p.function.__module__, p.function.__qualname__): p for p in program.PROGRAMS}
    for module, name, words in loops:
        owner = found[module, name]
        yield owner.translated() if words is None else owner.translated([*map(kind_from, words)])


def made(machines: list[str]) -> dict[str, bytes]:
    """Content of the file of loops for each machine."""
    texts = {}
    for name, translate in functions():
        unit = Unit()
        words = translate(unit)
        texts[name] = unit.text(), json.dumps(words)
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    files = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # LLVM releases the GIL
        for machine in machines:
            target = shipped.TARGETS[machine]
            codes = pool.map(lambda text, to=target: code_for(text[0], to), texts.values())
            loops = {
                name: (program.key_of(text), known, code)
                for (name, (text, known)), code in zip(texts.items(), codes, strict=True)
            }
            files[machine] = shipped.packed(shipped.digest(), loops)
    return files


def code_for(text: str, target: shipped.Target) -> bytes:
    """Object code of a loop for a target; from disk where an earlier source has led to the same."""
    key = program.key_of(text)
    code = program.kept_code(key, target)
    if code is None:
        code = object_code(text, target)
        program.keep_code(key, target, code)
    return code


def main(machines: list[str]) -> None:
    """Write the files of loops; a file of the current sources is kept."""
    stale = [
        machine
        for machine in machines or list(shipped.TARGETS)
        if machine in shipped.TARGETS
        and shipped.read(shipped.path_for(machine)).sources != shipped.digest()
    ]
    for machine, data in made(stale).items() if stale else ():
        path = shipped.path_for(machine)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(data)
        os.chmod(file.name, 0o644)
        os.replace(file.name, path)


if __name__ == "__main__":
    main(sys.argv[1:])
