# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""~/set_state: what is set is the next sample; what is off the joints is refused or moved there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.ros import bags
from tests.ros.client import NAME, Client, vector

M, A = 2.0, 0.1


@pytest.fixture(scope="session")
def set_state(advance: type) -> type:
    from rb_sim_interfaces.srv import SetState  # type: ignore[import-not-found]

    return SetState


def state(body="ball", position=(0, 0, A), linear=(0, 0, 0), angular=(0, 0, 0), q=(0, 0, 0, 1)):
    from rb_sim_interfaces.msg import BodyState  # type: ignore[import-not-found]

    message: Any = BodyState(body=body)
    for of, names, numbers in (
        (message.pose.position, "xyz", position),
        (message.pose.orientation, "xyzw", q),
        (message.twist.linear, "xyz", linear),
        (message.twist.angular, "xyz", angular),
    ):
        for name, number in zip(names, numbers, strict=True):
            setattr(of, name, float(number))
    return message


def test_a_state_is_set_refused_projected_and_in_the_bag(
    set_state, advance, sphere, start, client: Client, tmp_path: Path
):
    """A homogeneous ball under force F: a = 5 F / (7 m); projected, its momenta about the point of
    contact stay: v = (5 v_0 + 2 a w_0) / 7 (Landau & Lifshitz, section 38)."""
    from rb_sim.bags.resim import resimulate
    from rb_sim.io.bag.as_run import scene_as_run
    from rb_sim.io.bag.reader import BagReader

    node = start(sphere, out=tmp_path / "run", start_paused=True)
    client.send(force=(1.0, 0, 0))
    for _ in range(5):
        assert client.trigger("step").success

    slipping = state(position=(3, 4, A), linear=(1, 0, 0), angular=(0, 0, 2))
    answer = client.call(set_state, "set_state", bodies=[slipping])
    assert not answer.success and "constraints.floor: the given velocity violates" in answer.message
    for wrong, words in (
        (state(body="moon"), "must be one or more of ball"),
        (state(q=(0, 0, 0, 2)), "ball.orientation: got length 2"),
        (state(linear=(np.nan, 0, 0)), "must be 3 finite numbers"),
    ):
        answer = client.call(set_state, "set_state", bodies=[wrong])
        assert not answer.success and words in answer.message

    rolling = state(position=(3, 4, A), linear=(1, 0, 0), angular=(0, 1 / A, 2))
    answer = client.call(set_state, "set_state", bodies=[rolling])
    assert answer.success and answer.message == "set at t = 0.06 s"
    (body,) = answer.bodies
    np.testing.assert_allclose(vector(body.pose.position), (3, 4, A), atol=1e-14)
    np.testing.assert_allclose(vector(body.twist.angular), (0, 10, 2), atol=1e-12)
    for _ in range(10):
        assert client.trigger("step").success
    answer = client.call(set_state, "set_state", bodies=[slipping], project=True)
    assert answer.success
    (body,) = answer.bodies
    np.testing.assert_allclose(vector(body.twist.linear), (5 / 7, 0, 0), atol=1e-9)
    np.testing.assert_allclose(vector(body.twist.angular), (0, 50 / 7, 2), atol=1e-8)
    assert client.trigger("step").success
    assert node.stop() == 0

    bag = bags.read(tmp_path / "run" / "bag")
    x = bag[f"{NAME}/ball/pose"].position[:, 0]
    acceleration, t = 5 / (7 * M), 0.01 * np.arange(11)
    np.testing.assert_allclose(x[6:17], 3 + t + 0.5 * acceleration * t**2, rtol=1e-9)
    assert x[17] == 3.0 and len(x) == 19
    assert [m.position[0] for m in bag[f"{NAME}/ball/state_command"].messages] == [3.0, 3.0]
    reader = BagReader(tmp_path / "run" / "bag")
    resimulate(reader, scene_as_run(reader, (), {}), tmp_path / "again")
    again = bags.read(tmp_path / "again")
    of_the_node = (f"{NAME}/description", f"{NAME}/state")  # its own run and its own states
    for found in (bag, again):
        for name in of_the_node:
            found.pop(name, None)
    assert {name: series.raw for name, series in again.items()} == {
        name: series.raw for name, series in bag.items()
    }
