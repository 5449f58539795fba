# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The pages of the laws are those of the sources, complete, and their examples are scenes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from rb_sim import Simulation, load_scene
from rb_sim.catalogue import constraints, effects
from rb_sim.scene.schema import SimulationOptions
from tools.law_examples import EXAMPLES
from tools.law_pages import FOLDER, default, pages
from tools.reference import pages as pages_of_reference

SPECS = {**constraints.SPECS, **effects.SPECS}


@cache
def made() -> dict[str, str]:
    """The pages, made once."""
    return pages()


def test_the_pages_are_up_to_date():
    assert set(made()) == {path.name for path in FOLDER.glob("*.md")}
    for name, text in made().items():
        assert (FOLDER / name).read_text(encoding="utf-8") == text, "run: make docs"


@pytest.mark.parametrize("kind", SPECS)
def test_a_page_has_its_equation_typeset_and_once(kind):
    """One law, one equation; no second one as text."""
    text = made()[f"{kind}.md"]
    section = text.split("## Equation\n\n")[1].partition("## Keys")[0]
    (_, *formulas) = section.split("$$\n")[:-1]
    for formula in formulas[::2]:
        assert formula.count("{") == formula.count("}")
        assert not {"=", r"\ge"}.isdisjoint(formula.split())
    assert formulas and section.count("$$") % 2 == 0 and "```" not in section
    assert "=" not in text.split("## Equation")[0].replace("|T|", "")
    assert all(made()[f"{name}.md"].count(formulas[0]) == (name == kind) for name in SPECS)


@pytest.mark.parametrize("kind", SPECS)
def test_every_row_of_a_page_has_a_meaning(kind):
    rows = [row for row in made()[f"{kind}.md"].splitlines() if row.startswith("| `")]
    assert rows
    for row in rows:
        assert row.split(" | ")[-1].strip(" |"), row


@pytest.mark.parametrize("kind", SPECS)
def test_every_key_is_reported(kind):
    page = made()[f"{kind}.md"].split("\n### ")[0]
    for name, field in SPECS[kind].model_fields.items():
        (row,) = [
            row for row in page.splitlines() if row.startswith(f"| `{field.alias or name}` |")
        ]
        assert ("required" if field.is_required() else "optional") in row
    scene = load_scene(EXAMPLES[kind] + "\n")
    specs = [*scene.constraints.values(), *scene.effects.values()]
    assert [spec.type for spec in specs] == [kind]
    Simulation(scene, announce=None)


@pytest.mark.parametrize("kind", [*SPECS, "simulation"])
def test_every_word_that_a_key_takes_is_on_the_page(kind):
    """By the JSON schema that pydantic makes of the key."""
    page = made().get(f"{kind}.md") or pages_of_reference()["scene.md"]
    for word in words_in(SPECS.get(kind, SimulationOptions).model_json_schema()):
        assert re.search(rf"[`: ,]{word}[`,. }}]", page), word


def words_in(schema: Any) -> Iterator[str]:
    if isinstance(schema, dict):
        yield from (word for word in schema.get("enum", ()) if isinstance(word, str))
        schema = list(schema.values())
    if isinstance(schema, list):
        for part in schema:
            yield from words_in(part)


@pytest.mark.parametrize("kind", SPECS)
def test_the_overview_has_a_whole_sentence(kind):
    """Not the first of two lines."""
    assert (SPECS[kind].__doc__ or "").splitlines()[0].endswith(".")


@pytest.mark.parametrize("kind", SPECS)
def test_scenes_md_says_which_keys_are_optional(kind):
    text = (FOLDER.parent / "scenes.md").read_text(encoding="utf-8")
    (row,) = [row for row in text.splitlines() if row.startswith(f"| `{kind}` |")]
    for name, field in SPECS[kind].model_fields.items():
        key = field.alias or name
        if key == "type":
            continue
        reported = default(name, field).strip("`")
        assert (f"**{key}**" if field.is_required() else f"{key} ({reported})") in row
