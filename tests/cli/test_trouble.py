# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Trouble in the middle of a run: signals, failures, full disk, vanished folder."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.cli.verbs.analyze import AnalyzeOptions, analyze
from rb_sim.cli.verbs.compare import CompareOptions, compare
from rb_sim.cli.verbs.run import RunOptions, run
from rb_sim.io.bag.folder import recover_bag
from rb_sim.io.bag.reader import BagReader
from rb_sim.simulation.outputs import writing
from tests.bags.analysis import foreign
from tests.cli.process import COMMAND, PATIENCE, environment, lines, rb_sim, start, wait_until

ENDLESS = ("--duration", 1e9)


def samples_in(bag) -> int:
    return sum(len(block) for block in BagReader(bag).blocks())


@pytest.mark.parametrize(
    ("number", "rate"),
    [(signal.SIGTERM, 100), (signal.SIGINT, 1e-8)],
    ids=["SIGTERM", "between two samples that are far apart"],
)
def test_signal_finishes_the_logs(number, rate, tumble, tmp_path):
    process = start("run", tumble, "--out", tmp_path, *ENDLESS, "--rate", rate, "--no-rerun")
    bag = tmp_path / "bag" / "bag_0.mcap"
    wait_until(bag.exists, process)
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=PATIENCE)
    assert process.returncode == 128 + number, stderr
    (line,) = lines(stderr)
    assert line.startswith("interrupted at t = ") and line.endswith(f"are in {tmp_path}")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == f"interrupted by {number.name}"
    assert summary["samples"] == samples_in(tmp_path / "bag") >= 1
    assert (tmp_path / "bag" / "metadata.yaml").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_while_plots_are_drawn_leaves_them_out(number, tumble, tmp_path, monkeypatch):
    """Drawing takes seconds; the rest of the logs is whole."""
    from matplotlib.figure import Figure

    drawn = []

    def savefig(figure, file, **options):
        file.write(b"half a picture")
        os.kill(os.getpid(), number)
        drawn.append(figure)

    monkeypatch.setattr(Figure, "savefig", savefig)
    options = RunOptions(str(tumble), out=tmp_path, rerun=False, quiet=True)
    assert run(options) == 128 + number
    assert drawn == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "summary.json"]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outputs"]["plots"]["left_out"] == f"not drawn after {number.name}"
    assert summary["samples"] == samples_in(tmp_path / "bag") == 201


@pytest.mark.parametrize("logs", [False, True], ids=["no logs", "logs"])
def test_a_second_signal_says_what_it_leaves(logs, tumble, tmp_path):
    """Both come as the run finishes, before its logs are complete."""
    code = """
import os, signal, sys
from rb_sim.cli import main
from rb_sim.cli.verbs import run
from rb_sim.simulation import signals
signals.ONE = 0.0  # as if the second one came later
def finish(*_):
    for _ in range(2):
        os.kill(os.getpid(), signal.SIGINT)
run._Run._finish = finish
sys.exit(main.main())
"""
    command = [sys.executable, "-c", code, "run", str(tumble), "--quiet"]
    command += ["--out", str(tmp_path / "out"), "--no-rerun", "--no-plots"] if logs else []
    ended = subprocess.run(
        command, env=environment(), capture_output=True, text=True, timeout=PATIENCE
    )
    assert ended.returncode == 130
    left = ": the logs are not finished; use rb_sim recover" if logs else ""
    assert ended.stderr == f"interrupted twice{left}\n"


def on_springs(path, count):
    """A scene file with so long laws that any machine compiles them for some time."""
    springs = "".join(
        f"  spring_{k}: {{type: spring, body: a, stiffness: 10, point_A: [{k}, 1, 0]}}\n"
        for k in range(count)
    )
    path.write_text(
        "bodies: {a: {mass: 1, inertia: [1, 1, 1]}}\n"
        f"effects:\n{springs}"
        "simulation: {method: rk4, step: 0.001, rate: 100, duration: 1}\n"
    )
    return path


@pytest.mark.parametrize("contact", [False, True], ids=["one body", "contact"])
def test_signal_while_compiling_ends_at_once(tmp_path, contact):
    from subprocess import PIPE, Popen

    env = environment(RB_SIM_CACHE=str(tmp_path / "cache"), RB_SIM_COMPILE="1")
    scene = "dropped_box" if contact else on_springs(tmp_path / "springs.yaml", 64)
    command = [*COMMAND, "run", str(scene), "--out", str(tmp_path / "out")]
    with Popen(command, env=env, stdout=PIPE, stderr=PIPE, text=True) as process:
        assert process.stderr is not None and process.stdout is not None
        assert process.stderr.readline().startswith("compiling")
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130
        assert process.stderr.read() == "interrupted before the first step\n"
        assert process.stdout.read() == ""


