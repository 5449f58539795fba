# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Numbers in a scene are found by their path, and nothing else changes."""

from __future__ import annotations

import pytest

from rb_sim.base.errors import SceneError
from rb_sim.sweeps.one_run import parse, placed, with_default

SCENE = {"bodies": {"top": {"position": [1.0, 2.0, 3.0], "mass": 1.0}}, "effects": {}}


def test_a_path_reads_as_keys_and_indices() -> None:
    assert parse("bodies.top.inertia[0][2]", "f") == ("bodies", "top", "inertia", 0, 2)
    assert parse("bodies.2nd gear (1).mass", "f") == ("bodies", "2nd gear (1)", "mass")
    assert parse('bodies["v1.2"].position[0]', "f") == ("bodies", "v1.2", "position", 0)


@pytest.mark.parametrize(
    "text", ["", "bodies..top", "[0]", ".bodies", "bodies.top[x]", "a[0]b", "a."]
)
def test_what_is_no_path_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(SceneError, match="must be a path like"):
        parse(text, "f")


def test_only_the_named_number_changes() -> None:
    path = parse("bodies.top.position[1]", "f")
    changed = placed(SCENE, path, 9.0, "p", "f")
    assert changed["bodies"]["top"] == {"position": [1.0, 9.0, 3.0], "mass": 1.0}
    assert SCENE["bodies"]["top"]["position"] == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    "text", ["bodies.tip.mass", "bodies.top.position[3]", "bodies.top.mass[0]"]
)
def test_a_path_to_nowhere_is_refused(text: str) -> None:
    with pytest.raises(SceneError, match="path"):
        placed(SCENE, parse(text, "f"), 0.0, text, "f")


def test_a_default_that_a_path_goes_through_is_written_out() -> None:
    defaults = {"bodies": {"top": {"position": [0.0] * 3, "angular_velocity": [0.0] * 3}}}
    path = parse("bodies.top.angular_velocity[1]", "f")
    filled = with_default(SCENE, defaults, path)
    assert placed(filled, path, 2.0, "p", "f")["bodies"]["top"]["angular_velocity"] == [0, 2, 0]
    assert filled["bodies"]["top"]["position"] == [1.0, 2.0, 3.0]
