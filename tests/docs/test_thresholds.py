# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The page of thresholds is that of the sources, and each says what it decides."""

from __future__ import annotations

import re

from tools.thresholds import NONE_OF_THEM, PACKAGE, PAGE, page, thresholds

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