def test_a_run_that_fails_keeps_what_was_logged(tmp_path, capfd):
    """Explicit steps on a stiff drag: v grows by |1 - c h / m| per step until it overflows."""
    path = tmp_path / "stiff.yaml"
    path.write_text(
        "bodies: {a: {mass: 1, inertia: [1, 1, 1], linear_velocity: [1, 0, 0]}}\n"
        "effects: {oil: {type: linear_drag, body: a, coefficient: 1.0e+3}}\n"
        "simulation: {method: rk4, step: 0.1, rate: 100, duration: 100}\n"
    )
    assert run(RunOptions(str(path), out=tmp_path / "out", rerun=False, quiet=True)) == 1
    said = capfd.readouterr()
    assert said.out == ""
    *warnings, line = lines(said.err)
    reported = sorted(warning.split(": ")[:2] for warning in warnings)
    assert reported == [["warning", "energy"], ["warning", "step"]]
    assert line.startswith("error: the state is no longer finite at t = ")
    assert line.endswith(f"the samples up to then are in {tmp_path / 'out'}")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert "no longer finite" in summary["outcome"]
    assert summary["samples"] == samples_in(tmp_path / "out" / "bag") > 10


def test_full_disk_drops_the_log_and_goes_on(tumble, tmp_path):
    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, 1_500_000))

    options = ("--out", tmp_path, "--rate", 4000, "--duration", 5, "--no-rerun", "--no-plots")
    done = rb_sim("run", tumble, *options, preexec_fn=small_files)
    assert done.returncode == 1
    (line,) = lines(done.stderr)
    assert line.startswith("warning: ") and line.endswith("; the run continues without bag")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["simulated"] == 5.0 and summary["samples"] == 20001
    bag = summary["outputs"]["bag"]
    assert bag["failure"] and 0 < bag["lost_at_least"] < 20001
    directory = tmp_path / "bag"
    if not (directory / "metadata.yaml").exists():
        directory = recover_bag(directory).directory
    assert samples_in(directory) > 500


def test_vanished_folder_drops_the_logs_and_goes_on(tumble, tmp_path):
    out = tmp_path / "out"
    process = start("run", tumble, "--out", out, "--rate", 1000, "--duration", 60)
    bag = out / "bag" / "bag_0.mcap"
    wait_until(lambda: bag.exists() and bag.stat().st_size > 1 << 18, process)  # all logs are open
    process.send_signal(signal.SIGSTOP)  # it must not end before the folder is away
    shutil.rmtree(out)
    process.send_signal(signal.SIGCONT)
    stdout, stderr = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert "simulated" in stdout and "60 s" in stdout
    warnings = [line for line in lines(stderr) if line.startswith("warning: ")]
    assert any("bag" in line for line in warnings), stderr
    assert any("summary.json" in line for line in warnings)
    assert "Traceback" not in stderr
    assert not out.exists()


# Verbs whose results do not fit: one line, and no half copy of a bag.


@contextmanager
def small_files(size: int) -> Iterator[None]:
    """No file may have more bytes: RLIMIT_FSIZE stands for a full disk. Python would keep what it
    compiles meanwhile cut off, too."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    kept, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = kept


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    return foreign.write(tmp_path_factory.mktemp("full") / "bag")


@pytest.mark.parametrize("verb", ["analyze", "compare"])
def test_results_that_do_not_fit_are_reported_in_one_line(verb, bag, tmp_path):
    out = tmp_path / "out"
    with small_files(200), pytest.raises(RbSimError) as caught:
        if verb == "analyze":
            analyze(AnalyzeOptions(bag, out))
        else:
            compare(CompareOptions(bag, str(bag), out=out))
    assert str(caught.value) == f"--out {out}: cannot write there: File too large"


def test_what_is_said_of_a_folder(tmp_path):
    with pytest.raises(RbSimError, match="^--out .*out: cannot write there: No space left$"):
        with writing(tmp_path / "out"):
            raise OSError(28, "No space left")


@pytest.mark.parametrize("size", [0, 200, 20_000])
def test_a_copy_that_does_not_fit_is_removed(size, bag, tmp_path):
    """At its first byte, in its first chunk, and when it is finished."""
    with small_files(size), pytest.raises(SinkError, match="cannot recover: File too large$"):
        recover_bag(bag, tmp_path / "copy")
    assert list(tmp_path.iterdir()) == []
