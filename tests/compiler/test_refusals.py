# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What cannot be compiled is told with its place; nothing is guessed."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.compiler.program import Entry
from rb_sim.compiler.translate import CompileError


def undefined(x):
    return x + nothing_of_this_name  # noqa: F821  # pyright: ignore


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
    return once(x, x)


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
def test_what_is_not_compiled_is_told_with_its_line(
    function, arguments, words, tmp_path, monkeypatch
):
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    with pytest.raises(CompileError, match=words) as error:
        Entry(function)(*arguments)
    assert "test_refusals.py" in str(error.value) or function is itself


def test_what_no_slot_holds_is_refused():
    with pytest.raises(TypeError, match="dict is nothing that a compiled function takes"):
        Entry(once)({})
    with pytest.raises(TypeError, match="C-contiguous"):
        Entry(once)(np.zeros((4, 4))[:, 1])
