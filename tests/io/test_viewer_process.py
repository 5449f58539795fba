# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The viewer's process ends with ours, whatever ends ours."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

HOST = """
import subprocess, sys
from rb_sim.io.rerun.viewer import viewer_process
child = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"
grandchild = "import os, time; print(os.getpid(), flush=True); time.sleep(600)"
with viewer_process([sys.executable, "-c", child, grandchild]) as process:
    process.wait()
"""


def gone(number: int) -> bool:
    """Whether no process of this number runs (one that nobody waits for has ended too)."""
    try:
        with open(f"/proc/{number}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="looks into /proc")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_ends_the_viewer_and_its_child_too(number: signal.Signals):
    signals = "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL);"
    signals += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    command = [sys.executable, "-c", signals + HOST]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as host:
        assert host.stdout is not None
        grandchild = int(host.stdout.readline())
        assert not gone(grandchild)
        host.send_signal(number)
        status = host.wait(timeout=60)
    assert status in (128 + number, -number)
    deadline = time.monotonic() + 60
    while not gone(grandchild):
        assert time.monotonic() < deadline
        time.sleep(0.01)
