# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

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
    wants = ["numpy>=1.20", "scipy>=99.1", "no-such-package>=2.0,<3", "other-one"]
    assert [needs for _, needs in lacking(wants)] == [
        "scipy>=99.1",
        "no-such-package>=2.0,<3",
        "other-one",
    ]
    line = complaint(wants)
    assert "\n" not in line
    assert "must be at least 99.1" in line and "no-such-package is not installed" in line
    assert "pip install 'scipy>=99.1' 'no-such-package>=2.0,<3' 'other-one'" in line


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
        timeout=240,
        check=False,
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: pydantic is 1.10.14 and must be at least 2.7")
    assert "pip install 'pydantic>=2.7'" in line


@pytest.mark.parametrize(
    ("command", "begins"),
    [
        (["-m", "rb_sim", "run", "pendulum"], "error: "),
        (["-c", "import rb_sim; rb_sim.Simulation"], "ImportError: "),
    ],
    ids=["command line", "import"],
)
def test_a_bare_checkout_says_in_one_line_what_it_lacks(tmp_path, command, begins):
    """A tree that nothing was installed from: no packages, and no record of what it needs but
    setup.py."""
    for name in ("rb_sim", "setup.py"):
        (tmp_path / name).symlink_to(ROOT / name)
    done = subprocess.run(
        [sys.executable, "-S", *command],
        cwd=tmp_path,
        env={"PATH": os.environ["PATH"]},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 1
    line = done.stderr.splitlines()[-1]
    assert line.startswith(f"{begins}numpy is not installed; scipy is not installed")
    assert "pip install 'numpy>=" in line and "'typer>=" in line
    assert begins != "error: " or len(done.stderr.splitlines()) == 1


HIDING = """
import sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == HIDE:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hidden())
import rb_sim
"""


@pytest.mark.parametrize(
    ("hidden", "call", "recorded"),
    [
        ("matplotlib", "rb_sim.Simulation('heavy_top').run(0.01, check=False).plot()", True),
        ("scipy", "rb_sim.fit('no_bag', 'bodies.top.mass')", True),
        ("scipy", "rb_sim.compare('no_bag', 'heavy_top')", False),
        ("scipy", "rb_sim.analyze('no_bag')", True),
        ("scipy", "rb_sim.linearize('pendulum')", True),
        ("numpy", "rb_sim.statics('ladder')", False),
        ("yaml", "rb_sim.load_scene('heavy_top')", True),
    ],
)
def test_a_function_of_the_package_names_what_it_lacks(hidden, call, recorded, tmp_path):
    """Where it is called, in one line with the command that brings it, whatever is recorded of the
    installation (without that: as a bare checkout)."""
    if not recorded:
        (tmp_path / "rb_sim").symlink_to(ROOT / "rb_sim")
    done = subprocess.run(
        [sys.executable, "-c", f"HIDE = {hidden!r}\n{HIDING}{call}\n"],
        cwd=ROOT if recorded else tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT if recorded else tmp_path)},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 1
    line = done.stderr.splitlines()[-1]
    assert line.startswith(f"ImportError: {hidden} is not installed: pip install"), done.stderr


def test_without_matplotlib_a_run_says_so_at_its_start_and_is_kept(tmp_path):
    """The pictures are drawn last: the run is not lost for them."""
    code = (
        "import sys, importlib.util as util; find = util.find_spec\n"
        "util.find_spec = lambda name, *given: None if name == 'matplotlib' else find(name, *given)"
        "\nfrom rb_sim.__main__ import main\nmain()"
    )
    command = [sys.executable, "-c", code, "run", "thrown_ball", "--out", str(tmp_path / "here")]
    done = subprocess.run(
        [*command, "--no-rerun", "--no-check", "--duration", "0.1"],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (line,) = done.stderr.splitlines()
    assert "no plots.png" in line and "pip install matplotlib" in line and "--no-plots" in line
    assert (tmp_path / "here" / "summary.json").is_file()
