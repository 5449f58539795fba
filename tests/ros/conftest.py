# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The real node in a process of its own; the test process is its client over DDS."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.domains import own_domain

# Set before rclpy is imported, inherited by the nodes; one that was asked for is for one process.
if "PYTEST_XDIST_WORKER" in os.environ or "ROS_DOMAIN_ID" not in os.environ:
    os.environ["ROS_DOMAIN_ID"] = own_domain()
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import rclpy  # noqa: E402
from rclpy.context import Context  # noqa: E402

from tests.ros.client import Client  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
START_TIMEOUT = 240.0
"""[s]: the first start compiles."""


class NodeProcess:
    """A running rb_sim_node and what it has said so far."""

    def __init__(self, arguments: list[str], log: Path, limit: str = "") -> None:
        command = [sys.executable, "-m", "rb_sim.ros.main", *arguments]
        if limit:
            command = ["bash", "-c", f'{limit}; exec "$@"', "bash", *command]
        self._log = log
        with log.open("w") as file:
            self.process = subprocess.Popen(
                command, cwd=log.parent, stdout=file, stderr=subprocess.STDOUT
            )

    @property
    def text(self) -> str:
        """Everything said so far."""
        return self._log.read_text()

    def wait_for(self, words: str, timeout: float = START_TIMEOUT) -> None:
        """Until the node has said `words`."""
        end = time.monotonic() + timeout
        while words not in self.text:
            assert self.process.poll() is None, f"the node ended: {self.text}"
            assert time.monotonic() < end, f"no {words!r} in: {self.text}"
            time.sleep(0.02)

    def stop(self, number: int = signal.SIGTERM) -> int:
        """Send a signal; the exit status."""
        self.process.send_signal(number)
        return self.process.wait(START_TIMEOUT)

    def wait(self, timeout: float = START_TIMEOUT) -> int:
        """The exit status."""
        return self.process.wait(timeout)


@contextmanager
def starting(folder: Path) -> Iterator[Callable[..., NodeProcess]]:
    """start(scene, name=value, ...) starts a node with these parameters, which ends with the block.

    ready: wait until it runs. It looks for no other node of its name unless a value of `discovery`
    is given: each of these tests has a domain of its own. In `out` it writes the bag alone unless
    others are asked for.
    limit: shell command before it (ulimit). ros: more ROS arguments.
    """
    running: list[NodeProcess] = []

    def begin(
        scene: Path | str, *, ready: bool = True, limit: str = "", ros: tuple[str, ...] = (),
        **values: object,
    ) -> NodeProcess:  # fmt: skip
        arguments = [str(scene), "--ros-args", *ros]
        bag_alone = {"log_rerun": False, "log_plots": False} if "out" in values else {}
        for name, value in ({"discovery": 0} | bag_alone | values).items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            arguments += ["-p", f"{name}:={text}"]
        node = NodeProcess(arguments, folder / f"node{len(running)}.log", limit)
        running.append(node)
        if ready:
            node.wait_for("takes commands on")
        return node

    try:
        yield begin
    finally:
        for node in running:
            if node.process.poll() is None:
                node.process.kill()
                node.process.wait()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """See `starting`."""
    with starting(tmp_path) as begin:
        yield begin


def importable(package: str) -> None:
    """Find the interface package in a ROS installation or build it; skip without a compiler."""
    from rb_sim.ros import build_interfaces

    if build_interfaces.is_there(package):
        return
    if shutil.which("g++") is None or shutil.which("gcc") is None:
        pytest.skip(f"no C compiler to build {package} with")
    if not Path(sysconfig.get_paths()["include"], "Python.h").exists():
        pytest.skip(f"no Python headers to build {package} with")
    build_interfaces.need(package)


@pytest.fixture(scope="session")
def transforms() -> type:
    """tf2_msgs/TFMessage."""
    importable("tf2_msgs")
    from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]

    return TFMessage


@pytest.fixture(scope="session")
def advance() -> type:
    """The service type, from a ROS installation or built here; skipped without a compiler."""
    importable("rb_sim_interfaces")
    from rb_sim_interfaces.srv import Advance  # type: ignore[import-not-found]

    return Advance


@pytest.fixture(scope="session")
def context() -> Iterator[Context]:
    """Its publishers learn soon who has their messages; other processes speak as a user's do."""
    context = Context()
    with pytest.MonkeyPatch.context() as patch:
        profiles = Path(__file__).with_name("prompt_writers.xml")
        patch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(profiles))
        rclpy.init(context=context)
        rclpy.create_node("first", context=context).destroy_node()
    yield context
    rclpy.shutdown(context=context)


@pytest.fixture
def client(context: Context) -> Iterator[Client]:
    client = Client(context)
    yield client
    client.close()


@pytest.fixture(scope="session")
def sphere() -> Path:
    """The shipped rolling sphere: m = 2 kg, a = 0.1 m, commanded."""
    return ROOT / "config" / "rolling_sphere_commanded.yaml"
