# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where the logs go: nothing that is there is replaced unless that is asked for."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from rosgraph_msgs.msg import Clock

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.io.bag.reader import BagReader
from rb_sim.ros import log_process as process
from rb_sim.ros.log_process import Begin, End, LogProcess, Opened, Plan, frame, rows_of
from rb_sim.ros.log_writer import claim, out_folder, own_folder
from tests.ros import bags
from tests.ros.client import NAME, Client, seconds

LOGGING = {"real_time_factor": 0, "duration": 0.1}


def test_an_earlier_bag_is_not_replaced_unless_asked(sphere, start, tmp_path):
    out = tmp_path / "run"
    file = out / "bag" / "bag_0.mcap"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"of an earlier run")
    first = start(sphere, ready=False, out=out, **LOGGING)
    assert first.wait() == 2
    assert f"parameter out: {out} already contains bag" in first.text
    assert "overwrite:=true" in first.text and "Traceback" not in first.text
    assert file.read_bytes() == b"of an earlier run"
    second = start(sphere, out=out, overwrite=True, **{**LOGGING, "duration": 0.2})
    assert second.wait() == 0
    assert len(bags.read(out / "bag")["/rb_sim/ball/pose"].raw) == 21


@pytest.mark.parametrize("log", ["bag", "recording.rrd", "plots.png"])
def test_any_log_in_the_folder_counts(log, tmp_path: Path):
    assert out_folder(str(tmp_path), overwrite=False) == tmp_path
    (tmp_path / log).touch()
    with pytest.raises(RbSimError, match=f"already contains {log}"):
        out_folder(str(tmp_path), overwrite=False)
    assert out_folder(str(tmp_path), overwrite=True) == tmp_path


def test_a_folder_is_one_process_s_and_what_came_meanwhile_is_not_replaced(tmp_path: Path):
    """Also where two nodes were started together and both found it empty."""
    of = Simulation("rolling_sphere_commanded", announce=None)
    plan = Plan(tmp_path / "run", False, "/rb_sim", False, False, True, 0, {}, {})
    said: list[str] = []
    first, second, third = [
        LogProcess(plan._replace(overwrite=over), 100, said.append) for over in (False, False, True)
    ]
    try:
        first.open(of.scene, of.layout)
        with pytest.raises(SinkError, match="run: another process is logging there"):
            second.open(of.scene, of.layout)
        third.open(of.scene, of.layout)
    finally:
        for one in (first, second, third):
            one.close()
    assert not said
    (tmp_path / "run" / "recording.rrd").touch()
    with pytest.raises(RbSimError, match=r"already contains recording\.rrd"):
        claim(tmp_path / "run", overwrite=False)


def test_two_runs_in_one_second_get_two_folders(tmp_path: Path, monkeypatch):
    """Before either has logs in it; a folder that cannot be made is told where a log is begun."""
    monkeypatch.setattr("time.strftime", lambda _: "now")
    named = out_folder(str(tmp_path / "run_{time}"), overwrite=False)
    assert [own_folder(named).name for _ in range(3)] == ["run_now", "run_now-2", "run_now-3"]
    (tmp_path / "file").touch()
    assert own_folder(tmp_path / "file" / "run").name == "run"


def test_the_bag_goes_on_in_another_file_in_a_folder_named_by_the_time(
    sphere, start, tmp_path: Path
):
    named = tmp_path / "run_{time}"
    node = start(sphere, out=named, **{**LOGGING, "duration": 1.0}, split_duration=0.3)
    assert node.wait() == 0
    (out,) = tmp_path.glob("run_20*")
    names = sorted(path.name for path in (out / "bag").glob("*.mcap"))
    assert names == ["bag_0.mcap", "bag_1.mcap", "bag_2.mcap", "bag_3.mcap"]
    poses = bags.read(out / "bag")["/rb_sim/ball/pose"]
    assert poses.t == pytest.approx([k / 100 for k in range(101)], abs=1e-9)


# The queue to the process that writes the logs, where that does not keep up.


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
def test_a_signal_while_the_writer_hangs_prints_what_is_waited_for(
    lockstep, sphere, start, client: Client, advance, tmp_path
):
    """The loop or a request waits for room; no sample is lost once the writer goes on."""
    pace = {"start_paused": True} if lockstep else {"real_time_factor": 0}
    logs = {"out": tmp_path, "log_queue": 2000}
    node = start(sphere, rate=1000, **pace, **logs)
    clocks = client.listen(Clock, "/clock")
    client.until(lambda: clocks, "the clock")
    (writer,) = psutil.Process(node.process.pid).children()
    writer.suspend()
    if lockstep:
        client.ask(advance, "advance", samples=4_000_000_000)
    client.until(lambda: seconds(clocks[-1].clock) > 2.0, "more samples than it takes")
    node.process.send_signal(signal.SIGINT)
    node.wait_for("warning: waits up to 120 s for the process that writes bag in")
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


def test_plots_that_fail_after_the_node_has_gone_are_reported(tmp_path: Path) -> None:
    """After a signal nobody waits for plots; what went wrong with them was told to nobody."""
    (tmp_path / "out").mkdir()
    scene = load_scene("heavy_top")
    simulation = Simulation(scene)
    simulation.advance(0.01)
    plan = Plan(tmp_path / "out", False, "", False, False, True, 0, {}, {})
    heard, answers = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-m", "rb_sim.ros.log_writer"],
        stdin=subprocess.PIPE,
        stdout=answers,
        stderr=subprocess.PIPE,
        text=False,
    )
    os.close(answers)
    assert process.stdin is not None
    process.stdin.write(frame(Begin(plan, scene, simulation.layout)))
    process.stdin.write(frame(rows_of([simulation.sample_row()])))
    process.stdin.flush()
    os.read(heard, 1)  # it has begun
    os.close(heard)
    (tmp_path / "out" / "plots.png").mkdir()  # where the picture is to be
    _, reported = process.communicate(frame(End(None)), timeout=240)
    assert b"plots.png" in reported, reported
