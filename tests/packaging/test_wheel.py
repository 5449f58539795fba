# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A wheel, installed in a fresh venv, gives a working rb_sim and rb_sim_node."""

from __future__ import annotations

import os
import subprocess
import zipfile
from pathlib import Path

import pytest

from rb_sim.ros.build_interfaces import USES, kept
from tests.packaging.conftest import made_with

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def installed(wheel: Path, environment, tmp_path_factory) -> Path:
    """Folder of a venv with the wheel and its ROS extra."""
    return made_with(tmp_path_factory.mktemp("venv") / "venv", environment, f"{wheel}[ros]")


def run(installed: Path, environment, *command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(installed / "bin" / command[0]), *command[1:]],
        env=environment, cwd=cwd, capture_output=True, text=True, timeout=300,
    )  # fmt: skip


def test_files_are_where_ros_looks(installed: Path):
    share = installed / "share"
    assert (share / "ament_index/resource_index/packages/rb_sim").is_file()
    assert (share / "rb_sim/package.xml").is_file()
    assert (share / "rb_sim/launch/rb_sim.launch.py").is_file()
    assert (share / "rb_sim/config/rb_sim_node.params.yaml").is_file()
    assert (share / "rb_sim/interfaces/srv/Advance.srv").is_file()


FIRST_START = """
import sys
from rb_sim import Simulation, load_scene
from rb_sim.compiler.program import on_compilation

def fail():
    sys.exit("a loop is compiled")

with on_compilation(fail):
    stepping = {"method": "time_stepping", "step": 0.005}
    for name, given in (("heavy_top", {}), ("dropped_box", {}), ("dropped_box", stepping)):
        simulation = Simulation(load_scene(name, **given))
        simulation.advance(0.02)
print("stepped")
"""


def test_the_wheel_brings_the_loops_of_both_machines_and_the_page(wheel: Path):
    names = {Path(name).name for name in zipfile.ZipFile(wheel).namelist()}
    assert {"loops.json", "loops-x86_64-linux.bin", "loops-aarch64-linux.bin"} <= names
    assert {"page.html", "page.css", "page.js", "plots.js", "solids.js"} <= names  # rb_sim show


def test_a_first_start_compiles_no_loop(installed: Path, environment, tmp_path: Path):
    new = {**environment, "HOME": str(tmp_path), "RB_SIM_CACHE": str(tmp_path / "cache")}
    for name in ("XDG_CACHE_HOME", "RB_SIM_COMPILE", "RB_SIM_CHECK_BOUNDS", "RB_SIM_INTERPRETED"):
        new.pop(name, None)
    result = run(installed, new, "python", "-c", FIRST_START, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("stepped")


def test_rb_sim_lists_and_runs_the_shipped_scenes(installed: Path, environment, tmp_path: Path):
    listed = run(installed, environment, "rb_sim", "scenes", cwd=tmp_path)
    assert listed.returncode == 0, listed.stderr
    assert "rolling_sphere_commanded" in listed.stdout
    scene = installed / "share/rb_sim/config/rolling_sphere_commanded.yaml"
    result = run(
        installed, environment, "rb_sim", "run", str(scene),
        "--out", "here", "--duration", "0.1", cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "here/bag/metadata.yaml").is_file()
    # it has no Rerun, and says what to install for a recording
    assert "rb_sim[rerun]" in result.stdout + result.stderr
    assert "Traceback" not in result.stdout + result.stderr


def test_rb_sim_node_runs(installed: Path, environment, tmp_path: Path):
    """With the interface packages that nodes of this venv have built: anew they take 12 s."""
    built = [str(folder) for name in USES if (folder := kept(name)) is not None]
    environment = environment | {"PYTHONPATH": os.pathsep.join(built)}
    scene = installed / "share/rb_sim/config/rolling_sphere_commanded.yaml"
    params = installed / "share/rb_sim/config/rb_sim_node.params.yaml"
    result = run(
        installed, environment, "rb_sim_node", "--ros-args", "--params-file", str(params),
        "-p", f"scene:={scene}", "-p", "duration:=0.2", "-p", "out:=here",
        "-p", "log_rerun:=false", cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "no services" not in result.stdout + result.stderr
    assert (tmp_path / "here/bag/metadata.yaml").is_file()
