# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim replay --publish`: what a subscriber gets of a bag, and the clock it runs by."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock

from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.replay import PlayOptions, play
from tests.bags.scenes import PUSHED, record_run
from tests.ros import bags
from tests.ros.client import NAME, Client, seconds
from tests.ros.conftest import START_TIMEOUT


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A second of a box: 51 samples."""
    return record_run(PUSHED, tmp_path / "bag")


@pytest.fixture
def player(bag: Path, tmp_path: Path):
    """The verb, which plays the bag again and again from t = 0.5 s."""
    options = ("--publish", "--loop", "--start", "0.5")
    command = [sys.executable, "-m", "rb_sim.cli.main", "replay", str(bag), *options]
    process = subprocess.Popen(command, cwd=tmp_path)
    yield process
    process.kill()
    process.wait()


def test_messages_are_the_recorded_ones_and_time_begins_anew(player, bag: Path, client: Client):
    offered = f"{NAME}/box/pose"
    client.until(lambda: client.node.count_publishers(offered), "the player", START_TIMEOUT)
    poses = client.listen(PoseStamped, "box/pose", raw=True)
    clocks = client.listen(Clock, "/clock")
    client.until(lambda: len(set(poses)) >= 26, "each sample from 0.5 s on")
    recorded = bags.read(bag)[f"{NAME}/box/pose"].raw
    assert set(poses) == set(recorded[25:])

    def went_back() -> bool:
        times = [seconds(message.clock) for message in clocks]
        return any(0.5 <= b < a for a, b in zip(times[:-1], times[1:], strict=True))

    client.until(went_back, "clock that goes back to the start")
    # a pause holds the clock until it goes on
    answer = client.pause()
    assert answer.success and answer.message.startswith("paused at t = ")
    client.until_it_stands(clocks)
    count, held = len(clocks), clocks[-1].clock
    client.until(lambda: len(clocks) >= count + 2, "the time, again and again")
    assert all(message.clock == held for message in clocks[count:])
    assert client.pause(False).success
    client.until(lambda: clocks[-1].clock != held, "clock again")
    player.send_signal(signal.SIGTERM)
    assert player.wait(120) == 0


def test_refusals(bag: Path):
    with pytest.raises(RbSimError, match=r"--rate: got -1; must be from 0 .*to 10000$"):
        play(bag, PlayOptions(rate=-1.0))
    with pytest.raises(RbSimError, match=r"--start: got nan; must be a time >= 0 \[s\]$"):
        play(bag, PlayOptions(start=float("nan")))
    with pytest.raises(RbSimError, match="^--loop: only with --publish$"):
        PlayOptions(loop=True).refuse()
    with pytest.raises(RbSimError, match="not with --save"):
        play(bag, PlayOptions(), alone=False)
