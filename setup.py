"""The one build description, read by pip and by colcon (ament_python) alike."""

import os
import platform
import shutil
import subprocess
import sys
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py
from setuptools.command.develop import develop

HERE = Path(__file__).resolve().parent
COMPILE_LOOPS = "rb_sim.compiler.ship"
"""Writes the machine code of loops into the package that it is imported from."""


def repository():
    """Address of the repository; package.xml alone names it, None if it names none."""
    return ElementTree.parse(HERE / "package.xml").findtext("url[@type='repository']")


def compile_loops(root, *machines):
    """Compile the loops of the package below root; without them they are compiled on first use.

    RB_SIM_LOOPS=later leaves that to whoever installs (`make run`).
    """
    if os.environ.get("RB_SIM_LOOPS") == "later":
        return
    command = [sys.executable, "-m", COMPILE_LOOPS, *machines]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True)
    if done.returncode != 0:
        last = done.stderr.strip().rpartition("\n")[2]
        print(f"warning: loops are not compiled, which the first start does: {last}")


class BuildPy(build_py):
    """The package with its loops: for all machines, or in the sources for this one."""

    def run(self):
        """Copy the sources, and loops that are compiled already; then compile what is not."""
        super().run()
        editable = getattr(self, "editable_mode", False)
        if not editable:
            for made in HERE.glob("rb_sim/compiler/loops-*-linux.bin"):
                shutil.copy(made, Path(self.build_lib) / "rb_sim" / "compiler")
        compile_loops(
            HERE if editable else Path(self.build_lib).resolve(),
            *([platform.machine()] if editable else []),
        )


class Develop(develop):
    """`colcon build --symlink-install`, which runs no build_py."""

    def run(self):
        """Link the sources, then compile."""
        super().run()
        if not getattr(self, "uninstall", False):  # setuptools 80 knows it no more
            compile_loops(HERE, platform.machine())


setup(
    name="rb_sim",
    version="0.1.0",
    description="Rigid-body dynamics with explicit constraint reactions, for ROS 2 and without it",
    license="Apache-2.0",
    author="rb_sim contributors",
    maintainer="rb_sim contributors",
    url=repository(),
    keywords="rigid-body multibody dynamics constraints contact friction ROS2 MCAP",
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Science/Research",
        "Intended Audience :: Education",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Topic :: Scientific/Engineering :: Physics",
    ],
    python_requires=">=3.11",
    packages=find_packages(include=["rb_sim", "rb_sim.*"]),
    package_data={
        "rb_sim": ["py.typed"],
        "": ["loops.json"],
        "rb_sim.io": ["page/*.css", "page/*.html", "page/*.js"],
    },
    cmdclass={"build_py": BuildPy, "develop": Develop},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/rb_sim"]),
        ("share/rb_sim", ["package.xml"]),
        ("share/rb_sim/config", sorted(glob("config/*.yaml"))),
        ("share/rb_sim/config/statics", sorted(glob("config/statics/*.yaml"))),
        ("share/rb_sim/config/hard_cases", sorted(glob("config/hard_cases/*.yaml"))),
        ("share/rb_sim/config/sweeps", sorted(glob("config/sweeps/*.yaml"))),
        ("share/rb_sim/interfaces/msg", sorted(glob("interfaces/msg/*.msg"))),
        ("share/rb_sim/interfaces/srv", sorted(glob("interfaces/srv/*.srv"))),
        ("share/rb_sim/launch", sorted(glob("launch/*.launch.py"))),
    ],
    # The lower bounds are the versions that `make test-floor` runs with (requirements/floor.txt).
    # Those of the extras below are the versions on which their tests were run by hand.
    # ROS wheels stay out of here: on a ROS installation apt provides rclpy.
    install_requires=[
        "numpy>=1.26",
        "scipy>=1.11",
        "llvmlite>=0.42,!=0.44.*",  # 0.44 has neither pointers of LLVM 14 nor those of LLVM 20
        "pydantic>=2.7",
        "pyyaml>=6.0.1",
        "typer>=0.12.5",
        "rich>=13.7",
        "matplotlib>=3.8",
        "mcap>=1.2,<2",
        "zstandard>=0.22",
    ],
    extras_require={
        "ros": ["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"],
        "rerun": ["rerun-sdk>=0.40"],
        "notebook": ["rerun-sdk[notebook]>=0.40"],
        "analysis": [
            "pandas>=2.2",
            "xarray>=2024.1",
            "pyarrow>=18",
            "plotly>=5.24",
            "rosbags>=0.11",  # bags in SQLite storage
        ],
        "sweep": [
            "dask>=2024.8",
            "distributed>=2024.8",
            "pyarrow>=18",
            "plotly>=5.24",
            "SALib>=1.5",
        ],
        "peers": [
            "mujoco>=4.0",
            "drake>=1.51",
            "exudyn>=1.13.6",
            "pybullet>=3.2.7",
            "dartpy>=6.20",
            "pin>=4.1",
            "heyoka>=7.13",
        ],
        "bench": ["foxglove-sdk>=0.30"],  # a writer of bags to measure ours beside
        "test": [
            "clarabel",  # an independent solver of friction problems
            "cyclonedds>=11",  # a client of the node that knows no ROS
            "pytest>=8",
            "pytest-xdist",
            "hypothesis",
            "rosbags>=0.11",
            "control",
            "plotly>=5.24",
            "pandas>=2.2",
            "xarray>=2024.1",
            "zensical>=0.0.73",
            "mkdocstrings[python]>=0.29",
            "nbclient",
            "nbformat",
            "ipykernel",
            # readers of a sweep's table, each in one line
            "polars",
            "duckdb",
        ],
        "dev": [
            "ruff",
            "pyrefly>=1.5",
            "import-linter",
            "build",
            "colcon-core",
            "colcon-ros",
            "colcon-package-information",
            "colcon-bash",
        ],
    },
    entry_points={
        "console_scripts": [
            "rb_sim = rb_sim.__main__:main",
            "rb_sim_node = rb_sim.ros.main:main",
        ],
    },
    zip_safe=False,
)
