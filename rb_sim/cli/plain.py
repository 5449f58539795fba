# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What verbs print: tables, lines without markup, progress, warnings."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

from rb_sim.base.errors import RbSimError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


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


def facts(rows: Iterable[tuple[str, str]]) -> Table:
    """A table of labels and texts, without heads."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 3))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for label, text in rows:
        table.add_row(Text(label, style="bold"), Text(text))
    return table


def columns(
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    names: Collection[str],
    folded: Collection[str] | None = None,
) -> Table:
    """A table without borders.

    names: heads of the columns of names, on the left; numbers are on the right. folded: heads of
    the columns that may be folded; None: those of names.
    """
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for head in heads:
        whole = head not in (names if folded is None else folded)
        justify = "left" if head in names else "right"
        table.add_column(head, justify=justify, overflow="fold", no_wrap=whole)
    for row in rows:
        table.add_row(*row)
    return table


@contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """Progress bar; yields the function that shows (what is done, share of the whole)."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    shown = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*shown, console=plain_console(), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, share: bar.update(task, description=f"{what:28}", completed=share)


def warn(lines: Iterable[str]) -> None:
    """Print warnings on standard error."""
    for line in lines:
        print(f"warning: {line}", file=sys.stderr, flush=True)


def note(lines: Iterable[str]) -> None:
    """Print notes on standard error."""
    for line in lines:
        print(f"note: {line}", file=sys.stderr, flush=True)
