# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Console for tables and lines without markup."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any, TextIO

from rb_sim.base.errors import RbSimError

if TYPE_CHECKING:
    from rich.console import Console


WIDTH = 160
"""Width of a line in a file or a pipe [characters]: long names are not folded there."""


class Unread:
    """Standard output whose reader may leave, as `head` does: what it does not read is dropped, and
    the command goes on to write its files.

    stream: None if it was closed before the start.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """As of any text stream."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self._drop(error)
            return len(text)

    def flush(self) -> None:
        """As of any text stream."""
        try:
            self._stream.flush()
        except OSError as error:
            self._drop(error)

    def _drop(self, error: OSError) -> None:
        """Drop all from now on. Raises RbSimError if no reader has left (full disk)."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)
        if not isinstance(error, BrokenPipeError):
            raise RbSimError(f"standard output: cannot be written: {error.strerror}")


def width() -> int | None:
    """Width of a line of standard output [characters]; None: that of the terminal."""
    return None if sys.stdout.isatty() else WIDTH


def plain_console(**options: Any) -> Console:
    """A console without markup: brackets of units, topics and paths would be taken for it (`[ms]`
    would vanish, `[/]` raise an error)."""
    from rich.console import Console

    given: dict[str, Any] = {"width": width(), **options}
    return Console(markup=False, emoji=False, **given)
