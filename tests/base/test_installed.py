"""A start with packages that are missing or too old says which, and how to get them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rb_sim.base.installed import complaint, lacking

ROOT = Path(__file__).parents[2]


def test_what_fits_is_not_named():
    assert complaint(["numpy>=1.20", "scipy>=1.0,!=1.1.*", "plotly>=99; extra == 'sweep'"]) == ""


def test_what_is_missing_and_what_is_too_old_in_one_line():
    wants = ["numpy>=1.20", "scipy>=99.1", "no-such-package>=2.0", "other-one"]
    assert [needs for _, needs in lacking(wants)] == [
        "scipy>=99.1",
        "no-such-package>=2.0",
        "other-one",
    ]
    line = complaint(wants)
    assert "\n" not in line
    assert "must be at least 99.1" in line and "no-such-package is not installed" in line
    assert "pip install 'scipy>=99.1' 'no-such-package>=2.0' 'other-one'" in line


def test_versions_are_compared_as_numbers():
    assert not lacking(["numpy>=1.3"])  # 1.26 and 2.x are later than 1.3


@pytest.mark.parametrize(
    "command",
    [["-m", "rb_sim", "run", "pendulum"], ["-m", "rb_sim.ros.main", "pendulum"]],
    ids=["command line", "node"],
)
def test_apts_pydantic_ends_the_start_in_one_line(tmp_path, command):
    """Ubuntu 24.04 has pydantic 1.10, which lacks names that are imported."""
    if "rb_sim.ros.main" in command:
        pytest.importorskip("rclpy")
    package = tmp_path / "pydantic"
    package.mkdir()
    (package / "__init__.py").write_text("VERSION = '1.10.14'\n")
    info = tmp_path / "pydantic-1.10.14.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: pydantic\nVersion: 1.10.14\n")
    path = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH", ""))))
    done = subprocess.run(
        [sys.executable, *command],
        env=os.environ | {"PYTHONPATH": path, "ROS_DOMAIN_ID": "77"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: pydantic is 1.10.14 and must be at least 2.7")
    assert "pip install 'pydantic>=2.7'" in line
