# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The end of a run, and trouble from outside: every sample so far stays readable."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from rosgraph_msgs.msg import Clock

from rb_sim.bags.info import info
from rb_sim.io.bag.folder import recover_bag
from rb_sim.io.bag.reader import BagReader
from rb_sim.ros.preparing import LOG_CUT
from tests.ros import bags
from tests.ros.client import NAME, Client
from tests.ros.conftest import START_TIMEOUT

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_the_run_after_the_sample_with_a_whole_bag(
    number, sphere, start, client: Client, tmp_path
):
    node = start(sphere, out=tmp_path)
    clocks = client.listen(Clock, "/clock")
    client.until(lambda: len(clocks) >= 10, "samples")
    assert node.stop(number) == 0
    assert f"({number.name})" in node.text and "Traceback" not in node.text
    stopped = float(node.text.rsplit("stopped at t = ", 1)[1].split()[0])
    pose = bags.read(tmp_path / "bag")[f"{NAME}/ball/pose"]
    np.testing.assert_allclose(pose.t, 0.01 * np.arange(len(pose.t)), atol=1e-9)
    assert pose.t[-1] == pytest.approx(stopped, abs=1e-9) and stopped > 0.0
    assert BagReader(tmp_path / "bag").summary["stopped_by"] == number.name


HOOKED = """
import os, signal, sys
from rb_sim.simulation import signals
from rb_sim.ros import main
signals.ONE = 0.0  # as if signals came one after the other
def before(owner, name):
    whole = getattr(owner, name)
    def signalled(*given):
        os.kill(os.getpid(), signal.SIGINT)
        return whole(*given)
    setattr(owner, name, signalled)
"""
"""before(owner, name): a SIGINT comes as that function of the node's begins."""


