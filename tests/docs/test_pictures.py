# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pictures of README and the documentation: each is made by `make docs`, and shows what the program
draws today. Those of the tutorials are compared by their curves (test_pages.py)."""

from __future__ import annotations

import json
import re
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageChops
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene, scenes
from rb_sim.accuracy.accuracy_tables import save_picture
from tests.docs.blocks import PAGES
from tests.docs.page_run import pictures
from tools import gallery, law_pictures, readme_picture
from tools.colors import few_colors
from tools.pictures import DOCS, MADE, measured, report_page, same, words_of, words_on
from tools.tutorials import narrow

COSTS = DOCS / "tutorials" / "pictures" / "accuracy" / "costs" / "accuracy.png"
OF_TUTORIALS = {
    page.parent / "pictures" / page.stem / name
    for page in PAGES
    if page.parent.name == "tutorials"
    for name in pictures(page)
}


def test_each_picture_is_made_and_each_that_is_made_is_shown():
    shown = {
        (page.parent / name).resolve()
        for page in PAGES
        if "vendor" not in page.parts
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    }
    made = {DOCS / path for path in MADE} | OF_TUTORIALS
    assert shown == made
    kept = {
        path
        for path in DOCS.rglob("*")
        if path.suffix in (".png", ".jpg", ".gif", ".svg") and "vendor" not in path.parts
    }
    assert kept == made


CHEAP = [
    path
    for path in MADE
    if path.startswith("laws/") or path.startswith("pictures/scene_") and path.endswith(".png")
] + ["pictures/hard-cases.png", "pictures/bags_compare.png", "pictures/sweep_rotor_imbalance.png"]


@pytest.mark.parametrize("path", CHEAP)
def test_a_picture_shows_what_the_program_draws(path, tmp_path, request):
    """Of those that take a few seconds; `make docs` makes the others."""
    with pytest.MonkeyPatch.context() as patch:
        if "sweep" in path:
            module = import_module("rb_sim.sweeps.sweep")
            scheduler, client = request.getfixturevalue("here"), module.client
            patch.setattr(module, "client", lambda *_: client(None, scheduler))
        MADE[path](tmp_path)
    assert same(tmp_path / Path(path).name, DOCS / path), f"run python -m tools.pictures {path}"


MEASURED = [DOCS / "pictures" / "accuracy_heavy_top.png", COSTS]


@pytest.mark.parametrize("kept", MEASURED, ids=lambda path: path.name)
def test_a_picture_of_measured_times_is_that_of_the_data_in_it(kept, tmp_path):
    drawn = tmp_path / "full.png"
    save_picture(measured(kept), drawn)
    if kept == COSTS:
        narrow(drawn).save(drawn, compress_level=1)
    assert same(drawn, kept), "run python -m tools.pictures, tools.tutorials"


def test_measured_errors_are_those_of_today():
    """Times differ from run to run, errors do not: those of one setting of each kind of step."""
    scene = partial(load_scene, "heavy_top", duration=2.0)
    exact = Simulation(scene(tolerance=1e-13)).run(check=False)
    ladders = {ladder.name: ladder.rungs for ladder in measured(MEASURED[0]).ladders}
    for name in ("dopri853 adaptive", "rk4"):
        rung = next(rung for rung in ladders[name] if rung.errors.pose < 1e-3)
        given = {"step": rung.setting.step, "tolerance": rung.setting.tolerance}
        given = {key: value for key, value in given.items() if value is not None}
        run = Simulation(scene(method=rung.setting.name, **given)).run(check=False)
        turned = Rotation.from_quat(exact.orientation["top"]).inv()
        turned *= Rotation.from_quat(run.orientation["top"])
        shifted = run.position["top"] - exact.position["top"]
        error = max(turned.magnitude().max(), np.linalg.norm(shifted, axis=1).max())
        assert error == pytest.approx(rung.errors.pose, rel=0.1)


def test_the_moving_picture_ends_as_the_program_moves(tmp_path, monkeypatch):
    """Of two frames, the first and the last."""
    monkeypatch.setattr(readme_picture, "FRAMES", 2)
    readme_picture.draw(tmp_path)
    assert same(tmp_path / "heavy_top.gif", DOCS / "pictures" / "heavy_top.gif")


OF_THE_VIEWER = ["gallery.jpg", *(f"scene_{name}.jpg" for name in gallery.OWN)]


@pytest.mark.parametrize("name", OF_THE_VIEWER)
def test_a_picture_of_the_viewer_shows_the_motion_of_today(name):
    """By the places of the bodies in it, which its comment holds."""
    with Image.open(DOCS / "pictures" / name) as image:
        kept = json.loads(image.info["comment"])
    if name == "gallery.jpg":
        assert set(kept) == {scene.name for scene in scenes()}
    today = json.loads(gallery.places(kept))
    for scene, shown in kept.items():
        assert today[scene]["until"] == pytest.approx(shown["until"])
        assert np.allclose(today[scene]["centres"], shown["centres"], atol=1e-3), scene


def test_the_picture_of_the_report_has_the_words_of_today(tmp_path):
    assert words_on(report_page(tmp_path)) == words_of(DOCS / "pictures" / "bags_report.png")


def test_few_colors_keep_those_of_thin_lines():
    drawn = law_pictures.picture("contact")
    kept = np.asarray(few_colors(drawn).convert("RGB"), dtype=int)
    apart = np.abs(kept - np.asarray(drawn, dtype=int)).max(axis=2)
    assert apart.max() < 40 and np.count_nonzero(apart > 24) < 10


def test_a_picture_of_another_program_is_told_apart(tmp_path):
    """By a curve that lies a few pixels elsewhere, and by its size; not by noise."""
    kept = DOCS / "laws/pictures/spring.png"
    with Image.open(kept) as image:
        shown = image.convert("RGB")
    for name, drawn in (
        ("same", shown.point(lambda value: min(255, value + 3))),
        ("moved", ImageChops.offset(shown, 6, 0)),
        ("larger", shown.resize((shown.width + 16, shown.height))),
    ):
        drawn.save(tmp_path / f"{name}.png")
        assert same(tmp_path / f"{name}.png", kept) == (name == "same"), name
