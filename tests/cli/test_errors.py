# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bad input: one line on standard error, nothing else, exit code 2."""

from __future__ import annotations

import re
from typing import get_type_hints

import numpy as np
import pytest
from rich.text import Text

from rb_sim import SceneWarning, __version__
from rb_sim.cli.main import app
from rb_sim.scene.listing import find_scene
from rb_sim.scene.schema import METHODS
from tests.cli.process import invoke, lines

BAD_SCENES = {
    "unknown_key": ("bodies: {a: {mass: 1, inertia: [1, 1, 1], colour: red}}", "bodies.a.colour"),
    "off_the_constraint": (
        "bodies: {a: {mass: 1, inertia: [1, 1, 1], linear_velocity: [1, 0, 0]}}\n"
        "constraints: {pin: {type: fixed_point, body: a}}",
        "constraints.pin",
    ),
}


@pytest.mark.parametrize("name", BAD_SCENES)
def test_bad_scene(name, tmp_path):
    text, expected = BAD_SCENES[name]
    path = tmp_path / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    done = invoke("run", path, "--out", tmp_path / "out")
    assert done.exit_code == 2
    (line,) = lines(done.output)
    assert line.startswith(f"error: {path}: ") and expected in line
    assert not (tmp_path / "out" / "bag").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("run", "nowhere"), "error: nowhere: does not exist; a scene must be a YAML file or"),
        (("run", "heavy_top", "--duration", "-1"), "error: --duration: got -1.0; must be"),
        (("run", "heavy_top", "--rate", "nan"), "error: --rate: got nan; must be"),
        (("run", "heavy_top", "--method", "leapfrog"), "error: --method: got 'leapfrog'; must be"),
        (("run", "heavy_top", "--step", "1", "--tolerance", "1"), "error: --step: got 1.0"),
        (("run", "heavy_top", "--npz", "a.txt"), "error: --npz a.txt: the name must end in .npz"),
        (
            ("run", "heavy_top", "--npz", "/dev/null/a.npz"),
            "error: --npz /dev/null/a.npz: cannot make its folder",
        ),
        (("run",), "error: Missing argument"),
        (("run", "heavy_top", "--fast"), "error: No such option"),
        (("run", "heavy_top", "--rate", "quick"), "error: --rate: got 'quick'; must be a number;"),
        (("run", "heavy_top", "--out", ""), "error: --out: is empty; must have a value; see"),
        (("run", "heavy_top", "--npz="), "error: --npz: is empty; must have a value; see rb_"),
        (("info", ""), "error: an argument: is empty; must have a value; see rb_sim"),
        (("sweep", "coin", "--workers", "2.5"), "error: --workers: got '2.5'; must be a whole"),
        (("run", "heavy_top", "pendulum"), "error: Got unexpected extra argument"),
        (
            ("run", "heavy_top", "--duration"),
            "error: Option '--duration' requires an argument; see rb_sim run --help",
        ),
        (
            ("fit", "b", "--noise", "1"),
            "error: Option '--noise' requires 2 arguments; see rb_sim fit",
        ),
        (
            ("--duration", "3", "run", "heavy_top"),
            "error: --duration: must stand after the command (run); see rb_sim --help",
        ),
        *(
            (
                (verb, "pendulum", "--set", "bodies.rod.mass=-1"),
                "error: --set bodies.rod.mass: got -1; must be a number",
            )
            for verb in ("run", "statics", "explain", "linearize", "accuracy")
        ),
        (
            ("statics", "pendulum", "--set", "a"),
            "error: --set: got 'a'; must be KEY=VALUE, e.g.",
        ),
        (
            ("fit", "bag", "--free", "bodies.a.mass", "bodies.a.inertia"),
            "error: Got unexpected extra argument (bodies.a.inertia); --free takes one value: ",
        ),
        (
            ("run", "a.yaml", "b.yaml"),
            "error: Got unexpected extra argument (b.yaml); see rb_sim run --help",
        ),
        (
            ("linearize", "pendulum", "--axes", "wrld"),
            "error: --axes: got 'wrld'; must be world or",
        ),
        (
            ("compare", "pendulum", "a.csv"),
            "error: BAG: got pendulum, a scene; must be a bag, record one first: rb_sim run pendul",
        ),
        (("fly",), "error: No such command 'fly'"),
        (
            ("rum", "heavy_top"),
            "error: No such command 'rum' (did you mean run?); see rb_sim --help",
        ),
        (
            ("run", "heavy_top", "--tolerence", "1"),
            "error: No such option: --tolerence (did you mean --tolerance?); see",
        ),
        (
            ("run", "heavy_top", "--method", "RK4"),
            "error: --method: got 'RK4'; must be rk4, or one of",
        ),
        (
            ("run", "bouncing_ball", "--method", "taylor"),
            f"error: {find_scene('bouncing_ball')}: simulation.method: got 'taylor'; must be "
            "dopri853 or auto here, since",
        ),
        (
            ("accuracy", "heavy_top", "--target", "0"),
            "error: --target: got 0.0; must be a number > 0",
        ),
        (("hard-cases", "nothing"), "error: nothing: is no folder; FOLDER must hold cases"),
        (("--fast",), "error: No such option"),
        (
            ("scenes", "heavy_top"),
            "error: heavy_top: is not a folder of scenes; for one scene: rb_sim",
        ),
        (("statics", "nowhere"), "error: nowhere: does not exist; a scene must be"),
        (("warm", "nowhere"), "error: nowhere: does not exist"),
        (("heavy_top",), "error: No such command 'heavy_top' (heavy_top is a scene: rb_sim run"),
        (("replay", "/no"), "error: /no: does not exist; must be a bag or the folder"),
        (("recover", "/no"), "error: /no: does not exist; must be a bag or the folder"),
        (
            ("compare", "pendulum", "/bag"),
            "error: BAG: got pendulum, a scene; must be a bag, OTHER",
        ),
        (("compare", "pendulum.yaml", "/bag"), "error: BAG: got pendulum.yaml, a scene; must be a"),
        (("compare", "poses.csv", "/bag"), "error: BAG: got poses.csv, a file of poses; must be a"),
        (("node", "nowhere"), "error: nowhere: does not exist"),
        (("accuracy", "nowhere"), "error: nowhere: does not exist"),
        (("explain", "nowhere"), "error: nowhere: does not exist"),
    ],
)
def test_one_line(arguments, expected):
    done = invoke(*arguments)
    assert done.exit_code == 2
    assert done.output.startswith(expected)
    assert len(lines(done.output)) == 1


