# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim run` from start to end: files, numbers, what is printed and what is not."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rb_sim.cli.verbs.run import RunOptions, run
from rb_sim.io.bag.reader import BagReader
from rb_sim.scene.listing import list_scenes
from tests.cli.process import environment, invoke, lines, rb_sim


def test_writes_bag_recording_plots_and_summary(tumble, tmp_path):
    out = tmp_path / "out"
    done = rb_sim("run", tumble, "--out", out, "--npz", tmp_path / "all.npz")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    names = {path.name for path in out.iterdir()}
    assert {"bag", "plots.png", "summary.json"} <= names
    assert str(out / "summary.json") in lines(done.stdout)[-1]

    summary = json.loads((out / "summary.json").read_text())
    assert summary["outcome"] == "finished"
    assert summary["steps"] == 2000
    assert summary["samples"] == 201
    assert summary["energy"]["relative"] < 1e-9
    assert summary["momentum"]["angular"]["relative"] < 1e-9
    assert 10.0 < summary["nanoseconds_per_step"] < 1e5
    assert summary["degrees_of_freedom"] == 6

    reader = BagReader(out / "bag")
    assert sum(len(block) for block in reader.blocks()) == 201
    assert reader.summary["steps"] == 2000
    with np.load(tmp_path / "all.npz") as columns:
        assert columns["t"].shape == (201,)
        spin = columns["angular_velocity.nut"]
        energy = (spin**2 @ [1.0, 2.0, 3.0]) / 2.0
        np.testing.assert_allclose(energy, energy[0], rtol=1e-9)


def test_the_table_names_what_matters(tumble):
    done = invoke("run", tumble)
    assert done.exit_code == 0
    for label in ("energy error", "momentum error", "constraint violation", "steps", "method"):
        assert label in done.stdout
    assert "times real time" in done.stdout
    assert "--out DIR" in lines(done.stdout)[-1]


@pytest.mark.parametrize("rate", [None, 30.0])
@pytest.mark.parametrize("scene", [scene.name for scene in list_scenes()])
def test_a_shipped_scene_passes_all_checks_at_its_own_settings(scene, rate, capsys):
    """And sampled otherwise: samples make no finding of what the motion has right."""
    assert run(RunOptions(scene, rate=rate, strict=True)) == 0
    assert "warning" not in capsys.readouterr().err


def test_quiet_prints_nothing_and_options_leave_things_out(tumble, tmp_path):
    options = ("--out", tmp_path, "--quiet", "--no-bag", "--no-rerun", "--no-plots")
    done = invoke("run", tumble, *options, "--duration", 0.5, "--rate", 10, "--step", 0.01)
    assert (done.exit_code, done.output) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["steps"], summary["samples"], summary["simulated"]) == (50, 6, 0.5)


def test_no_ros_no_matplotlib_no_rerun_unless_used(tumble):
    script = (
        "import sys\nfrom rb_sim.cli.main import app\n"
        f"app(['run', {str(tumble)!r}, '--quiet'], standalone_mode=False)\n"
        "print([m for m in sys.modules if m.split('.')[0] in ('rclpy', 'matplotlib', 'rerun')])"
    )
    assert run_python(script) == "[]"


def test_lists_and_helps_without_numerics():
    script = (
        "import sys\nfrom typer.testing import CliRunner\nfrom rb_sim.cli.main import app\n"
        "for verb in ('--help', 'scenes'):\n"
        "    assert CliRunner().invoke(app, [verb]).exit_code == 0\n"
        "heavy = ('llvmlite', 'scipy', 'matplotlib', 'rerun', 'mcap')\n"
        "print([m for m in sys.modules if m in heavy])"
    )
    assert run_python(script) == "[]"


def run_python(script: str) -> str:
    import subprocess
    import sys

    done = subprocess.run(
        [sys.executable, "-c", script],
        env=environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.fixture
def without_rerun(tmp_path):
    """An environment in which `import rerun` fails as if it were not installed."""
    folder = tmp_path / "hidden"
    (folder / "rerun").mkdir(parents=True)
    (folder / "rerun" / "__init__.py").write_text("raise ImportError('hidden')")
    return environment(path=str(folder))


def test_without_rerun_everything_else_works(tumble, tmp_path, without_rerun):
    done = rb_sim("run", tumble, "--out", tmp_path / "out", env=without_rerun)
    assert done.returncode == 0
    (note,) = lines(done.stderr)
    assert note.startswith("note: no recording.rrd") and "rb_sim[rerun]" in note
    assert (tmp_path / "out" / "bag" / "metadata.yaml").exists()
    assert "recording" not in json.loads((tmp_path / "out" / "summary.json").read_text())["outputs"]


def test_a_recording_asked_for_without_rerun_is_an_error(tumble, tmp_path, without_rerun):
    done = rb_sim("run", tumble, "--out", tmp_path / "out", "--rerun", env=without_rerun)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = lines(done.stderr)
    assert line.startswith("error: ") and "pip install 'rb_sim[rerun]'" in line


def test_warm_leaves_nothing_to_compile(tumble):
    done = invoke("warm", tumble)
    assert done.exit_code == 0
    assert "[1/1] tumble ... from the cache" in done.stdout


def test_warm_names_the_option_that_is_wrong(tumble):
    done = invoke("warm", tumble, "--method", "rk9")
    assert done.exit_code == 2 and "error: --method: got 'rk9'; must be rk4" in done.output
