"""A wheel, installed in a fresh venv, gives a working rb_sim and rb_sim_node."""

from __future__ import annotations

import subprocess
import sys
import venv
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

UV = Path(sys.executable).with_name("uv")
"""It installs in a seventh of pip's time, which does it where it is not."""


@pytest.fixture(scope="module")
def installed(source: Path, environment, tmp_path_factory) -> Path:
    """Folder of a venv with the wheel and its ROS extra."""
    folder = tmp_path_factory.mktemp("wheel")
    quick, python = UV.exists(), str(folder / "venv/bin/python")
    build = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(source)]
    build += ["--installer", "uv"] if quick else []
    subprocess.run(build, env=environment, check=True, capture_output=True)
    (wheel,) = folder.glob("rb_sim-*.whl")
    venv.create(folder / "venv", with_pip=not quick, symlinks=True)
    pip = [python, "-m", "pip", "install", "--quiet", "--no-compile"]
    uv = [str(UV), "pip", "install", "--quiet", "--python", python]
    subprocess.run([*(uv if quick else pip), f"{wheel}[ros]"], env=environment, check=True)
    return folder / "venv"


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


def test_rb_sim_lists_and_runs_the_shipped_scenes(installed: Path, environment, tmp_path: Path):
    listed = run(installed, environment, "rb_sim", "scenes", cwd=tmp_path)
    assert listed.returncode == 0, listed.stderr
    assert "rolling_sphere_commanded" in listed.stdout
    scene = installed / "share/rb_sim/config/rolling_sphere_commanded.yaml"
    result = run(
        installed, environment, "rb_sim", "run", str(scene),
        "--out", "here", "--duration", "0.1", "--no-rerun", "--quiet", cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "here/bag/metadata.yaml").is_file()


def test_recording_without_rerun_says_what_to_install(installed: Path, environment, tmp_path):
    scene = installed / "share/rb_sim/config/rolling_sphere_commanded.yaml"
    result = run(
        installed, environment, "rb_sim", "run", str(scene),
        "--out", "here", "--duration", "0.1", cwd=tmp_path,
    )  # fmt: skip
    assert "rb_sim[rerun]" in result.stdout + result.stderr
    assert "Traceback" not in result.stdout + result.stderr


def test_rb_sim_node_runs(installed: Path, environment, tmp_path: Path):
    scene = installed / "share/rb_sim/config/rolling_sphere_commanded.yaml"
    params = installed / "share/rb_sim/config/rb_sim_node.params.yaml"
    result = run(
        installed, environment, "rb_sim_node", "--ros-args", "--params-file", str(params),
        "-p", f"scene:={scene}", "-p", "duration:=0.2", "-p", "out:=here",
        "-p", "log_rerun:=false", cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "here/bag/metadata.yaml").is_file()
