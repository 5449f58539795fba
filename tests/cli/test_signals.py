# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Signals before a verb begins, and while verbs run that log no run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator

import pytest

from rb_sim.cli.main import _exit_code
from rb_sim.simulation import signals
from rb_sim.simulation.signals import Interruption, terminable
from tests.cli.process import PATIENCE, environment


@pytest.fixture(autouse=True)
def _signals_of_a_terminal() -> Iterator[None]:
    """Whoever runs the tests may ignore some (nohup)."""
    usual = {n: signal.SIG_DFL for n in signals.SIGNALS} | {
        signal.SIGINT: signal.default_int_handler
    }
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_verb_that_is_ended_leaves_no_folder_behind(number, tmp_path, capsys):
    def act() -> int:
        with tempfile.TemporaryDirectory(dir=tmp_path):
            os.kill(os.getpid(), number)
            time.sleep(60.0)
        return 0

    assert _exit_code(act) == 128 + number
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err == "interrupted\n"
    assert signal.getsignal(signal.SIGTERM) == signal.getsignal(signal.SIGHUP) == signal.SIG_DFL


def test_handlers_of_others_stay():
    heard = []
    before = signal.signal(signal.SIGTERM, lambda number, _: heard.append(number))
    try:
        with terminable():
            os.kill(os.getpid(), signal.SIGTERM)
        assert heard == [signal.SIGTERM]
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_thread_leaves_the_signals_alone():
    """Only the main thread may take them."""
    failed = []

    def act() -> None:
        try:
            with terminable():
                pass
        except ValueError as error:
            failed.append(error)

    thread = threading.Thread(target=act)
    thread.start()
    thread.join()
    assert not failed


def test_a_forked_process_ends_by_the_signal():
    """A worker of a pool is ended by SIGTERM, without a word."""
    with terminable():
        reader, writer = os.pipe()
        child = os.fork()
        if not child:
            os.write(writer, b"up")  # what comes before Python is up in it is lost
            time.sleep(60.0)
            os._exit(0)
        os.read(reader, 2)
        os.kill(child, signal.SIGTERM)
        _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGTERM


class Lost:
    """What is raised while its callback runs goes nowhere, as in those of imports."""

    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)


def test_a_signal_that_a_callback_loses_is_answered_a_moment_later(tmp_path, capsys):
    """And once: what is removed on the way out is not left half done."""
    removed = []

    def act() -> int:
        try:
            lost = Lost()
            del lost
            time.sleep(60.0)
            removed.append("a minute later")
        finally:
            time.sleep(0.5)
            removed.append("all")
        return 0

    before = signal.getsignal(signal.SIGALRM)
    assert _exit_code(act) == 128 + signal.SIGTERM
    assert removed == ["all"] and capsys.readouterr().err == "interrupted\n"
    assert signal.getsignal(signal.SIGALRM) == before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_an_alarm_that_comes_as_the_timer_is_stopped_does_not_start_it_again(monkeypatch, capsys):
    """The process ended by it a tenth of a second later, about once in a hundred times at load."""
    stop = signal.setitimer

    def late(which: int, seconds: float) -> tuple[float, float]:
        before = stop(which, seconds)
        if not seconds:
            os.kill(os.getpid(), signal.SIGALRM)
        return before

    def act() -> int:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60.0)
        return 0

    monkeypatch.setattr(signal, "setitimer", late)
    try:
        assert _exit_code(act) == 128 + signal.SIGTERM
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    finally:
        stop(signal.ITIMER_REAL, 0.0)
    assert capsys.readouterr().err == "interrupted\n"


def test_two_signals_within_a_second_are_one(monkeypatch):
    """GNU timeout signals its child and then the group; a later one ends the process at once."""
    clock = [100.0]
    monkeypatch.setattr(signals.time, "monotonic", lambda: clock[0])
    left = []
    monkeypatch.setattr(Interruption, "_leave", lambda _, line: left.append(line))
    with Interruption() as stop:
        stop.logging = True
        for later, count in ((0.0, 0), (0.9, 0), (1.1, 1)):
            clock[0] = 100.0 + later
            os.kill(os.getpid(), signal.SIGTERM)
            assert len(left) == count
            assert stop.cause is signal.SIGTERM
    assert left == ["interrupted twice"]


ENDING = """
import atexit, os, signal, sys
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    atexit.register(os.kill, os.getpid(), number)
{start}
"""


@pytest.mark.parametrize(
    ("start", "status"),
    [
        ("from rb_sim.__main__ import main\nsys.argv = ['rb_sim', 'scenes']\nmain()", 0),
        ("from rb_sim.__main__ import main\nsys.argv = ['rb_sim', 'run', 'none']\nmain()", 2),
        ("from rb_sim.ros.main import main\nsys.exit(main(['--help']))", 0),
    ],
    ids=["done", "refused", "node"],
)
def test_signals_while_the_process_ends_do_not_change_its_status(start, status):
    """systemd and ros2 launch send one more to what has answered the first."""
    if "ros" in start:
        pytest.importorskip("rclpy")
    code = ENDING.format(start=start)
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=PATIENCE)
    assert ended.returncode == status, ended.stderr


IN_A_SCRIPT = """
import os, signal, sys
from rb_sim.simulation.signals import Interruption
with Interruption() as stop:
    stop.logging = True
    for number in (signal.SIGHUP, signal.SIGINT):
        os.kill(os.getpid(), number)
        print(stop.cause and stop.cause.name)
"""


def test_what_a_script_starts_in_the_background_hears_sigint_and_nohup_is_kept():
    """A shell without job control has SIGINT ignored for what it starts by `&`."""
    command = f"trap '' HUP; {sys.executable} -c '{IN_A_SCRIPT}' & wait"
    ended = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=PATIENCE)
    assert ended.stdout.split() == ["None", "SIGINT"], ended.stderr


# The command's first steps, before any verb has the signals in hand.


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


@pytest.mark.parametrize(
    ("number", "module"), [(signal.SIGINT, "typer"), (signal.SIGTERM, "rb_sim.cli.options")]
)
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
    os.kill(os.getpid(), signal.SIGINT)
    return made(*arguments, **keywords)
typer.main.get_command = struck
sys.argv = ["rb_sim", "scenes"]
from rb_sim.__main__ import main
main()
"""


def test_a_signal_while_the_command_line_is_read_ends_in_one_line():
    """Ctrl-C there ended in a traceback, or without a word."""
    ended = subprocess.run(
        [sys.executable, "-c", PARSING], env=environment(),
        capture_output=True, text=True, timeout=PATIENCE,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "interrupted\n")


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
