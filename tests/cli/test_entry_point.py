# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The command's first steps, before any verb has the signals in hand."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from tests.cli.process import PATIENCE, environment

STRUCK = """
import os, signal, sys
class Finder:
    '''Sends a signal when a module is about to be imported.'''
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), {number})
sys.meta_path.insert(0, Finder())
sys.argv = ["rb_sim", "scenes"]
from rb_sim.__main__ import main
main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["typer", "rb_sim.cli.options"])
def test_a_signal_while_the_verbs_are_imported_ends_in_one_line(number, module):
    code = STRUCK.format(module=module, number=int(number))
    ended = subprocess.run(
        [sys.executable, "-c", code], env=environment(), capture_output=True, text=True,
        timeout=PATIENCE,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (128 + number, "")
    assert ended.stderr == "interrupted\n"


def test_the_command_is_a_module_too():
    ended = subprocess.run(
        [sys.executable, "-m", "rb_sim", "--version"], env=environment(), capture_output=True,
        text=True, timeout=PATIENCE,
    )  # fmt: skip
    assert ended.returncode == 0 and ended.stdout.startswith("rb_sim ")


PARSING = """
import os, signal, sys, typer.main
made = typer.main.get_command
def struck(*arguments, **keywords):
    os.kill(os.getpid(), {number})
    return made(*arguments, **keywords)
typer.main.get_command = struck
sys.argv = ["rb_sim", "scenes"]
from rb_sim.__main__ import main
main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_command_line_is_read_ends_in_one_line(number):
    """Ctrl-C there ended in a traceback, or without a word."""
    ended = subprocess.run(
        [sys.executable, "-c", PARSING.format(number=int(number))], env=environment(),
        capture_output=True, text=True, timeout=PATIENCE,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout, ended.stderr) == (128 + number, "", "interrupted\n")


THREADS = """
import os, sys
sys.argv = ["rb_sim", "--help"]
from {module} import main
try:
    main()
except SystemExit:
    pass
import scipy.linalg
print("threads:", len(os.listdir("/proc/self/task")))
"""


@pytest.mark.parametrize("module", ["rb_sim.__main__", "rb_sim.ros.main"])
def test_small_matrices_are_not_shared_among_threads(module):
    """OpenBLAS made one for each core, and the last digits of a bag hung on how many there were."""
    if module == "rb_sim.ros.main":
        pytest.importorskip("rclpy")
    without = {k: v for k, v in environment().items() if k != "OPENBLAS_NUM_THREADS"}

    def threads(environ: dict[str, str]) -> str:
        ended = subprocess.run(
            [sys.executable, "-c", THREADS.format(module=module)], env=environ,
            capture_output=True, text=True, timeout=PATIENCE,
        )  # fmt: skip
        return ended.stdout.splitlines()[-1]

    assert threads(without) == threads(without | {"OPENBLAS_NUM_THREADS": "1"})
