"""LLVM IR for LLVM 14 (llvmlite up to 0.43, that of Ubuntu 24.04), whose pointers have kinds.

Every pointer is one to bytes, and is taken for another kind where something is read or written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

_TABLE = re.compile(
    r"(@[\w.]+) = (?:private unnamed_addr constant|internal global) (\[\d+ x \w+\])"
)
_PLACE = re.compile(r"( *)(%\S+) = getelementptr (\w+), ptr (\S+), i64 (\S+)$")
_ROOM = re.compile(r"( *)(%\S+) = alloca (\w+), align (\d+)$")
_LOAD = re.compile(r"( *)(%\S+) = load (\w+), ptr (\S+), (.*)$")
_STORE = re.compile(r"( *)store (\w+) (\S+), ptr (\S+), (.*)$")
_CALL = re.compile(r"( *(?:%\S+ = )?)call (void|double) (%\S+)\((.*)\)$")


def with_kinds(text: str) -> str:
    """The module in the words of LLVM 14."""
    tables = dict(_TABLE.findall(text))
    lines = [out for n, line in enumerate(text.split("\n")) for out in _line(line, f"%k{n}")]
    result = re.sub(r"\bptr\b", "i8*", "\n".join(lines))
    result = result.replace(".p0.p0.i64", ".p0i8.p0i8.i64").replace(".p0.i64", ".p0i8.i64")
    for name, kind in tables.items():
        as_bytes = f"i8* bitcast ({kind}* {name} to i8*)"
        result = re.sub(rf"i8\* {re.escape(name)}\b(?!\.)", as_bytes, result)
    return result


def _line(line: str, spare: str) -> Iterator[str]:
    """One line, and the changes of kind that it takes; spare: a name that nothing has."""
    if found := _PLACE.match(line):
        indent, name, kind, place, index = found.groups()
        yield f"{indent}{spare} = bitcast ptr {place} to {kind}*"
        yield f"{indent}{spare}.at = getelementptr {kind}, {kind}* {spare}, i64 {index}"
        yield f"{indent}{name} = bitcast {kind}* {spare}.at to ptr"
    elif found := _ROOM.match(line):
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
