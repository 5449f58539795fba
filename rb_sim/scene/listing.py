# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""List of the scenes shipped with rb_sim: in a checkout, a pip or a colcon installation."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from rb_sim.base.errors import SceneError
from rb_sim.base.names import meant
from rb_sim.scene import yaml_reader
from rb_sim.scene.yaml_reader import scene_error

SHARE = Path("share", "rb_sim", "config")
"""Folder in which setup.py installs the scenes, relative to the prefix."""

STATICS = "statics"
"""Folder of the scenes of bodies at rest, within the folder of shipped scenes."""


class ListedScene(NamedTuple):
    """One row of `rb_sim scenes`."""

    name: str
    path: Path
    description: str
    """description in the scene file, or the error of a file that cannot be read."""


def scene_folders(package: Path | None = None) -> Iterator[Path]:
    """Existing folders of shipped scenes; first the one of the imported package.

    package: folder of the imported rb_sim (tests give another).
    """
    package = package or Path(__file__).absolute().parents[1]
    candidates: list[Path] = []
    for folder in dict.fromkeys((package, package.resolve())):
        if (folder.parent / "package.xml").is_file():
            candidates.append(folder.parent / "config")
        candidates += [above / SHARE for above in folder.parents]
    candidates.append(Path(sys.prefix) / SHARE)
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    candidates += [Path(prefix) / SHARE for prefix in prefixes if prefix]
    return (folder for folder in dict.fromkeys(candidates) if folder.is_dir())


def list_scenes(directory: str | PathLike[str] | None = None) -> list[ListedScene]:
    """List scenes with name, path and description, sorted by name.

    A file that cannot be read is listed with its error as description; files without bodies
    (parameters of a node) are not listed.

    Args:
        directory: Folder with scene files (*.yaml); None: the scenes that come with rb_sim.

    Raises:
        SceneError: `directory` is not a folder.
    """
    if directory is None:
        folder = next(scene_folders(), None)
        return [] if folder is None else list_scenes(folder)
    folder = Path(directory)
    if not folder.is_dir():
        raise scene_error(
            "is not a folder of scenes; for one scene: rb_sim scenes NAME --show", (), str(folder)
        )
    files = sorted(path for path in folder.glob("*.yaml") if path.is_file())
    listed = ((path, _description(path)) for path in files)
    return [ListedScene(path.stem, path, text) for path, text in listed if text is not None]


def statics_folder() -> Path | None:
    """Folder of the shipped scenes of bodies at rest; None if they are not installed."""
    return next((f / STATICS for f in scene_folders() if (f / STATICS).is_dir()), None)


def shipped_statics() -> dict[str, Path]:
    """The shipped scenes of bodies at rest, by name."""
    folder = statics_folder()
    return {} if folder is None else {file.stem: file for file in sorted(folder.glob("*.yaml"))}


def find_scene(name_or_path: str | PathLike[str], others: str = "") -> Path:
    """Path of a scene given by its file, or by the name of a shipped scene.

    others: allowed arguments that are no scenes, for the error. Raises SceneError with the shipped
    scene that was probably meant.
    """
    path = Path(name_or_path)
    if path.is_file():
        return path
    own = _shipped(str(name_or_path))
    if own is not None:
        return own
    what = "is a folder" if path.is_dir() else "does not exist"
    near = meant(path.stem, [scene.name for scene in list_scenes()])
    hint = f"; did you mean {near}?" if near else ""
    scene = "a YAML file or a name that `rb_sim scenes` lists"
    must = f"must be {others} or a scene ({scene})" if others else f"a scene must be {scene}"
    raise scene_error(f"{what}; {must}{hint}", (), str(name_or_path))


def _shipped(name: str) -> Path | None:
    """The shipped scene of this name, in motion or at rest; no other file is read for it."""
    folder = next(scene_folders(), None)
    if folder is not None and Path(name).name == name:
        path = folder / f"{name}.yaml"
        if path.is_file() and _description(path) is not None:
            return path
    return shipped_statics().get(name)


def _description(path: Path) -> str | None:
    """The scene's description, or its error; None for a YAML file without bodies (not a scene)."""
    try:
        data: Any = yaml_reader.parse(yaml_reader.read_text(path), str(path))
    except SceneError as error:
        return f"({error.message})"
    if not isinstance(data, dict) or "bodies" not in data:
        return None
    text = data.get("description")
    return " ".join(text.split()) if isinstance(text, str) else ""
