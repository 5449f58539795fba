# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""~/pause, ~/step, ~/reset, and time while paused."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock

from tests.ros import bags
from tests.ros.client import NAME, Client, seconds, vector


def test_step_is_one_sample_period_with_its_clock_and_only_while_paused(
    sphere, start, client: Client
):
    start(sphere)
    answer = client.trigger("step")
    assert not answer.success and "only while paused" in answer.message
    assert client.pause().success
    clocks = client.listen(Clock, "/clock")
    before = client.until_it_stands(clocks)
    for k in range(1, 6):
        answer = client.trigger("step")
        assert answer.success
        # done when answered: the message tells the time reached
        assert float(answer.message.split()[2]) == pytest.approx(before + 0.01 * k, abs=1e-9)
    client.until(lambda: seconds(clocks[-1].clock) > before + 0.049, "5 clocks")
    # a clock that stands still is told again and again
    times = sorted({seconds(message.clock) for message in clocks})
    np.testing.assert_allclose(times[-5:], before + 0.01 * np.arange(1, 6), atol=1e-9)


def test_nothing_moves_while_paused_and_going_on_does_not_catch_up(sphere, start, client: Client):
    start(sphere)
    clocks = client.listen(Clock, "/clock")
    client.until(lambda: clocks, "clock")
    assert client.pause().success
    client.until_it_stands(clocks)
    stopped, count = clocks[-1].clock, len(clocks)
    client.until(lambda: len(clocks) >= count + 3, "the time, again and again")
    assert all(message.clock == stopped for message in clocks[count:])
    assert client.pause(False).success
    client.until(lambda: clocks[-1].clock != stopped, "clock again")
    after = next(seconds(m.clock) for m in clocks[count:] if m.clock != stopped)
    assert after == pytest.approx(seconds(stopped) + 0.01, abs=1e-9)


def test_reset_gives_the_initial_state_and_stamps_go_on(sphere, start, client: Client, tmp_path):
    node = start(sphere, out=tmp_path, start_paused=True)
    poses = client.listen(PoseStamped, "ball/pose")
    client.send(force=(1, 0, 0))
    for _ in range(5):
        client.trigger("step")
    answer = client.trigger("reset")
    assert answer.success and "t = 0.06 s" in answer.message
    # while nothing steps
    client.until(lambda: poses and seconds(poses[-1].header.stamp) > 0.055, "the initial state")
    assert seconds(poses[-1].header.stamp) == pytest.approx(0.06, abs=1e-9)
    np.testing.assert_allclose(vector(poses[-1].pose.position), [0, 0, 0.1], atol=1e-12)
    for _ in range(2):
        client.trigger("step")
    assert node.stop() == 0
    bag = bags.read(tmp_path / "bag")
    pose, wrench = bag[f"{NAME}/ball/pose"], bag[f"{NAME}/ball/wrench_applied"].wrench
    np.testing.assert_allclose(pose.t, 0.01 * np.arange(9), atol=1e-9)
    assert pose.position[5, 0] > 0.0
    np.testing.assert_allclose(pose.position[6:], np.tile([0, 0, 0.1], (3, 1)), atol=1e-12)
    np.testing.assert_array_equal(wrench[:, 0], [0, 1, 1, 1, 1, 1, 0, 0, 0])


def test_a_run_split_by_pauses_equals_the_run_in_one(sphere, start, client: Client, tmp_path):
    node = start(sphere, out=tmp_path / "split", start_paused=True)
    clocks = client.listen(Clock, "/clock")

    def reached(t: float) -> bool:
        return bool(clocks) and seconds(clocks[-1].clock) >= t

    client.pause(False)
    client.until(lambda: reached(0.1), "0.1 s")
    client.pause(True)
    for _ in range(3):
        client.trigger("step")
    between = client.until_it_stands(clocks)
    client.pause(False)
    client.until(lambda: reached(between + 0.1), "0.1 s more")
    assert node.stop() == 0
    one = start(sphere, out=tmp_path / "one", real_time_factor=0, duration=1)
    assert one.wait() == 0
    split = bags.read(tmp_path / "split" / "bag")[f"{NAME}/ball/pose"].raw
    whole = bags.read(tmp_path / "one" / "bag")[f"{NAME}/ball/pose"].raw
    count = min(len(split), len(whole))
    assert count > 10 and split[:count] == whole[:count]
