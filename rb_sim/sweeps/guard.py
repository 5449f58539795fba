"""Whether the script that asks for workers may be imported by them.

Processes that are spawned import the script that started them: what it does outside of
`if __name__ == "__main__":` is done in each of them again, sweeps included.
"""

from __future__ import annotations

import ast
import inspect
import sys
from pathlib import Path
from types import FrameType

from rb_sim.errors import RbSimError


def check_guarded() -> None:
    """Raise RbSimError where a script calls this from a line that its workers would run, too."""
    frame = _of_the_script()
    if frame is None:
        return
    script = Path(frame.f_code.co_filename)
    try:
        tree = ast.parse(script.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError):  # typed in, or of a notebook: nobody imports it
        return
    if not any(_guards(node, frame.f_lineno) for node in tree.body):
        raise RbSimError(
            f"{script}:{frame.f_lineno}: starts workers, which import this file and would come to "
            'this line themselves; must be below `if __name__ == "__main__":`'
        )


def _of_the_script() -> FrameType | None:
    """The frame of the script that was started, in which the call is; None where it is in none."""
    if getattr(sys.modules.get("__main__"), "__file__", None) is None:
        return None
    frame = inspect.currentframe()
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_globals.get("__name__") == "__main__":
            return frame
        frame = frame.f_back
    return None


def _guards(node: ast.stmt, line: int) -> bool:
    """Whether the statement keeps that line from those who import the file."""
    if not isinstance(node, ast.If) or not node.lineno <= line <= (node.end_lineno or line):
        return False
    return any(isinstance(x, ast.Name) and x.id == "__name__" for x in ast.walk(node.test))
