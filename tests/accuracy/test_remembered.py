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
from typing import Any

import pytest

from rb_sim.accuracy import auto
from rb_sim.accuracy.auto import remembered_choice
from rb_sim.accuracy.choice import Choice
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.schema import Scene

NUT = {"mass": 1.0, "inertia": [1.0, 2.0, 3.0], "angular_velocity": [0.1, 2.0, 0.1]}
CHOICE = Choice("rk4", 0.01, None, 1e-3, 5e-4, 1e-6, True, "as a test has it")


def scene(tolerance: float = 1e-3, spin: float = 2.0) -> Scene:
    body = NUT | {"angular_velocity": [0.1, spin, 0.1]}
    options = {"method": "auto", "tolerance": tolerance, "duration": 1.0}
    return scene_from_mapping({"bodies": {"nut": body}, "simulation": options})


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    return tmp_path


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Targets of the searches that are made."""
    made: list[float] = []

    def choose(_: Any, options: Any) -> Choice:
        made.append(options.tolerance)
        return CHOICE

    monkeypatch.setattr(auto, "choose", choose)
    return made


def choice_of(of: Scene) -> Choice:
    return remembered_choice(of, compile_scene(of))


def test_a_choice_is_searched_once(searches: list[float]) -> None:
    for _ in range(3):
        assert choice_of(scene()) == CHOICE
    choice_of(scene().model_copy(update={"description": "the same motion"}))
    assert len(searches) == 1


def test_another_scene_or_target_is_another_choice(searches: list[float]) -> None:
    for other in (scene(), scene(1e-4), scene(spin=3.0)):
        choice_of(other)
    assert searches == [1e-3, 1e-4, 1e-3]


def test_what_cannot_be_read_is_made_again(folder: Path, searches: list[float]) -> None:
    choice_of(scene())
    (file,) = folder.glob("auto-*/*")
    file.write_bytes(file.read_bytes()[:-5])
    assert choice_of(scene()) == CHOICE and len(searches) == 2
    assert choice_of(scene()) == CHOICE and len(searches) == 2


def test_a_choice_of_other_sources_is_none(
    monkeypatch: pytest.MonkeyPatch, searches: list[float]
) -> None:
    choice_of(scene())
    monkeypatch.setattr(auto.shipped, "digest", lambda: "of other sources")
    choice_of(scene())
    assert len(searches) == 2
