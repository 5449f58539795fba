# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Does what a page of the documentation says: its blocks in order, in one folder.

Python runs in one namespace, shell lines are commands of rb_sim (those that take long or have no
end run for a short time: SHORTER), a block of YAML is a scene. YAML
whose first line is a comment that names a file (`# door.yaml`) is written there. A block `output`
shows lines that the block before it prints.

Of each picture that is saved the curves are kept, so that a picture in the documentation can be
told from one of another program: not by its pixels, which every machine draws otherwise.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import yaml
from matplotlib.figure import Figure
from typer.testing import CliRunner

from rb_sim import load_scene
from rb_sim.cli.main import app
from rb_sim.scene.load import load_statics
from tests.docs.blocks import ROOT, Block, blocks
from tests.domains import own_domain

SKETCH = "..."
"""In a YAML block: it lists keys, and is no scene. In an output block: lines are left out."""
SHORTER = {
    "accuracy": ["--budget", "1"],
    "node": ["--ros-args", "-p", "duration:=0.5", "-p", "discovery:=0.0"],
}
"""Options that are appended to commands, by verb."""
_FILE = re.compile(r"# (\S+\.yaml)\b")


Curves = dict[str, list[list[float]]]
"""Of each picture, by its name: of each curve its least and largest y, and y at POINTS of it."""
POINTS = 9
COARSE = 30
"""Dots per inch of a picture that only its curves tell from others."""


@contextlib.contextmanager
def curves_drawn(coarse: Collection[str] = ()) -> Iterator[Curves]:
    """Collects the curves of all pictures that are saved; those of these names have few dots, which
    takes a tenth of the time."""
    found: Curves = {}
    save = Figure.savefig

    def savefig(self: Figure, to: Any, **options: Any) -> None:
        name = Path(getattr(to, "name", to)).name.removeprefix(".")
        found[name] = [
            [float(f"{value:.5g}") for value in (y.min(), y.max(), *y[_places(len(y))])]
            for axes in self.axes
            for line in axes.lines
            if np.isfinite(y := np.asarray(line.get_ydata(), dtype=float)).all() and len(y) > 1
        ]
        save(self, to, **(options | ({"dpi": COARSE} if name in coarse else {})))

    Figure.savefig = savefig  # type: ignore[method-assign]
    try:
        yield found
    finally:
        Figure.savefig = save  # type: ignore[method-assign]


def _places(count: int) -> list[int]:
    return [round(k * (count - 1) / (POINTS - 1)) for k in range(POINTS)]


def same_curves(a: list[list[float]], b: list[list[float]]) -> bool:
    """Whether they are to 1 % of the height of each curve, or all but zero."""
    if len(a) != len(b):
        return False
    return all(
        np.allclose(one, two, rtol=0.0, atol=0.01 * (one[1] - one[0]) + 1e-6)
        for one, two in zip(a, b, strict=True)
    )


def run_page(page: Path, coarse: Collection[str] = ()) -> Curves:
    """Run the blocks of the page in the present folder; the curves of the pictures that they save,
    those of some names coarsely. Raises AssertionError where one fails."""
    with curves_drawn(coarse) as found:
        _run_blocks(page)
    return found


def _run_blocks(page: Path) -> None:
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
        arguments += SHORTER.get(arguments[0], [])
        if arguments[0] == "node":
            code, output = _node(arguments)
        else:
            with matplotlib.rc_context():
                matplotlib.rcdefaults()  # a command draws in its own style, not in the page's
                done = CliRunner().invoke(app, arguments)
            code, output = done.exit_code, done.output
        assert code == 0, f"{line!r} (line {block.line}): {output}"
        printed += output
    return printed


def _node(arguments: list[str]) -> tuple[int, str]:
    """Exit code and output of a node, in a process of its own; nothing without ROS."""
    if importlib.util.find_spec("rclpy") is None:
        return 0, ""
    done = subprocess.run(
        [sys.executable, "-m", "rb_sim", *arguments],
        env=os.environ | {"ROS_DOMAIN_ID": own_domain(), "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=240,
    )  # fmt: skip
    return done.returncode, done.stdout


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
