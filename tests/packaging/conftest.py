# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A clean copy of the source tree, and an environment that another venv's Python can start in."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.domains import own_domain

ROOT = Path(__file__).resolve().parents[2]
IGNORED = shutil.ignore_patterns(
    *(".git", ".venv*", ".*_cache", "__pycache__", "*.egg-info"),
    *("build", "install", "log", "out", "dist"),
)
FOR_THIS_VENV = {
    *("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"),
    *("PYTHONPATH", "AMENT_PREFIX_PATH"),
}


@pytest.fixture(scope="session")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tree as a fresh clone has it."""
    target = tmp_path_factory.mktemp("source") / "rb_sim"
    shutil.copytree(ROOT, target, ignore=IGNORED)
    return target


@pytest.fixture(scope="session")
def environment() -> dict[str, str]:
    """This process's environment without what the ROS wheels set for this venv alone."""
    kept = {key: value for key, value in os.environ.items() if key not in FOR_THIS_VENV}
    return kept | {"ROS_DOMAIN_ID": own_domain(), "PYTHONNOUSERSITE": "1"}


UV = Path(sys.executable).with_name("uv")
"""It installs in a seventh of pip's time, which does it where it is not."""


@pytest.fixture(scope="session")
def wheel(source: Path, environment, tmp_path_factory) -> Path:
    """The wheel of that tree."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(source)]
    build += ["--installer", "uv"] if UV.exists() else []
    subprocess.run(build, env=environment, check=True, capture_output=True)
    (made,) = folder.glob("rb_sim-*.whl")
    return made


def install(folder: Path, environment: dict[str, str], *packages: str) -> None:
    """Install packages into the venv in this folder."""
    python = str(folder / "bin/python")
    by_pip = [python, "-m", "pip", "install", "--quiet", "--no-compile"]
    by_uv = [str(UV), "pip", "install", "--quiet", "--python", python]
    command = [*(by_uv if UV.exists() else by_pip), *packages]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def made_with(folder: Path, environment: dict[str, str], *packages: str) -> Path:
    """A new venv in this folder, with these packages."""
    venv.create(folder, with_pip=not UV.exists(), symlinks=True)
    install(folder, environment, *packages)
    return folder
