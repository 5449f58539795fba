# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""YAML as plain data: scalars of YAML 1.2, unique keys, no tags, bounded size and depth."""

from __future__ import annotations

import math
import tracemalloc

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rb_sim.base.errors import SceneError
from rb_sim.scene.yaml_reader import parse, write

plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**18), 10**18)
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=20),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.from_regex(r"[a-z_]{1,8}", fullmatch=True), inner, max_size=4)
    ),
    max_leaves=20,
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-6", 1e-6),
        ("1.0e-6", 1e-6),
        ("-1E+3", -1e3),
        (".5", 0.5),
        ("5.", 5.0),
        ("+3", 3),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        ("true", True),
        ("False", False),
        ("~", None),
        ("null", None),
        ("no", "no"),
        ("on", "on"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("2024-01-01", "2024-01-01"),
        ("nan", "nan"),
        ("'1'", "1"),
        ('"true"', "true"),
    ],
)
def test_scalar(text: str, value: object) -> None:
    got = parse(f"key: {text}", "f")["key"]
    assert got == value
    assert type(got) is type(value)


def test_keys_that_only_look_like_mistakes() -> None:
    """A name may contain colons, a quoted key may be any text."""
    data = parse("a:1: {b: 2}\n'c:1':\n'<<': 3", "f")
    assert data == {"a:1": {"b": 2}, "c:1": None, "<<": 3}


def test_nan_and_long_numbers() -> None:
    assert math.isnan(parse("a: .NaN", "f")["a"])
    assert parse("a: " + "9" * 10_000, "f")["a"] == math.inf
    assert parse("a: 0x" + "F" * 10_000, "f")["a"].startswith("0xFF")


@given(plain)
def test_reads_what_it_writes(data: object) -> None:
    assert parse(write({"data": data}), "f") == {"data": data}


@pytest.mark.parametrize(
    "text", ["0E0", "1e-6", "0o17", "0x1F", "010", "1:30", "no", "~", "", ".5"]
)
def test_writes_text_as_text(text: str) -> None:
    """PyYAML by itself leaves 1e-6 and 0o17 unquoted, since YAML 1.1 takes them for text."""
    assert parse(write({text or "a": text}), "f") == {text or "a": text}


def test_aliases_are_read() -> None:
    assert parse("a: &x [1, 2]\nb: {c: *x, d: *x}", "f") == {
        "a": [1, 2],
        "b": {"c": [1, 2], "d": [1, 2]},
    }


BOMB = "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{name}: &{name} [{','.join(['*' + before] * 10)}]\n"
    for before, name in zip("abcdefghij", "bcdefghijk", strict=True)
)

CHAIN = "".join(f"a{i + 1}: &a{i + 1} [[[*a{i}]]]\n" for i in range(2000))
"""Each line nests the one before three levels deeper."""


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (BOMB, r"f\[7\]: brings the scene above 1000000 values \(line 6\)"),
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("---\n", "is empty"),
        ("~", "is empty"),
        ("a: 1\n---\nb: 1\n", "holds several YAML documents"),
        ("a: 1\na: 2\n", r"a: is given twice, first in line 1 \(line 2\)"),
        ("a: {b: 1,\n 'b': 2}", r"a.b: is given twice, first in line 1 \(line 2\)"),
        ("a: [{b: 1}, {b: 1, b: 2}]", r"a\[1\].b: is given twice"),
        ("a: *x", "a: names the anchor x, not defined before"),
        ("a: &x [*x]", r"a\[0\]: names the anchor x, not defined before"),
        ("a: !!python/object/apply:os.system [ls]", "a: has the tag .*; tags are not read"),
        ("a: !!float 1", "a: has the tag"),
        ("a: !mine 1", "a: has the tag !mine"),
        ("? [1, 2]\n: 3", "has a key that is not a plain name"),
        ("&x a: 1\n*x : 2", "has a key that is not a plain name"),
        ("a: " + "[" * 100, r"a\[0\]\[0\]\[0\]: is nested deeper than 32 levels"),
        ("a: " + "[" * 5000, "is nested deeper than 32 levels"),
        ("{a: " * 1000, "a.a.a.a: is nested deeper than 32 levels"),
        ("a0: &a0 1\n" + CHAIN, r"a11\[0\]\[0\]\[0\]: is nested deeper than 32 levels \(line 12\)"),
        ("a: [1, 2", r"is not YAML: line \d, column \d: "),
        ("a: b: c", "is not YAML: line 1, column 5: mapping values are not allowed"),
        (
            "a:\n  b:1\n  c: 2",
            "line 3, column 4: .* not allowed in this context; line 2 needs a blank .*: b: 1$",
        ),
        ("a:\n  c: 1\n  b:[1, 2]\nd:\n", r"; line 3 needs a blank after the colon: b: \[1, 2\]"),
        ("a:\n  {b:1, c: 2}", r"a.b:1: needs a blank after the colon: b: 1 \(line 2\)"),
        ("a: &a {b: 1}\nc:\n  <<: *a", r"c.<<: merge keys are not read; write .* \(line 3\)"),
        ("a: \tb\n\tc: 1", "is not YAML: line 2, column 1: found a tab; must be spaces"),
        ("a:\n\tb: 1", "is not YAML: line 2, column 1: found a tab; must be spaces"),
        ("a: \x00", "is not YAML: "),
        ("a: \ud800", "is not YAML: "),
        ("a: @b", "is not YAML: "),
        ("x" * (4 * 1024 * 1024 + 1), "is larger than 4 MiB"),
    ],
)
def test_refused(text: str, part: str) -> None:
    with pytest.raises(SceneError, match=part) as caught:
        parse(text, "s.yaml")
    assert str(caught.value).startswith("s.yaml: ")
    assert len(str(caught.value).splitlines()) == 1


def test_a_bomb_is_refused_before_it_grows() -> None:
    tracemalloc.start()
    try:
        with pytest.raises(SceneError):
            parse(BOMB, "f")
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


@given(st.text(max_size=200))
def test_any_text_gives_data_or_one_line(text: str) -> None:
    try:
        parse(text, "f")
    except SceneError as error:
        assert len(str(error).splitlines()) == 1


def test_the_pure_python_parser_agrees(monkeypatch: pytest.MonkeyPatch, valid: str) -> None:
    """Where PyYAML is built without libyaml the data and the refusals are the same."""
    fast = parse(valid, "f")
    monkeypatch.setattr("rb_sim.scene.yaml_reader._LOADER", yaml.SafeLoader)
    assert parse(valid, "f") == fast
    for text in (
        BOMB,
        "",
        "a: 1\na: 2",
        "a: *x",
        "a: !!float 1",
        "a: [",
        "a: \x00",
        "a: " + "[" * 99,
    ):
        with pytest.raises(SceneError) as caught:
            parse(text, "f")
        assert len(str(caught.value).splitlines()) == 1