def hooked(hook: str, scene: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A node whose process ran `hook` first, to its end."""
    code = f"{HOOKED}\n{hook}\nsys.exit(main.main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, str(scene), "--ros-args", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=START_TIMEOUT)


@pytest.mark.parametrize("moment", ["need_rclpy", "_make_node"])
def test_a_signal_before_the_node_is_there_ends_it_in_one_line(moment, sphere):
    ended = hooked(f"before(main, {moment!r})", sphere)
    assert ended.returncode == 128 + signal.SIGINT
    assert ended.stderr == "interrupted before the first step\n"


def test_a_signal_after_the_run_changes_nothing(sphere):
    """ros2 launch sends one more to a node that takes itself down."""
    hook = "from rclpy.node import Node\nbefore(Node, 'destroy_node')"
    ended = hooked(hook, sphere, "-p", "duration:=0.1")
    assert ended.returncode == 0, ended.stderr
    assert "(duration over)" in ended.stderr + ended.stdout
    assert "Traceback" not in ended.stderr and "interrupted" not in ended.stderr


def test_two_signals_leave_no_logs_where_none_were_asked_for(sphere):
    """The second one ends a run that does not answer the first."""
    hook = "from rb_sim.ros.node import SimulationLoop\nbefore(SimulationLoop, 'run')"
    hook += "\nbefore(SimulationLoop, 'run')"
    ended = hooked(hook, sphere)
    assert ended.returncode == 128 + signal.SIGINT
    assert ended.stderr.splitlines()[-1] == "interrupted twice"


def test_a_killed_node_loses_no_sample_that_it_has_handed_over(sphere, start, client, tmp_path):
    """The process that writes the logs sees its input end, and finishes them."""
    node = start(sphere, out=tmp_path, rate=5)
    clocks = client.listen(Clock, "/clock")
    client.until(lambda: len(clocks) >= 8, "8 samples")
    node.process.kill()
    node.process.wait()
    until_there(tmp_path / "bag" / "metadata.yaml")
    stamps = bags.read(tmp_path / "bag")[f"{NAME}/ball/pose"].t
    assert len(stamps) >= 8 - 3, node.text  # at most those of the last 0.25 s
    np.testing.assert_allclose(stamps, 0.2 * np.arange(len(stamps)), atol=1e-9)


def test_a_killed_writer_leaves_all_but_the_last_second(sphere, start, client, tmp_path):
    """At 5 Hz a chunk takes minutes to fill."""
    node = start(sphere, out=tmp_path, rate=5)
    clocks = client.listen(Clock, "/clock")
    (writer,) = psutil.Process(node.process.pid).children()
    path = tmp_path / "bag" / "bag_0.mcap"
    client.until(lambda: len(clocks) >= 10 and path.stat().st_size > 20_000, "drafts")
    node.process.kill()
    writer.kill()
    writer.wait()
    stamps = bags.read(recover_bag(tmp_path / "bag").directory)[f"{NAME}/ball/pose"].t
    assert len(stamps) >= 1
    np.testing.assert_allclose(stamps, 0.2 * np.arange(len(stamps)), atol=1e-9)


def test_the_simulation_goes_on_where_the_writer_is_gone(sphere, start, client, tmp_path):
    """And it is said: no log may end without a word."""
    node = start(sphere, out=tmp_path)
    (writer,) = psutil.Process(node.process.pid).children()
    writer.kill()
    node.wait_for("the process that writes the logs has ended (-9)")
    values = client.diagnostics(lambda v: int(v["log rows dropped, bag"]) > 0, "dropped rows")
    assert values["level"] == "2" and f"no longer logged: {tmp_path}/bag" in values["message"]
    before = int(values["log rows dropped, bag"])
    client.diagnostics(lambda v: int(v["log rows dropped, bag"]) > before, "more of them")
    assert node.stop() == LOG_CUT
    assert f"not complete: {tmp_path}/bag" in node.text
    assert not info(tmp_path / "bag")["health"]["run_ended"]
    assert node.text.count("continues without bag") == 1 and "Traceback" not in node.text


BROKEN_LOGS = """
import sys
from rb_sim.ros import log_process
from rb_sim.ros import main
whole = log_process.rows_of
def broken(samples):
    return whole(samples)._replace(rows=None)
log_process.rows_of = broken
sys.exit(main.main(sys.argv[1:]))
"""


def test_a_writer_that_breaks_down_is_reported_though_it_closed_its_files(sphere, tmp_path):
    """Its bag is whole as a file and ends where it broke: nobody would miss the rest."""
    out = ("-p", f"out:={tmp_path}", "-p", "log_rerun:=false", "-p", "log_plots:=false")
    command = [sys.executable, "-c", BROKEN_LOGS, str(sphere), "--ros-args", *out]
    command += ["-p", "duration:=2.0"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=START_TIMEOUT)
    said = ended.stdout + ended.stderr
    assert ended.returncode == LOG_CUT
    assert said.count("the process that writes the logs has ended (1)") == 1, said
    assert "continues without bag" in said and "recover" not in said


def test_a_signal_leaves_the_plots_to_a_process_of_their_own(
    sphere, start, client: Client, tmp_path
):
    node = start(sphere, out=tmp_path, log_plots=True, real_time_factor=0)
    clocks = client.listen(Clock, "/clock")
    client.until(lambda: len(clocks) >= 10, "samples")
    assert node.stop() == 0
    assert "unfinished" not in node.text and "not finished" not in node.text
    assert len(bags.read(tmp_path / "bag")[f"{NAME}/ball/pose"].raw) > 1
    until_there(tmp_path / "plots.png")


WHILE_PLOTS_ARE_DRAWN = """
from rb_sim.ros.log_process import LogProcess
listen, heard = LogProcess._listen, []
def and_signals(logs):
    listen(logs)
    if logs.finished == ["bag"] and not heard:
        heard.append(True)
        for _ in range({signals}):
            os.kill(os.getpid(), signal.SIGINT)
LogProcess._listen = and_signals
close = LogProcess.close
def and_tells(logs, *given, **named):
    close(logs, *given, **named)
    print("closed with", *logs.finished, flush=True)
LogProcess.close = and_tells
"""


@pytest.mark.parametrize("signals", [1, 2])
def test_signals_while_plots_are_drawn_leave_whole_logs(signals, sphere, tmp_path):
    """The run was over: the first one ends the wait for its plots, the second one says what is
    not complete yet, which the bag is."""
    hook = WHILE_PLOTS_ARE_DRAWN.format(signals=signals)
    given = {"duration": 1.0, "out": tmp_path, "log_rerun": "false"}
    words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    ended = hooked(hook, sphere, *words)
    said = ended.stdout + ended.stderr
    reported = "interrupted twice: plots.png is still being drawn, by a process of its own"
    assert ended.returncode == (0 if signals == 1 else 128 + signal.SIGINT), said
    assert ("closed with bag\n" in said) == (signals == 1), "it waited for them"
    assert ("stopped at t = 1 s (SIGINT)" in said) == (signals == 1)
    assert (reported == said.splitlines()[-1]) == (signals == 2)
    assert len(bags.read(tmp_path / "bag")[f"{NAME}/ball/pose"].raw) == 101
    until_there(tmp_path / "plots.png")


def until_there(path: Path) -> None:
    """Wait for a file that a process without a parent writes."""
    end = time.monotonic() + 120.0
    while not path.exists():
        assert time.monotonic() < end, f"no {path}"
        time.sleep(0.1)


def test_a_full_disk_stops_the_log_and_not_the_simulation(sphere, start, client: Client, tmp_path):
    # a limit on file size, from outside, in place of a disk to fill
    node = start(
        sphere, out=tmp_path, real_time_factor=0, limit="ulimit -f 1100"
    )  # 1100 KiB: the bag's own reserve of 1 MiB fits
    node.wait_for("the run continues without bag")
    values = client.diagnostics(lambda v: int(v["log rows dropped, bag"]) > 0, "dropped rows")
    assert values["level"] == "2" and "no longer logged" in values["message"]
    assert node.stop() == LOG_CUT
    assert node.text.count("the run continues without bag") == 1 and "Traceback" not in node.text
    logged = int(values["samples"]) - int(values["log rows dropped, bag"])
    logged -= int(values["log queue [samples]"])
    lost_from = 0.01 * logged
    recovered = recover_bag(tmp_path / "bag", tmp_path / "recovered")
    stamps = bags.read(recovered.directory)[f"{NAME}/ball/pose"].t
    assert not info(recovered.directory)["health"]["whole"], "its run did not end"
    np.testing.assert_allclose(stamps, 0.01 * np.arange(len(stamps)), atol=1e-9)
    assert 0.0 < stamps[-1] and stamps[-1] >= 0.8 * lost_from  # all but the open chunk


def test_without_rclpy_one_line_says_what_to_install(sphere, tmp_path):
    """A Python that has everything but the ROS packages."""
    (tmp_path / "rclpy.py").write_text("raise ImportError('no ROS here')")
    result = subprocess.run(
        [sys.executable, "-m", "rb_sim.ros.main", str(sphere)],
        env=os.environ | {"PYTHONPATH": f"{tmp_path}:{ROOT}"}, capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert "pip install 'rb_sim[ros]'" in line and "source a ROS 2" in line
