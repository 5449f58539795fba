# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Beside apt's packages of Ubuntu 24.04: one line on what is too old, and the venv that works.

A venv with apt's versions (requirements/apt.txt) stands for the system's Python.
"""

from __future__ import annotations

import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.packaging.conftest import install, made_with

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]


def packages_of(folder: Path) -> Path:
    """Where a venv has its packages."""
    (found,) = folder.glob("lib/python3.*/site-packages")
    return found


def run(command: list[str], environment: dict[str, str], cwd: Path) -> subprocess.CompletedProcess:
    return subprocess.run(
        command, env=environment, cwd=cwd, capture_output=True, text=True, timeout=600, check=False
    )


def pip(folder: Path, environment: dict[str, str], *arguments: str) -> None:
    """By this environment's pip, which runs in the other one: none has to be made there first."""
    command = [sys.executable, "-m", "pip", "--python", str(folder / "bin/python"), "install"]
    command += ["--quiet", "--no-compile", *arguments]
    done = run(command, environment, folder)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def system(wheel: Path, environment, tmp_path_factory) -> Path:
    """The system's Python with apt's packages, and rb_sim as colcon puts it there."""
    packages = ("--requirement", str(ROOT / "requirements/apt.txt"))
    folder = made_with(tmp_path_factory.mktemp("apt") / "system", environment, *packages)
    install(folder, environment, "--no-deps", str(wheel))
    return folder


@pytest.fixture(scope="module")
def beside(system: Path, wheel: Path, environment) -> Path:
    """The venv of docs/install.md: it sees the system's packages, and brings newer ones."""
    folder = system.parent / "venv"
    venv.create(folder, symlinks=True)
    # what --system-site-packages does for the Python that a venv is made from
    (packages_of(folder) / "system.pth").write_text(f"{packages_of(system)}\n")
    # the system's rb_sim has the same version and other dependencies to look at
    pip(folder, environment, "--ignore-installed", "--no-deps", str(wheel))
    pip(folder, environment, str(wheel))
    return folder


def test_a_start_on_apts_packages_says_in_one_line_what_is_too_old(system, environment, tmp_path):
    done = run([str(system / "bin/rb_sim"), "run", "pendulum"], environment, tmp_path)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    for wrong in ("pydantic is 1.10.14", "typer is 0.9.0", "matplotlib is 3.6.3"):
        assert wrong in line
    assert "mcap is not installed" in line and "numpy" not in line and "scipy" not in line
    assert "pip install" in line and "--system-site-packages" in line


def test_the_venv_beside_them_runs_on_apts_numpy(beside, environment, tmp_path):
    command = [str(beside / "bin/rb_sim"), "run", "heavy_top", "--duration", "0.1", "--out", "here"]
    done = run([*command, "--no-rerun", "--quiet"], environment, tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "here/bag/metadata.yaml").is_file()
    assert (tmp_path / "here/plots.png").is_file()
    asked = "import numpy, scipy, pydantic; print(numpy.__version__, scipy.__version__)"
    versions = run([str(beside / "bin/python"), "-c", asked], environment, tmp_path).stdout
    assert versions.split() == ["1.26.4", "1.11.4"]
