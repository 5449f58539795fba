"""A clean copy of the source tree, and an environment that another venv's Python can start in."""

from __future__ import annotations

import os
import shutil
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
