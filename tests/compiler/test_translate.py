# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is compiled gives what plain Python gives; what cannot be is refused with its place."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim.compiler.program import Entry
from rb_sim.compiler.translate import CompileError
from tests.compiler import functions

REALS = (-2.75, 0.4, 3.0)
CASES = (
    [(functions.arithmetic, (a, b, n)) for a in REALS for b in (1.5, -0.25) for n in (0, 3)]
    + [(functions.rounding, (a, b, n, m)) for a in REALS for b in (1.5, -0.25)
       for n in (-7, 7) for m in (2, -3)]
    + [(functions.comparisons, (a, b, n)) for a in (*REALS, math.nan) for b in REALS
       for n in (0, 2)]
    + [(functions.extremes, (a, b, n)) for a in (*REALS, math.nan) for b in REALS for n in (1, 4)]
    + [(functions.elementary, (a,)) for a in REALS]
    + [(functions.sums, (n,)) for n in (0, 1, 5, 12)]
    + [(functions.branches, (a, n)) for a in REALS for n in (-1, 1, 4)]
    + [(functions.tuples, (a, 0.75)) for a in REALS]
    + [(functions.constants, (i,)) for i in (0, 1)]
    + [(functions.calls, (a,)) for a in (1.5, 2e3)]
    + [(functions.integers_in, (n,)) for n in (-3, 5)]
    + [(functions.complex_ones, (a, b)) for a in REALS for b in (0.5, -4.0)]
    + [(functions.no_end, (3,))]
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RB_SIM_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


ENTRIES = {function: Entry(function) for function, _ in CASES}


@pytest.mark.parametrize("function, arguments", CASES)
def test_numbers(function: Any, arguments: tuple[Any, ...]) -> None:
    same(ENTRIES[function](*arguments), function(*arguments))


def same(found: Any, expected: Any) -> None:
    """Alike in structure and kinds, and to the rounding of elementary functions."""
    if isinstance(expected, tuple):
        assert type(found) is type(expected) and len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            same(one, other)
    else:
        assert found == pytest.approx(expected, rel=4e-16, abs=1e-300, nan_ok=True)


ARRAYS = [
    (functions.vectors, (np.arange(6.0).reshape(3, 2), np.array([1.0, -2.0, 0.5]), 1)),
    (functions.parts, (np.arange(12.0).reshape(3, 4), np.array([7.0, 8.0, 9.0]))),
    (functions.made_here, (np.array([1.5, 2.5]),)),
    (functions.made_and_returned, (np.array([1.5, 2.5]),)),
    (functions.given_back, (np.array([1.0, 2.0]), np.array([3.0, 4.0]))),
    (functions.given_back, (np.array([-1.0, 2.0]), np.array([3.0, 4.0]))),
]


@pytest.mark.parametrize("function, arguments", ARRAYS)
def test_arrays(function: Any, arguments: tuple[Any, ...]) -> None:
    """What is returned, and what has become of the arrays."""
    given = [np.copy(a) if isinstance(a, np.ndarray) else a for a in arguments]
    plain = [np.copy(a) if isinstance(a, np.ndarray) else a for a in arguments]
    found, expected = Entry(function)(*given), function(*plain)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-15)
    for one, other in zip(given, plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-15)


def test_an_array_that_was_given_comes_back_as_itself() -> None:
    b, c = np.array([1.0]), np.array([2.0])
    entry = Entry(functions.given_back)
    assert entry(b, c)[0] is b
    b[0] = -1.0
    assert entry(b, c)[0] is c


def test_an_array_comes_back_as_itself_beside_views_of_it() -> None:
    b, c = np.array([1.0, 2.0]), np.array([[3.0]])
    entry = Entry(functions.given_back_beside)
    assert entry(b, b[None, :], c)[0] is b
    assert entry(b, b[:1], c)[0] is b


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_may_make_arrays_runs_once(sign: float) -> None:
    """To free what it has made it is called again."""
    b, count = np.array([2.0 * sign]), np.zeros(1)
    found = Entry(functions.perhaps_made)(b, count)
    assert (float(found[0]), count[0]) == ((4.0, 1.0) if sign > 0.0 else (-2.0, 1.0))


def test_arrays_that_were_made_are_freed() -> None:
    """A leak of 8 kB a call would be 80 MB."""
    resource = pytest.importorskip("resource")
    entry, b = Entry(functions.made_and_returned), np.ones(1000)
    entry(b)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(10_000):
        entry(b)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000


def test_each_combination_of_kinds_is_a_program_of_its_own() -> None:
    entry = Entry(functions.extremes)
    assert entry(1.0, 2.0, 3)[2] == 3
    assert entry(1, 2, 3) == functions.extremes(1, 2, 3)
    assert isinstance(entry(1, 2, 3)[0], int)


# What cannot be compiled is told with its place; nothing is guessed.


def undefined(x):
    return x + nothing_of_this_name  # noqa: F821  # type: ignore[name-defined]


def lists(x):
    return [x, x]


def two_kinds(x):
    y = x
    if x > 0.0:
        y = (x, x)
    return y


def itself(x):
    return itself(x - 1.0) if x > 0.0 else x


def too_many(x):
    return once(x, x)  # type: ignore[call-arg]


def once(x):
    return x


def attribute(x):
    return x.shape


def strided_part(a):
    return a[:, 1:3][0, 0]


REFUSED = [
    (undefined, (1.0,), "nothing_of_this_name has no value"),
    (lists, (1.0,), "List is not compiled"),
    (two_kinds, (1.0,), r"real and \(real, real\)"),
    (itself, (1.0,), "itself calls itself"),
    (too_many, (1.0,), "once takes 1 arguments"),
    (attribute, (1.0,), "real has no shape"),
    (strided_part, (np.zeros((3, 4)),), "does not lie in one piece"),
]


@pytest.mark.parametrize("function, arguments, words", REFUSED)
def test_what_is_not_compiled_is_reported_with_its_line(
    function, arguments, words, tmp_path, monkeypatch
):
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    with pytest.raises(CompileError, match=words) as error:
        Entry(function)(*arguments)
    assert "test_translate.py" in str(error.value) or function is itself


def test_what_no_slot_holds_is_refused():
    with pytest.raises(TypeError, match="dict is nothing that a compiled function takes"):
        Entry(once)({})
    with pytest.raises(TypeError, match="C-contiguous"):
        Entry(once)(np.zeros((4, 4))[:, 1])
