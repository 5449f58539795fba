"""Tables and lines as they are written."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


WIDTH = 160
"""Characters of a line in a file or a pipe, where names are searched for and not to be folded."""


def width() -> int | None:
    """Of a line of standard output; None: that of the screen."""
    return None if sys.stdout.isatty() else WIDTH


def plain_console(**options: Any) -> Console:
    """A console that takes no text for markup: units, topics and paths have brackets and colons,
    and `[ms]` would vanish, `[/]` end the program."""
    from rich.console import Console

    options = {"width": width()} | options
    return Console(markup=False, emoji=False, **options)
