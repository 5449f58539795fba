"""Interface packages that ROS wheels lack: found, or built in the background while others compile.

rb_sim_interfaces gives lockstep, tf2_msgs gives /tf. A ROS installation has both.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from rb_sim.errors import RbSimError

USES = {
    "rb_sim_interfaces": "no services ~/advance and ~/set_state",
    "tf2_msgs": "no topic /tf (the bag has it)",
}
"""What is off without each package."""
LIMIT = 600.0
"""[s] for a build."""


class Build(NamedTuple):
    """A build that goes on in a process of its own."""

    package: str
    process: subprocess.Popen[str]


def is_there(package: str) -> bool:
    """True if the package can be imported with its types."""
    spec = find_spec(package)
    return spec is not None and spec.origin is not None


def need(package: str) -> None:
    """Make the package importable, built first where ROS was installed by pip; for clients.

    Raises RbSimError where it cannot be built.
    """
    from rb_sim.ros.build_interfaces import build

    if not is_there(package):
        _import_from(build(package))


def _import_from(folder: Path) -> None:
    sys.path.append(str(folder))
    importlib.invalidate_caches()


def begin() -> list[Build]:
    """Start to build what is neither there nor built before."""
    module = "rb_sim.ros.build_interfaces"
    return [
        Build(
            package,
            subprocess.Popen(
                [sys.executable, "-m", module, package],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                start_new_session=True,
            ),
        )
        for package in USES
        if not (is_there(package) or _was_built(package))
    ]


def _was_built(package: str) -> bool:
    """Whether an earlier start has built it: importable then, without a process that looks."""
    from rb_sim.ros.build_interfaces import kept

    with suppress(RbSimError):  # the process says why
        if (folder := kept(package)) is not None:
            _import_from(folder)
            return True
    return False


def finish(builds: list[Build], say: Callable[[str], None]) -> None:
    """Make the built packages importable; say in one line what is off where one could not be."""
    for package, process in builds:
        try:
            lines = process.communicate(timeout=LIMIT)[0].strip().splitlines()
        except subprocess.TimeoutExpired:
            process.kill()
            lines = []
        answer = lines[-1] if lines else f"error: {package}: the build ended early"
        folder = Path(answer)
        if process.returncode == 0 and folder.is_dir():
            _import_from(folder)
        else:
            say(f"{USES[package]}: {answer.removeprefix('error: ')}")
