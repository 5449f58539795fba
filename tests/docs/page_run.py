"""Does what a page of the documentation says: its blocks in order, in one folder.

Python runs in one namespace, shell lines are commands of rb_sim, a block of YAML is a scene. YAML
whose first line is a comment that names a file (`# door.yaml`) is written there. A block `output`
shows lines that the block before it prints.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from pathlib import Path

import matplotlib
import yaml
from typer.testing import CliRunner

from rb_sim import load_scene
from rb_sim.cli.main import app
from rb_sim.statics import load_statics
from tests.docs.blocks import ROOT, Block, blocks

SKETCH = "..."
"""In a YAML block: it lists keys, and is no scene. In an output block: lines are left out."""
_FILE = re.compile(r"# (\S+\.yaml)\b")


def run_page(page: Path) -> None:
    """Run the blocks of the page in the present folder. Raises AssertionError where one fails."""
    Path("config").symlink_to(ROOT / "config")  # as in the source tree
    space: dict[str, object] = {"__name__": "page"}
    printed = ""
    for block in blocks(page):
        if block.language == "python":
            code = compile("\n" * (block.line - 1) + block.text, str(page), "exec")
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(code, space)
            printed = out.getvalue()
        elif block.language == "sh":
            printed = _shell(block)
        elif block.language == "yaml":
            _scene(block)
        elif block.language == "output":
            _look(block, printed)


def _shell(block: Block) -> str:
    printed = ""
    for line in block.text.replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line, comments=True)
        assert program == "rb_sim", f"{line!r}: only rb_sim is run here"
        with matplotlib.rc_context():
            matplotlib.rcdefaults()  # a command draws in its own style, not in that of the page
            done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, f"{line!r} (line {block.line}): {done.output}"
        printed += done.output
    return printed


def _scene(block: Block) -> None:
    if (named := _FILE.match(block.text)) is not None:
        Path(named[1]).write_text(block.text, encoding="utf-8")
    data = yaml.safe_load(block.text)
    if not isinstance(data, dict) or "bodies" not in data or SKETCH in block.text:
        return
    if "supports" in data:
        load_statics(data)
    else:
        load_scene(block.text)


def _look(block: Block, printed: str) -> None:
    lines = [line.rstrip() for line in printed.splitlines()]
    for number, line in enumerate(block.text.splitlines(), block.line):
        shown = line.rstrip()
        assert shown == SKETCH or shown in lines, f"line {number}: {shown!r} is not in:\n{printed}"


def pictures(page: Path) -> list[str]:
    """Files that the page's blocks make and that it shows: NAME of `pictures/PAGE/NAME`."""
    return re.findall(rf"\]\(pictures/{page.stem}/([^)]+)\)", page.read_text(encoding="utf-8"))
