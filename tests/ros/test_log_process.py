# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The queue to the process that writes the logs, where that does not keep up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.io.bag.reader import BagReader
from rb_sim.ros.logs import process
from rb_sim.ros.logs.process import LogProcess
from rb_sim.ros.logs.protocol import Begin, Block, End, Opened, Plan, frame
from tests.ros import bags
from tests.ros.client import NAME, Client


def test_a_bag_tells_how_many_samples_it_lacks(sphere, start, client: Client, tmp_path):
    """Of those that found the queue full while the simulation kept to the clock."""
    node = start(sphere, out=tmp_path, rate=1000, log_queue=100)
    (writer,) = psutil.Process(node.process.pid).children()
    writer.suspend()
    client.diagnostics(lambda v: int(v["log rows dropped, bag"]) > 0, "dropped rows")
    writer.resume()
    assert node.stop() == 0
    logged = bags.count(tmp_path / "bag", f"{NAME}/ball/pose")
    summary = BagReader(tmp_path / "bag").summary
    assert 0 < summary["samples_dropped"] == summary["samples"] - logged


@pytest.mark.parametrize("lockstep", [False, True])
def test_who_ends_a_node_whose_writer_hangs_is_told_what_it_waits_for(
    lockstep, sphere, start, client: Client, advance, tmp_path
):
    """The loop or a request waits for room; no sample is lost once the writer goes on."""
    pace = {"start_paused": True} if lockstep else {"real_time_factor": 0}
    logs = {"out": tmp_path, "log_queue": 2000}
    node = start(sphere, rate=1000, **pace, **logs)
    (writer,) = psutil.Process(node.process.pid).children()
    writer.suspend()
    if lockstep:
        asking = client.node.create_client(advance, f"{NAME}/advance")
        assert asking.wait_for_service(60.0)
        asking.call_async(advance.Request(samples=4_000_000_000))
    client.spin(2.0)  # it is full within a tenth of that
    node.process.send_signal(signal.SIGINT)
    node.wait_for("warning: waits up to 120 s for the process that writes bag in", 60.0)
    writer.resume()
    assert node.wait() == 0, node.text
    summary = BagReader(tmp_path / "bag").summary
    assert bags.count(tmp_path / "bag", f"{NAME}/ball/pose") == summary["samples"] > 2000
    assert summary["samples_dropped"] == 0


def test_a_writer_that_never_goes_on_leaves_a_cut_log(monkeypatch):
    """In as many seconds as it is waited for; the node has a status of its own then."""
    monkeypatch.setattr(process, "PATIENCE", 0.1)
    monkeypatch.setattr(process, "SOON", 0.01)
    said: list[str] = []
    plan = Plan(Path("nowhere"), False, "/sim", True, False, True, 0, {}, {})
    logs = LogProcess(plan, 10, said.append)
    logs._process.send_signal(signal.SIGSTOP)
    logs._opened = Opened("")
    logs.ending = lambda: True
    try:
        logs.close({}, patient=lambda: False)
        assert logs.incomplete == ["nowhere/bag"]
        (line,) = said
        assert "waits up to 0.1 s for the process that writes bag, plots.png in nowhere" in line
    finally:
        logs._process.kill()
        logs._process.wait()


def test_plots_that_fail_after_the_node_has_gone_are_told(tmp_path: Path) -> None:
    """After a signal nobody waits for plots; what went wrong with them was told to nobody."""
    (tmp_path / "out").mkdir()
    scene = load_scene("heavy_top")
    simulation = Simulation(scene)
    simulation.advance(0.01)
    plan = Plan(tmp_path / "out", False, "", False, False, True, 0, {}, {})
    heard, answers = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-m", "rb_sim.ros.logs.writer"],
        stdin=subprocess.PIPE,
        stdout=answers,
        stderr=subprocess.PIPE,
        text=False,
    )
    os.close(answers)
    assert process.stdin is not None
    process.stdin.write(frame(Begin(plan, scene, simulation.layout)))
    process.stdin.write(frame(Block(simulation.sample().block)))
    process.stdin.flush()
    os.read(heard, 1)  # it has begun
    os.close(heard)
    (tmp_path / "out" / "plots.png").mkdir()  # where the picture is to be
    _, told = process.communicate(frame(End(None)), timeout=120)
    assert b"plots.png" in told, told
