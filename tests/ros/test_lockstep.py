# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""~/advance: wrenches in, N samples, and the state that came of it."""

from __future__ import annotations

import hashlib
import math
import signal
import subprocess
import sys

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import SetBool, Trigger

from benchmarks import lockstep_client
from rb_sim.ros import build_interfaces
from tests.ros import bags
from tests.ros.client import NAME, Client, seconds, vector
from tests.ros.conftest import START_TIMEOUT

M, A, G = 2.0, 0.1, 9.81


def wrench(force=(0, 0, 0), torque=(0, 0, 0), body="ball", frame="world"):
    from rb_sim_interfaces.msg import BodyWrench

    message = BodyWrench(body=body, frame_id=frame)
    for of, numbers in ((message.wrench.force, force), (message.wrench.torque, torque)):
        of.x, of.y, of.z = map(float, numbers)
    return message


def test_the_answer_is_the_state_after_n_samples(advance, sphere, start, client, tmp_path):
    """Against the closed form of Landau & Lifshitz, section 38, problem 1."""
    node = start(sphere, out=tmp_path, start_paused=True)
    F, K = (1.5, -0.7, 3.0), (0.05, 0.08, -0.02)
    client.send(force=(9.0, 0, 0))  # what has not acted yet gives way to the request
    for k in range(1, 4):
        answer = client.call(advance, "advance", wrenches=[wrench(F, K)], samples=7)
        assert answer.success and answer.samples == 7, answer.message
        t = 0.07 * k
        assert seconds(answer.stamp) == pytest.approx(t, abs=1e-9)
        (body,), (reaction,) = answer.bodies, answer.reactions
        a = 5 / (7 * M) * np.array([F[0] + K[1] / A, F[1] - K[0] / A])
        np.testing.assert_allclose(vector(body.pose.position)[:2], 0.5 * a * t**2, rtol=1e-8)
        np.testing.assert_allclose(vector(body.twist.linear)[:2], a * t, rtol=1e-8)
        R = (5 * K[1] / (7 * A) - 2 / 7 * F[0], -5 * K[0] / (7 * A) - 2 / 7 * F[1], M * G - F[2])
        np.testing.assert_allclose(vector(reaction.wrench.force), R, rtol=1e-8)
        assert (body.body, reaction.constraint, reaction.body) == ("ball", "floor", "ball")
        assert answer.residual < 1e-12
    assert node.stop() == 0
    applied = bags.read(tmp_path / "bag")[f"{NAME}/ball/wrench_applied"].wrench
    np.testing.assert_array_equal(applied[1:], np.tile([*F, *K], (21, 1)))


def test_the_same_requests_give_the_same_files(advance, sphere, start, client, tmp_path):
    """To the byte, whatever the clock on the wall did."""
    sums = []
    for run in ("first", "second"):
        node = start(sphere, out=tmp_path / run, start_paused=True)
        for k in range(5):
            asked = [wrench((math.sin(k), 0.3 * k, 0), (0, 0.01 * k, 0.02))]
            assert client.call(advance, "advance", wrenches=asked, samples=20).success
            client.spin(0.1 * (run == "second"))
        assert node.stop() == 0
        bag = tmp_path / run / "bag"
        files = sorted(bag.iterdir())
        sums.append([(f.name, hashlib.sha256(f.read_bytes()).hexdigest()) for f in files])
    assert sums[0] == sums[1]
    assert len(bags.read(tmp_path / "first" / "bag")[f"{NAME}/ball/pose"].raw) == 101


def test_a_package_that_cannot_be_built_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    said: list[str] = []
    builds = [build for build in build_interfaces.begin() if build.package == "rb_sim_interfaces"]
    build_interfaces.finish(builds, said.append)
    if builds:
        assert said == [
            "no services ~/advance and ~/set_state: rb_sim_interfaces: there is no C compiler (gcc)"
        ]


BUILT_BEFORE = """
from rb_sim.ros import build_interfaces as interfaces
assert interfaces.begin() == []
import tf2_msgs.msg, rb_sim_interfaces.srv
"""


def test_what_an_earlier_start_has_built_takes_no_process(advance, transforms):
    """Two processes that only look would take the time of the node's own imports."""
    command = [sys.executable, "-c", BUILT_BEFORE]
    done = subprocess.run(command, capture_output=True, text=True, timeout=START_TIMEOUT)
    assert done.returncode == 0, done.stderr


def test_a_client_in_c_is_answered_with_the_reason(sphere, start, client, advance, tmp_path):
    """The program of benchmarks/lockstep_client.c, which knows rcl and no Python."""
    program = lockstep_client.compiled(tmp_path)
    node = start(sphere, out=tmp_path, start_paused=True)
    assert lockstep_client.requests(program, f"{NAME}/advance", count=40, warm=2) > 0.0
    assert client.trigger("step").message == "t = 0.43 s"
    assert client.pause(False).success
    with pytest.raises(SystemExit, match="refused: only while paused"):
        lockstep_client.requests(program, f"{NAME}/advance", count=1, warm=0)
    assert node.stop() == 0
    times = bags.read(tmp_path / "bag")[f"{NAME}/ball/pose"].t
    np.testing.assert_allclose(times, 0.01 * np.arange(len(times)), atol=1e-9)


def test_a_request_goes_no_further_than_the_duration(advance, sphere, start, client, tmp_path):
    node = start(sphere, out=tmp_path, start_paused=True,
                 duration=0.5)  # fmt: skip
    assert client.call(advance, "advance", samples=40).samples == 40
    answer = client.call(advance, "advance", samples=40)
    assert not answer.success and answer.samples == 10
    assert answer.message == "the duration of 0.5 s is over"
    assert seconds(answer.stamp) == 0.5
    assert node.wait() == 0
    assert len(bags.read(tmp_path / "bag")[f"{NAME}/ball/pose"].t) == 51


def test_the_last_sample_lies_within_the_duration(sphere, start):
    """Where it is no whole number of periods: not the nearest sample, which lies beyond."""
    node = start(sphere, ready=False, duration=0.017, real_time_factor=0)
    assert node.wait() == 0
    assert "stopped at t = 0.01 s (duration over)" in node.text


def test_a_signal_ends_a_long_request_which_says_how_far_it_came(
    advance, sphere, start, client: Client, tmp_path
):
    node = start(sphere, out=tmp_path, start_paused=True)
    reported = client.listen(DiagnosticArray, "/diagnostics")
    client.call(advance, "advance", samples=1)
    step, pause = client.service(Trigger, "step"), client.service(SetBool, "pause")
    future = client.ask(advance, "advance", samples=100_000_000)
    client.diagnostics(lambda v: int(v["samples"]) > 1000, "samples of the request")
    waiting = [step.call_async(Trigger.Request()), pause.call_async(SetBool.Request(data=False))]
    reported.clear()
    client.until(lambda: len(reported) >= 2, "diagnostics")  # they go on
    assert not future.done()
    node.process.send_signal(signal.SIGTERM)
    client.until(future.done, "the answer")
    answer = future.result()
    assert not answer.success and answer.message == "the node is ending"
    client.until(lambda: all(one.done() for one in waiting), "the other answers")
    assert [one.result().message for one in waiting] == ["the node is ending"] * 2
    assert node.wait() == 0
    assert bags.count(tmp_path / "bag", f"{NAME}/ball/pose") == answer.samples + 2
