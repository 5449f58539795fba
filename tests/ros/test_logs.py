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

from pathlib import Path

import pytest

from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.ros.logs.folder import claim, out_folder, own_folder
from rb_sim.ros.logs.process import LogProcess
from rb_sim.ros.logs.protocol import Plan
from rb_sim.ros.parameters import Settings
from rb_sim.simulation.simulation import Simulation
from tests.ros import bags

LOGGING = {"real_time_factor": 0, "duration": 0.1}


def test_an_earlier_bag_is_not_replaced_unless_asked(sphere, start, tmp_path):
    out = tmp_path / "run"
    file = out / "bag" / "bag_0.mcap"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"of an earlier run")
    first = start(sphere, ready=False, out=out, **LOGGING)
    assert first.wait() == 1
    assert f"parameter out: {out} has bag already" in first.text
    assert "overwrite:=true" in first.text and "Traceback" not in first.text
    assert file.read_bytes() == b"of an earlier run"
    second = start(sphere, out=out, overwrite=True, **{**LOGGING, "duration": 0.2})
    assert second.wait() == 0
    assert len(bags.read(out / "bag")["/rb_sim/ball/pose"].raw) == 21


def test_time_in_the_name_gives_every_run_a_folder(sphere, start, tmp_path):
    """Also nodes that are started together, as a launch file does: one was refused."""
    named = [("-r", f"__node:=robot_{k}") for k in range(2)]
    nodes = [start(sphere, ready=False, ros=r, out=tmp_path / "{time}", **LOGGING) for r in named]
    assert [node.wait() for node in nodes] == [0, 0]
    folders = [path for path in tmp_path.iterdir() if (path / "bag" / "metadata.yaml").exists()]
    assert len(folders) == 2 and all(path.name.startswith("20") for path in folders)


@pytest.mark.parametrize("log", ["bag", "recording.rrd", "plots.png"])
def test_any_log_in_the_folder_counts(log, tmp_path: Path):
    assert out_folder(str(tmp_path), overwrite=False) == tmp_path
    (tmp_path / log).touch()
    with pytest.raises(RbSimError, match=f"has {log} already"):
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
    with pytest.raises(RbSimError, match=r"has recording\.rrd already"):
        claim(tmp_path / "run", overwrite=False)


def test_two_runs_in_one_second_get_two_folders(tmp_path: Path, monkeypatch):
    """Before either has logs in it; a folder that cannot be made is told where a log is begun."""
    monkeypatch.setattr("time.strftime", lambda _: "now")
    named = out_folder(str(tmp_path / "run_{time}"), overwrite=False)
    assert [own_folder(named).name for _ in range(3)] == ["run_now", "run_now-2", "run_now-3"]
    (tmp_path / "file").touch()
    assert own_folder(tmp_path / "file" / "run").name == "run"


def test_the_bag_goes_on_in_another_file_by_size_or_by_duration(sphere, start, tmp_path: Path):
    out = tmp_path / "run"
    node = start(sphere, out=out, **{**LOGGING, "duration": 1.0}, split_duration=0.3)
    assert node.wait() == 0
    names = sorted(path.name for path in (out / "bag").glob("*.mcap"))
    assert names == ["bag_0.mcap", "bag_1.mcap", "bag_2.mcap", "bag_3.mcap"]
    poses = bags.read(out / "bag")["/rb_sim/ball/pose"]
    assert poses.t == pytest.approx([k / 100 for k in range(101)], abs=1e-9)


def test_a_file_of_too_few_bytes_is_refused(sphere, start, tmp_path: Path):
    node = start(sphere, ready=False, out=tmp_path / "run", split_size=5000)
    assert node.wait() == 1
    assert "parameter split_size: got 5000; must be 0 (never) or at least 100000" in node.text
    assert not (tmp_path / "run" / "bag").exists()


def test_the_size_reaches_the_bag():
    assert Settings(split_size=200_000).split == {"split_size": 200_000, "split_duration": None}
    assert Settings().split == {"split_size": None, "split_duration": None}
