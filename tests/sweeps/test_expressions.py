# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Expressions compute what they say and reach nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.base.errors import RbSimError
from rb_sim.sweeps.expressions import Expression

NAMES = {
    "position": {"top": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])},
    "reaction": {"shaft/A": {"force": np.array([[3.0, 0.0, 4.0], [0.0, 5.0, 12.0]])}},
    "speed": 2.0,
}


def value(text: str) -> float:
    return float(Expression(text, "outputs.x").value(NAMES, {}))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("max(position.top.z)", 6.0),
        ("last(position.top.x) - first(position.top.x)", 3.0),
        ('max(norm(reaction["shaft/A"].force))', 13.0),
        ("rms(position.top.y)", np.sqrt(14.5)),
        ("2 ** 3 % 5 + -speed * pi", 3.0 - 2.0 * np.pi),
        ("where(speed > 1 and not speed >= 3, 1, 0)", 1.0),
        ("last(position.top).y", 5.0),
        ("sum([1, 2, 3]) / 2", 3.0),
        ("max(norm([position.top.x, 0, position.top.y]))", np.sqrt(41.0)),
        ("norm(last(position.top)) ** 2", 77.0),
    ],
)
def test_expressions_are_arithmetic_on_the_samples(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "position.__class__",
        "(lambda: 1)()",
        "[x for x in position]",
        "open('f')",
        "max(position.top.q)",
        "max(position.tip.z)",
        "max(x=1)",
        "speed.x",
        "1 +",
        "(" * 2000,
        "first([])",
        "position.top[0.5]",
        "max(position.top[2])",  # the component z, or all of the third sample?
        "f'{speed}'",
        "max(position.top)",  # the largest of all components
        "rms(position.top)",
        "any(position.top > 1)",
        "norm(speed)",
        "max(position.top.x, position.top.y)",
    ],
)
def test_anything_else_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(RbSimError) as caught:
        value(text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("outputs.x: ")
