"""Every block of Python, YAML and shell in the documentation runs, page by page, as it stands."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
import yaml
from typer.main import get_command
from typer.testing import CliRunner

from rb_sim import load_scene
from rb_sim.cli.main import app
from rb_sim.statics import load_statics
from tests.docs.blocks import PAGES, ROOT, Block, blocks, name_of

SKETCH = "..."
"""In a YAML block: it lists keys, and is no scene."""


def _shell(block: Block) -> None:
    for line in block.text.splitlines():
        program, *arguments = shlex.split(line, comments=True)
        assert program == "rb_sim", f"{line!r}: only rb_sim is run here"
        done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, f"{line!r} (line {block.line}): {done.output}"


def _scene(block: Block, write: bool) -> None:
    data = yaml.safe_load(block.text)
    if not isinstance(data, dict) or "bodies" not in data or SKETCH in block.text:
        return
    if "supports" in data:
        load_statics(data)
        return
    load_scene(block.text)
    if write:
        with open("door.yaml", "w", encoding="utf-8") as file:
            file.write(block.text)


RUN = [page for page in PAGES if any(b.language in ("python", "sh", "yaml") for b in blocks(page))]


@pytest.mark.parametrize("page", RUN, ids=name_of)
def test_blocks_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config").symlink_to(ROOT / "config")  # as in the source tree
    space: dict[str, object] = {"__name__": "page"}
    for block in blocks(page):
        if block.language == "python":
            code = compile("\n" * (block.line - 1) + block.text, str(page), "exec")
            exec(code, space)
        elif block.language == "sh":
            _shell(block)
        elif block.language == "yaml":
            _scene(block, write=page.name == "first-scene.md")
    if page.name == "hour.md":
        assert page.read_text(encoding="utf-8").count("\n## ") == 10
        for block in blocks(page):
            lines = [line for line in block.text.splitlines() if line and line[0] not in " )"]
            assert len(lines) <= 5, f"more than five commands from line {block.line} on"


def _to_read(page: Path) -> list[tuple[int, str]]:
    """(line, command) of blocks that name no language or are indented; synopses left out."""
    found, fenced, named = [], False, False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("```"):
            fenced, named = not fenced, line != "```" and not fenced
            continue
        shown = not named if fenced else line.startswith("    ")
        command = line.strip().split("  ")[0]
        if (
            shown
            and command.startswith("rb_sim ")
            and not set("[|<") & set(command.split("--set")[0])
        ):
            found += [(number, part.strip()) for part in command.split(";")]
    return found


READ = {page: _to_read(page) for page in PAGES}


@pytest.mark.parametrize("page", [page for page in PAGES if READ[page]], ids=name_of)
def test_commands_to_read_are_commands(page):
    """What a block shows without being run has verbs and options that exist."""
    group = get_command(app)
    for number, line in READ[page]:
        program, verb, *arguments = shlex.split(line, comments=True)
        assert program in ("rb_sim", "rerun"), f"line {number}: {line}"
        if program == "rb_sim":
            group.commands[verb].make_context(verb, arguments)  # raises where one does not exist
