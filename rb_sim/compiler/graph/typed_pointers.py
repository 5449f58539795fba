# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""LLVM IR with typed pointers for LLVM 14 (llvmlite up to 0.43, that of Ubuntu 24.04).

Every pointer becomes one to bytes, and is cast where something is read or written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

_TABLE = re.compile(
    r"(@[\w.]+) = (?:private unnamed_addr constant|internal constant|internal global) "
    r"(\[\d+ x \w+\])"
)
_PLACE = re.compile(r"( *)(%\S+) = getelementptr (\w+), ptr (\S+), i64 (\S+)$")
_SLOT = re.compile(r"( *)(%\S+) = alloca (\w+|\[.*\]), align (\d+)$")
_LOAD = re.compile(r"( *)(%\S+) = load (\w+|<.*>), ptr (\S+), (.*)$")
_STORE = re.compile(r"( *)store (\w+|<\d+ x \w+>) (\S+|<.*>), ptr (\S+), (.*)$")
_CALL = re.compile(r"( *(?:%\S+ = )?)call (void|double) (%\S+)\((.*)\)$")


def with_typed_pointers(text: str) -> str:
    """The module in the syntax of LLVM 14."""
    tables = dict(_TABLE.findall(text))
    lines = [out for n, line in enumerate(text.split("\n")) for out in _line(line, f"%k{n}")]
    result = re.sub(r"\bptr\b", "i8*", "\n".join(lines))
    result = result.replace(".p0.p0.i64", ".p0i8.p0i8.i64").replace(".p0.i64", ".p0i8.i64")
    for name, kind in tables.items():
        as_bytes = f"i8* bitcast ({kind.replace('ptr', 'i8*')}* {name} to i8*)"
        result = re.sub(rf"i8\* {re.escape(name)}\b(?!\.)", as_bytes, result)
    return result


def _line(line: str, spare: str) -> Iterator[str]:
    """The line with the casts that it needs; spare: an unused name."""
    if found := _PLACE.match(line):
        indent, name, kind, place, index = found.groups()
        yield f"{indent}{spare} = bitcast ptr {place} to {kind}*"
        yield f"{indent}{spare}.at = getelementptr {kind}, {kind}* {spare}, i64 {index}"
        yield f"{indent}{name} = bitcast {kind}* {spare}.at to ptr"
    elif found := _SLOT.match(line):
        indent, name, kind, align = found.groups()
        yield f"{indent}{spare} = alloca {kind}, align {align}"
        yield f"{indent}{name} = bitcast {kind}* {spare} to ptr"
    elif found := _LOAD.match(line):
        indent, name, kind, place, rest = found.groups()
        yield f"{indent}{spare} = bitcast ptr {place} to {kind}*"
        yield f"{indent}{name} = load {kind}, {kind}* {spare}, {rest}"
    elif found := _STORE.match(line):
        indent, kind, value, place, rest = found.groups()
        yield f"{indent}{spare} = bitcast ptr {place} to {kind}*"
        yield f"{indent}store {kind} {value}, {kind}* {spare}, {rest}"
    elif found := _CALL.match(line):
        begin, result, callee, arguments = found.groups()
        kinds = ", ".join(argument.split()[0] for argument in arguments.split(", "))
        yield f"  {spare} = bitcast ptr {callee} to {result} ({kinds})*"
        yield f"{begin}call {result} {spare}({arguments})"
    else:
        yield line
