"""Tables and lines as they are written."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


def plain_console(**options: Any) -> Console:
    """A console that takes no text for markup: units, topics and paths have brackets and colons,
    and `[ms]` would vanish, `[/]` end the program."""
    from rich.console import Console

    return Console(markup=False, emoji=False, **options)
