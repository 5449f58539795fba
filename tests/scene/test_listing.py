# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where shipped scenes are found, and what is said where one is not."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rb_sim.base.errors import SceneError
from rb_sim.scene import listing
from rb_sim.scene.listing import find_scene, list_scenes, scene_folders
from rb_sim.scene.load import load_scene

SCENE = "description: one\n  ball\nbodies: {a: {mass: 1, inertia: [1, 1, 1]}}\n"


def install(prefix: Path, *names: str) -> Path:
    """A config folder below an installation prefix, with scenes of these names."""
    folder = prefix / "share" / "rb_sim" / "config"
    folder.mkdir(parents=True)
    for name in names:
        (folder / f"{name}.yaml").write_text(SCENE, encoding="utf-8")
    return folder


@pytest.fixture(autouse=True)
def bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No prefix of this machine is looked at."""
    monkeypatch.setattr("sys.prefix", str(tmp_path / "no_prefix"))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def test_shipped_scenes_load() -> None:
    scenes = list_scenes()
    assert {"rolling_sphere", "heavy_top", "thrown_ball", "dropped_box", "colliding_spheres"} <= {
        scene.name for scene in scenes
    }
    for scene in scenes:
        loaded = load_scene(scene.path)
        assert (loaded.name, loaded.description) == (scene.name, scene.description)
        assert scene.description
        assert find_scene(scene.name) == scene.path


def test_source_checkout(tmp_path: Path) -> None:
    (tmp_path / "config").mkdir()
    assert list(scene_folders(tmp_path / "rb_sim")) == []
    (tmp_path / "package.xml").touch()
    assert list(scene_folders(tmp_path / "rb_sim")) == [tmp_path / "config"]


@pytest.mark.parametrize(
    "package",
    [
        "lib/python3.11/site-packages/rb_sim",
        "local/lib/python3.12/dist-packages/rb_sim",
        "rb_sim",
    ],
)
def test_prefix_above_the_installed_package(tmp_path: Path, package: str) -> None:
    folder = install(tmp_path / "prefix", "a")
    assert list(scene_folders(tmp_path / "prefix" / package)) == [folder]


def test_linked_package_finds_its_source(tmp_path: Path) -> None:
    """Colcon --symlink-install puts a link to the source package into the build folder."""
    source = tmp_path / "source" / "rb_sim"
    source.mkdir(parents=True)
    (tmp_path / "source" / "config").mkdir()
    (tmp_path / "source" / "package.xml").touch()
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "rb_sim").symlink_to(source)
    assert list(scene_folders(tmp_path / "build" / "rb_sim")) == [tmp_path / "source" / "config"]


def test_sys_prefix_then_ament_prefixes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = [install(tmp_path / name, "a") for name in ("venv", "overlay", "underlay")]
    monkeypatch.setattr("sys.prefix", str(tmp_path / "venv"))
    prefixes = ("missing", "overlay", "underlay")
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(str(tmp_path / p) for p in prefixes))
    assert list(scene_folders(tmp_path / "elsewhere" / "rb_sim")) == folders


def test_list_of_a_folder(tmp_path: Path) -> None:
    folder = install(tmp_path, "b", "a")
    (folder / "broken.yaml").write_text("bodies: [", encoding="utf-8")
    (folder / "node.params.yaml").write_text("/**: {ros__parameters: {}}", encoding="utf-8")
    (folder / "notes.txt").touch()
    (folder / "statics.yaml").mkdir()
    listed = list_scenes(folder)
    assert [scene.name for scene in listed] == ["a", "b", "broken"]
    assert listed[0] == ("a", folder / "a.yaml", "one ball")
    assert listed[2].description.startswith("(is not YAML: line ")


def test_folder_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="is not a folder of scenes"):
        list_scenes(tmp_path / "none")


def test_nothing_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "scene_folders", lambda: iter(()))
    assert list_scenes() == []
    with pytest.raises(SceneError, match="does not exist"):
        find_scene("pendulum")


def test_a_file_goes_before_a_shipped_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text(SCENE, encoding="utf-8")
    assert find_scene("own.yaml") == Path("own.yaml")
    (tmp_path / "pendulum").mkdir()
    assert find_scene("pendulum").name == "pendulum.yaml"


@pytest.mark.parametrize(
    ("name", "what", "hint"),
    [
        ("pendulm", "does not exist", "pendulum"),
        ("scenes/heavy_top.yaml", "does not exist", "heavy_top"),
        ("a\0b", "does not exist", ""),
    ],
)
def test_an_unknown_scene_names_the_nearest_shipped_one(name: str, what: str, hint: str) -> None:
    with pytest.raises(SceneError) as caught:
        find_scene(name)
    text = str(caught.value)
    assert what in text
    assert text.endswith(f"; did you mean {hint}?") if hint else "did you mean" not in text
    assert len(text.splitlines()) == 1


def test_a_folder_is_no_scene(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="is a folder; a scene must be a YAML file"):
        find_scene(tmp_path)
