# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which pose of a foreign bag is which body of the scene, by the parts of its topic."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.fit import FitOptions, fit, set_up
from tests.bags.analysis.foreign import pose_stamped as pose
from tests.bags.analysis.foreign import writing
from tests.bags.analysis.test_balances import with_wrenches
from tests.bags.analysis.test_foreign import P, Q, T

TWO = """\
bodies:
  a: {mass: 1.0, inertia: [0.1, 0.1, 0.1], linear_velocity: [1, 0, 0]}
  b: {mass: 1.0, inertia: [0.1, 0.1, 0.1], linear_velocity: [1, 0, 0]}
simulation: {duration: 0.1, rate: 100, method: rk4, step: 0.01}
"""


def options(folder: Path, topics: tuple[str, ...]) -> FitOptions:
    scene = folder / "two.yaml"
    scene.write_text(TWO)
    with writing(folder / "x.mcap") as bag:
        for t in T[:12]:
            for topic in topics:
                speed = 2.0 if "a" in topic.split("/") else 3.0
                aside = 0.1 * ("odom" in topic)
                bag.add(topic, *pose(t, P[0] * 0.0 + [speed * t, aside, 0.0], Q[0]), t)
    return FitOptions(
        folder / "x.mcap", ["bodies.a.linear_velocity"], scene=str(scene), as_json=True
    )


def test_by_the_parts_of_the_topic(tmp_path):
    """/a/pose is of a, /b/pose of b: 2 and 3 m/s."""
    chosen = options(tmp_path, ("/a/pose", "/b/pose"))
    assert fit(chosen) == 0


def test_two_that_say_the_same_are_one(tmp_path):
    _, _, found = set_up(options(tmp_path, ("/a/pose", "/a/again", "/b/pose")))
    assert found.pairs == {"a": "/a/pose", "b": "/b/pose"}


def test_two_that_may_be_one_body_are_not_chosen_from(tmp_path):
    chosen = options(tmp_path, ("/a/pose", "/a/odom", "/b/pose", "/b/odom"))
    with pytest.raises(RbSimError, match="assign them with --match NAME=BODY"):
        fit(chosen)


def test_wrenches_that_are_not_applied_are_reported(tmp_path, capsys):
    """A scene without a commanded_wrench takes no command."""
    set_up(options(tmp_path, ("/a/pose", "/b/pose")))
    assert "not applied" not in capsys.readouterr().err
    bag = with_wrenches(tmp_path / "bag", "map", "/body/push")
    scene = tmp_path / "cube.yaml"
    scene.write_text("bodies: {body: {mass: 2.0, inertia: [1, 1, 1], linear_velocity: [1, 0, 0]}}")
    set_up(FitOptions(bag, ["bodies.body.linear_velocity"], scene=str(scene)))
    reported = (
        "its wrenches (/body/push) are not applied: the scene has no commanded_wrench that takes"
    )
    assert f"note: {reported} them\n" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["/a/odom=a", "a=/a/odom"])
def test_a_match_is_read_in_both_orders(tmp_path, text):
    """As `compare` has it, the recorded name first; and as `fit` had it."""
    chosen = options(tmp_path, ("/a/pose", "/a/odom", "/b/pose"))
    _, _, found = set_up(replace(chosen, match=(text,)))
    assert found.pairs == {"a": "/a/odom"}


def test_a_match_of_other_names_is_refused(tmp_path):
    chosen = options(tmp_path, ("/a/pose", "/b/pose"))
    with pytest.raises(RbSimError, match=r"--match: got a=b; must be NAME=BODY, .* /a/pose"):
        set_up(replace(chosen, match=("a=b",)))