def test_every_method_is_in_the_help():
    shown = " ".join(invoke("run", "--help").output.replace("│", " ").split())
    for name in METHODS:
        assert re.search(rf"\b{name}\b", shown), name


def test_help_is_not_eaten_by_markup():
    """Square brackets in a help text are styles to rich, which drops them."""
    for verb in app.registered_commands:
        assert verb.callback is not None
        for hint in get_type_hints(verb.callback, include_extras=True).values():
            for note in getattr(hint, "__metadata__", ()):
                text = getattr(note, "help", None) or ""
                assert Text.from_markup(text).plain == text


def test_an_edge_is_sent_to_statics():
    """Once it moves, what lies on an edge has no plane to slide on."""
    said = invoke("run", "rod_over_wall").output
    assert "supports.edge_C.normal_B" in said and "rb_sim statics" in said


def test_the_npz_gets_its_folder_and_a_bag_runs_again(tmp_path, tumble):
    """The scene in a bag, with the options that it was recorded with, tells the same motion."""
    first, again = tmp_path / "new" / "a.npz", tmp_path / "b.npz"
    out = tmp_path / "out"
    options = ("--out", out, "--duration", "0.5", "--no-rerun")
    assert invoke("run", tumble, "--npz", first, *options).exit_code == 0
    assert invoke("run", out / "bag", "--npz", again).exit_code == 0
    with np.load(first) as a, np.load(again) as b:
        assert a["t"][-1] == 0.5
        for column in a.files:
            np.testing.assert_array_equal(a[column], b[column])


def test_output_folder_that_cannot_be_made(tmp_path, tumble):
    (tmp_path / "file").write_text("")
    done = invoke("run", tumble, "--out", tmp_path / "file")
    assert done.exit_code == 2
    allowed = "must be one, or a name for a new one"
    assert done.output == f"error: --out {tmp_path / 'file'}: is not a folder; {allowed}\n"


def test_version_and_verbs():
    assert invoke("--version").output == f"rb_sim {__version__}\n"
    shown = invoke("--help").output
    for verb in "run scenes warm replay recover node statics accuracy explain".split():
        assert f" {verb} " in shown
        assert invoke(verb, "--help").exit_code == 0


def test_scenes_are_listed_with_one_line_each(tmp_path):
    listed = lines(invoke("scenes").output)
    assert any(line.startswith("heavy_top ") and "Bruls" in line for line in listed)
    assert any(
        line.startswith("rod_over_wall ") for line in lines(invoke("scenes", "--statics").output)
    )
    (tmp_path / "mine.yaml").write_text("bodies: {a: {mass: 1}}\ndescription: my own")
    assert invoke("scenes", tmp_path).output == "mine  my own\n"


def test_help_shows_flags_as_flags(monkeypatch):
    """Newer versions of typer write <bool> behind them, as if `--quiet true` were meant."""
    monkeypatch.setenv("COLUMNS", "120")
    for verb in ([], ["run"], ["replay"], ["analyze"]):
        shown = invoke(*verb, "--help").output.lower()
        assert "--help" in shown
        assert "bool" not in shown


def test_a_wrong_value_is_blamed_on_whoever_gave_it(tmp_path):
    """On --set for its keys, and what is in them; on the file for the others."""
    path = tmp_path / "a.yaml"
    path.write_text("bodies: {a: {mass: -1, inertia: [1, 1, 1]}}\n", encoding="utf-8")
    done = invoke("linearize", path, "--set", "bodies.a.position=[0, up, 0]")
    assert {line[: line.index(": got")] for line in lines(done.output)} == {
        f"error: {path}: bodies.a.mass",
        "error: --set bodies.a.position[1]",
    }


def test_advice_that_warnings_share_is_given_once():
    done = invoke("run", "heavy_top", "--method", "rk4", "--step", "0.005")
    warned = [line for line in lines(done.output) if line.startswith("warning: ")]
    assert len(warned) > 3 and warned[-1].endswith("; use step 0.001 s, which passes all checks")
    assert not any("; " in line for line in warned[:-1])


def test_a_changed_scene_warns_once(tmp_path, recwarn):
    """That of the scene as it is run; not another one of the file, which the change cures."""
    path = tmp_path / "wheel.yaml"
    path.write_text(
        'bodies: {"w.1": {mass: 1, inertia: [1, 1, 1], orientation: [1, 0, 0, 0]}}\n'
        "effects: {g: {type: gravity}}\nsimulation: {duration: 0.1}\n",
        encoding="utf-8",
    )
    change = 'bodies["w.1"].orientation=[0, 0, 0, 1]'
    assert invoke("run", path, "--quiet", "--set", change).exit_code == 0
    said = [str(warned.message) for warned in recwarn if warned.category is SceneWarning]
    assert len(said) == 1 and "w.1 -> w_1" in said[0]
