# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Storage of machine code between runs: one folder per version, the oldest ones removed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import pathlib
import shutil
import struct
import tempfile
import zlib
from collections.abc import Sequence

VERSIONS_KEPT = 3
"""Number of folders of one kind that are kept, the current one included; the least recently used
are removed."""

MOST_FILES = 12_000
"""Most laws in a folder, 22 kB on average; beyond that the least recently used half is removed."""

WRITES = 64
"""Writes between two counts of the files: counting takes as long as compiling a short law."""


def cache_root() -> pathlib.Path:
    """$RB_SIM_CACHE, else $XDG_CACHE_HOME/rb_sim, else ~/.cache/rb_sim."""
    root = os.environ.get("RB_SIM_CACHE")
    if root:
        return pathlib.Path(root)
    base = os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache"
    return pathlib.Path(base) / "rb_sim"


def version_folder(kind: str, version: str) -> pathlib.Path | None:
    """The folder KIND-HASH of this version, created and marked as used; None if that fails.

    All but the VERSIONS_KEPT most recently used folders are removed.
    """
    digest = hashlib.sha256(version.encode()).hexdigest()[:16]
    folder = cache_root() / f"{kind}-{digest}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        if not os.access(folder, os.W_OK):
            return None
        remove_old_versions(folder.parent, kind)
    except OSError:
        return None
    return folder


def remove_old_versions(root: pathlib.Path, kind: str) -> None:
    """Remove all folders KIND-* of `root` but the VERSIONS_KEPT most recently used."""
    dated = []
    for folder in root.glob(f"{kind}-*"):
        with contextlib.suppress(OSError):  # another process may remove it, too
            dated.append((folder.stat().st_mtime, folder))
    for _, folder in sorted(dated, reverse=True)[VERSIONS_KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)


def read(folder: pathlib.Path | None, name: str) -> bytes | None:
    """Content of the file, which is marked as used; None if it does not exist."""
    if folder is None:
        return None
    path = folder / name
    try:
        data = path.read_bytes()
        os.utime(path)
    except OSError:
        return None
    return data


def write(folder: pathlib.Path | None, name: str, data: bytes) -> None:
    """Write the file atomically; a failure, as of a full disk, is ignored."""
    if folder is None:
        return
    try:
        handle, temporary = tempfile.mkstemp(dir=folder, prefix=".")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            os.replace(temporary, folder / name)
        except BaseException:
            os.unlink(temporary)
            raise
        if zlib.crc32(name.encode()) % WRITES == 0:
            _bound(folder)
    except OSError:
        return


def _bound(folder: pathlib.Path) -> None:
    """Remove the least recently used half of the files once there are more than MOST_FILES."""
    with os.scandir(folder) as entries:
        files = [entry for entry in entries if entry.is_file()]
    if len(files) <= MOST_FILES:
        return
    dated = []
    for entry in files:
        with contextlib.suppress(OSError):
            dated.append((entry.stat().st_mtime, entry.path))
    for _, path in sorted(dated)[: len(dated) // 2]:
        with contextlib.suppress(OSError):
            os.unlink(path)


def pack(objects: Sequence[bytes]) -> bytes:
    """Objects as one file: digest of the rest, then each object with its length before it."""
    body = b"".join(struct.pack("<Q", len(code)) + code for code in objects)
    return hashlib.sha256(body).digest() + body


def unpack(data: bytes) -> list[bytes] | None:
    """The objects in a file; None if it is damaged."""
    digest, body = data[:32], data[32:]
    if hashlib.sha256(body).digest() != digest:
        return None
    objects, at = [], 0
    while at < len(body):
        (length,) = struct.unpack_from("<Q", body, at)
        objects.append(body[at + 8 : at + 8 + length])
        at += 8 + length
    return objects
