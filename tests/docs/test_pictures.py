# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pictures of README and the documentation: each is made by `make docs`, and shows what the program
draws today. Those of the tutorials are compared by their curves (test_pages.py)."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from PIL import Image, ImageChops

from tests.docs.blocks import PAGES
from tests.docs.page_run import pictures
from tools.pictures import DOCS, MADE, same

OF_TUTORIALS = {
    page.parent / "pictures" / page.stem / name
    for page in PAGES
    if page.parent.name == "tutorials"
    for name in pictures(page)
}


def test_each_picture_is_made_and_each_that_is_made_is_shown():
    shown = {
        (page.parent / name).resolve()
        for page in PAGES
        if "vendor" not in page.parts
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    }
    made = {DOCS / path for path in MADE} | OF_TUTORIALS
    assert shown == made
    kept = {
        path
        for path in DOCS.rglob("*")
        if path.suffix in (".png", ".jpg", ".gif", ".svg") and "vendor" not in path.parts
    }
    assert kept == made


CHEAP = [
    path
    for path in MADE
    if path.startswith("laws/") or path.startswith("pictures/scene_") and path.endswith(".png")
] + ["pictures/hard-cases.png"]


@pytest.mark.parametrize("path", CHEAP)
def test_a_picture_shows_what_the_program_draws(path, tmp_path):
    """Of those that take less than a second."""
    MADE[path](tmp_path)
    assert same(tmp_path / Path(path).name, DOCS / path), f"run python -m tools.pictures {path}"


def test_a_picture_of_another_program_is_told_apart(tmp_path):
    """By a curve that lies a few pixels elsewhere, and by its size; not by noise."""
    kept = DOCS / "laws/pictures/spring.png"
    with Image.open(kept) as image:
        shown = image.convert("RGB")
    for name, drawn in (
        ("same", shown.point(lambda value: min(255, value + 3))),
        ("moved", ImageChops.offset(shown, 6, 0)),
        ("larger", shown.resize((shown.width + 16, shown.height))),
    ):
        drawn.save(tmp_path / f"{name}.png")
        assert same(tmp_path / f"{name}.png", kept) == (name == "same"), name
