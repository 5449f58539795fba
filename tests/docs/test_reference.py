# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The generated reference is that of the sources, and complete."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from itertools import chain

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import rb_sim
from rb_sim.base.errors import CHECKS
from rb_sim.cli.main import app
from rb_sim.cli.verbs.hard_cases import shipped
from rb_sim.ros.parameters import Settings
from rb_sim.sweeps.hard_cases import described, load_cases
from tests.docs.blocks import ROOT
from tools.messages import SECTIONS, checks_that_are_named, texts
from tools.reference import FOLDER, pages
from tools.thresholds import NONE_OF_THEM, PACKAGE, PAGE, page, thresholds

MADE = pages()
NODE = (ROOT / "docs" / "node.md").read_text(encoding="utf-8")
BAGS = (ROOT / "docs" / "bags.md").read_text(encoding="utf-8")
OF_EVERY_TOPIC = """
bodies:
  ball: {mass: 1.0, shape: {type: sphere, radius: 0.1}, position: [0, 0, 0.1]}
  arm: {mass: 1.0, inertia: [1, 1, 1], center_of_mass: [0, 0, -0.5], position: [2, 0, 2]}
constraints:
  floor: {type: contact, body: ball}
  hinge: {type: fixed_axis, body: arm, axis_B: [0, 1, 0]}
effects:
  weight: {type: gravity}
  push: {type: commanded_wrench, body: ball}
simulation: {duration: 0.1, rate: 100}
"""


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
    listed = {line.rpartition(".")[2] for line in text.splitlines() if line[:3] == ":::"}
    assert {*listed, "Scene"} >= set(rb_sim.__all__)
    for name in ("fit", "statics"):  # the package of that name has none of its arguments
        assert f"::: rb_sim.{name}\n" not in text


def test_every_row_of_a_table_has_as_many_cells_as_its_head():
    for name, text in MADE.items():
        cells = 0
        for line in text.splitlines():
            bars = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
            assert not (cells and bars) or bars == cells, (name, line)
            cells = bars


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


def test_every_topic_of_a_bag_has_a_row_with_its_type(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(OF_EVERY_TOPIC, encoding="utf-8")
    run = f"run {scene} --out {tmp_path}/out --no-rerun --no-plots --accelerations --no-check -q"
    assert CliRunner().invoke(app, run.split()).exit_code == 0
    shown = CliRunner().invoke(app, ["info", f"{tmp_path}/out/bag", "--json"]).output
    for topic, about in json.loads(shown)["topics"].items():
        name = topic.removeprefix("/rb_sim/")
        for kind, names in (("BODY", "ball|arm"), ("CONSTRAINT", "hinge.*|floor")):
            name = re.sub(rf"^({names})/|(?<=^reactions/)({names})$", f"{kind}/", name).rstrip("/")
        name = name.replace("contacts/floor/", "contacts/CONTACT/")
        if f"`{name}`" in BAGS:  # commands and resets as they came
            continue
        (row,) = (line for line in NODE.splitlines() if named(name, line))
        assert about["type"].rpartition("/")[2] in row.split(" | ")[1], (topic, about["type"])


def named(topic: str, row: str) -> bool:
    """Whether the line is a row of a table whose first cell names the topic."""
    return row.startswith("| ") and topic.lstrip("/") in re.findall(
        r"`/?([^`]+)`", row.split(" | ")[0]
    )


def test_every_topic_that_a_parameter_switches_on_has_a_row_with_its_type():
    publish = re.compile(r"publish /?([\w/]+)(?: \(\w+/(\w+)\))?")
    for known in fields(Settings):
        if hit := publish.match(known.metadata["description"]):
            rows = [line for line in NODE.splitlines() if named(hit[1], line)]
            assert len(rows) == 1, known.name
            assert (hit[2] or "") in rows[0].split(" | ")[1], known.name


def test_every_service_of_the_node_is_explained():
    sources = "".join(
        path.read_text(encoding="utf-8") for path in (ROOT / "rb_sim" / "ros").glob("*.py")
    )
    served = set(re.findall(r'serve\(\s*node, \w+, "(~/\w+)"', sources))
    assert served >= {"~/pause", "~/step", "~/reset", "~/advance", "~/set_state"}
    assert {name for name in served if f"`{name}`" not in NODE} == set()


def test_the_page_of_hard_cases_describes_each_as_its_file_does():
    text = (ROOT / "docs" / "hard-cases.md").read_text(encoding="utf-8")
    assert text.endswith("".join(map(described, load_cases(shipped()))))


# The page of thresholds is that of the sources, and each says what it decides.


ROW = re.compile(r"^\| `(.+?)` \| `(\w+)` \| (\S+) \| .+ \|$", re.MULTILINE)


def test_the_page_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == page(), "run: make docs"


def test_every_threshold_stands_in_the_page_and_every_row_is_one():
    rows = [(m, name, float(value)) for m, name, value in ROW.findall(PAGE.read_text())]
    assert rows == [(one.module, one.name, one.value) for one in thresholds()]
    assert rows


def test_each_says_what_it_decides():
    """What lies on either side, and relative to what."""
    assert [one.name for one in thresholds() if len(one.meaning.split()) < 4] == []


def test_what_is_left_out_is_there():
    for module, name in NONE_OF_THEM:
        assert re.search(rf"\b{name}\b", (PACKAGE / module).read_text())


def test_a_constant_that_a_page_names_is_in_the_sources():
    text = "".join(path.read_text() for path in PACKAGE.rglob("*.py"))
    words = set(re.findall(r"[A-Z][A-Z_]+", text))
    named = {
        (path.name, name)
        for path in PAGE.parent.rglob("*.md")
        for name in re.findall(r"`([A-Z][A-Z_]{3,})`", path.read_text())
    }
    assert named
    assert [one for one in sorted(named) if one[1] not in words] == []
