# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A choice of `method: auto` is made once and read from disk after that."""

from __future__ import annotations

from pathlib import Path

import pytest

from rb_sim.accuracy import auto
from rb_sim.accuracy.auto import place_of, read, remembered_choice, write
from rb_sim.accuracy.choice import Choice
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping

NUT = {"mass": 1.0, "inertia": [1.0, 2.0, 3.0], "angular_velocity": [0.1, 2.0, 0.1]}
CHOICE = Choice("rk4", 0.01, None, 1e-3, 5e-4, 1e-6, True, "as a test has it")


def scene(tolerance: float = 1e-3, spin: float = 2.0):
    body = NUT | {"angular_velocity": [0.1, spin, 0.1]}
    options = {"method": "auto", "tolerance": tolerance, "duration": 1.0}
    return scene_from_mapping({"bodies": {"nut": body}, "simulation": options})


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    return tmp_path


def test_a_choice_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    searches = []
    monkeypatch.setattr(auto, "choose", lambda *_: searches.append(1) or CHOICE)
    for _ in range(3):
        assert remembered_choice(scene(), compile_scene(scene())) == CHOICE
    assert len(searches) == 1


def test_another_scene_or_target_is_another_choice() -> None:
    places = {
        place_of(other, compile_scene(other)) for other in (scene(), scene(1e-4), scene(spin=3.0))
    }
    assert len(places) == 3
    again = scene().model_copy(update={"description": "the same motion"})
    assert place_of(again, compile_scene(again)) in places


def test_what_cannot_be_read_is_made_again(folder: Path) -> None:
    path = folder / "choice.json"
    assert read(path) is None
    write(path, CHOICE)
    assert read(path) == CHOICE
    path.write_text(path.read_text()[:-5])
    assert read(path) is None


def test_the_sources_name_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    before = place_of(scene(), compile_scene(scene()))
    monkeypatch.setattr(auto.shipped, "digest", lambda: "of other sources")
    assert place_of(scene(), compile_scene(scene())) != before
