"""The generated reference is that of the sources, and complete."""

from __future__ import annotations

from itertools import chain

import pytest
from typer.main import get_command

import rb_sim
from rb_sim.base.diagnostic import CHECKS
from rb_sim.cli.main import app
from tools.messages import SECTIONS, checks_that_are_named, texts
from tools.reference import FOLDER, pages

MADE = pages()


@pytest.mark.parametrize("name", MADE)
def test_a_page_is_up_to_date(name):
    assert (FOLDER / name).read_text(encoding="utf-8") == MADE[name], "run: make docs"


def test_every_option_of_every_command_has_a_row():
    for name, command in get_command(app).commands.items():
        section = MADE["cli.md"].split(f"## `rb_sim {name}`\n")[1].split("\n## ")[0]
        for parameter in command.params:
            for option in parameter.opts if parameter.param_type_name == "option" else ():
                assert option in ("--help", "-h") or option in section, (name, option)


def test_every_public_name_is_in_the_api():
    text = (FOLDER / "python.md").read_text(encoding="utf-8")
    listed = [line.removeprefix("::: rb_sim.") for line in text.splitlines() if line[:3] == ":::"]
    assert sorted([*listed, "Scene"]) == sorted(rb_sim.__all__)


def test_every_check_that_can_be_printed_has_a_row_with_cause_and_cure():
    named = checks_that_are_named()
    assert named == set(CHECKS)
    for name in named:
        (row,) = (
            line for line in MADE["messages.md"].splitlines() if line.startswith(f"| {name} |")
        )
        assert all(cell.strip() for cell in row.strip("|").split("|"))


def test_a_message_with_cause_and_cure_is_one_of_the_program():
    known = texts()
    for message in chain.from_iterable(SECTIONS.values()):
        assert any(message.text in text for text in known), message.text
