"""How far a run has come, as a bar in the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(end: float, quiet: bool) -> Iterator[Callable[[float], None]]:
    """A bar on standard error, if that is a terminal; gives what to tell the simulated time."""
    if quiet or not sys.stderr.isatty():
        yield lambda t: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.completed:.4g} of {task.total:.4g} s"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, auto_refresh=False) as bar:
        task = bar.add_task("", total=end)

        def show(t: float) -> None:
            bar.update(task, completed=t)
            bar.refresh()

        yield show
