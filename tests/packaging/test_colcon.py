# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The same tree built by colcon gives a working rb_sim_node behind setup.bash."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def workspace(source: Path, wheel: Path, environment) -> Path:
    """A colcon workspace with the tree built in it; loops that the wheel has are not compiled once
    more, which takes 15 s."""
    with zipfile.ZipFile(wheel) as made:
        loops = [n for n in made.namelist() if n.startswith("rb_sim/compiler/loops-")]
        made.extractall(source, loops)
    colcon = str(Path(sys.executable).with_name("colcon"))
    result = subprocess.run(
        [colcon, "build", "--base-paths", str(source)],
        cwd=source.parent, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return source.parent


def sourced(workspace: Path, environment, command: str) -> subprocess.CompletedProcess[str]:
    script = f"set -e; . install/setup.bash; exec {command}"
    return subprocess.run(
        ["bash", "-c", script],
        cwd=workspace, env=environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip


def test_executables_and_share_are_where_ros_looks(workspace: Path):
    prefix = workspace / "install/rb_sim"
    for name in ("rb_sim", "rb_sim_node"):
        assert (prefix / "lib/rb_sim" / name).is_file()
    assert (prefix / "share/rb_sim/launch/rb_sim.launch.py").is_file()
    assert (prefix / "share/ament_index/resource_index/packages/rb_sim").is_file()


def test_setup_bash_puts_the_built_package_first(workspace: Path, environment):
    command = f"{sys.executable} -c 'import rb_sim; print(rb_sim.__file__)'"
    result = sourced(workspace, environment, command)
    assert result.returncode == 0, result.stderr
    assert Path(result.stdout.strip()).is_relative_to(workspace / "install")


def test_the_node_runs_with_ros_arguments(workspace: Path, environment):
    share = "install/rb_sim/share/rb_sim/config"
    result = sourced(
        workspace,
        environment,
        f"install/rb_sim/lib/rb_sim/rb_sim_node --ros-args -r __ns:=/demo"
        f" --params-file {share}/rb_sim_node.params.yaml"
        f" -p scene:={share}/rolling_sphere_commanded.yaml"
        f" -p duration:=0.2 -p out:=here -p log_rerun:=false",
    )
    assert result.returncode == 0, result.stderr
    assert (workspace / "here/bag/metadata.yaml").is_file()


def test_a_workspace_with_the_link_of_the_docs_has_both_packages(source: Path, tmp_path):
    """colcon looks for no package inside another one."""
    text = (source / "docs/install.md").read_text()
    (line,) = (each for each in text.splitlines() if "git clone URL rb_sim &&" in each)
    link = line.partition("git clone URL rb_sim && ")[2]
    (tmp_path / "src").mkdir()
    shutil.copytree(source, tmp_path / "src/rb_sim")
    listed = [str(Path(sys.executable).with_name("colcon")), "list", "--names-only"]

    def names() -> list[str]:
        done = subprocess.run(listed, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert names() == ["rb_sim"]
    subprocess.run(["bash", "-ec", link], cwd=tmp_path / "src", check=True)
    assert names() == ["rb_sim", "rb_sim_interfaces"]


def test_rb_sim_finds_the_shipped_scenes(workspace: Path, environment):
    result = sourced(workspace, environment, "install/rb_sim/lib/rb_sim/rb_sim scenes")
    assert result.returncode == 0, result.stderr
    assert "rolling_sphere_commanded" in result.stdout
