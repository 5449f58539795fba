"""Statics files -> StaticsScene; whatever is wrong comes out as one SceneError of one line."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from rb_sim.scene import yaml_reader
from rb_sim.scene.errors_text import render, scene_error, validated
from rb_sim.scene.listing import scene_folders
from rb_sim.statics.model import StaticsScene

STATICS = "statics"
"""Folder of the scenes of bodies at rest, among the shipped ones."""


def load_statics(source: str | PathLike[str] | Mapping[str, Any]) -> StaticsScene:
    """Statics scene of a YAML file, of a bare name of a shipped one, or of a mapping.

    Raises SceneError with file, key, value and what is allowed.
    """
    if isinstance(source, Mapping):
        return validated(StaticsScene, source, "<scene>")
    path = Path(source)
    if path.name == str(source) and not path.suffix and not path.exists():
        shipped = (folder / STATICS / f"{path}.yaml" for folder in scene_folders())
        path = next((file for file in shipped if file.is_file()), path)
    data = read(path)
    if not isinstance(data, Mapping):
        message = f"got {render(data)}; a statics scene must be a mapping with bodies"
        raise scene_error(message, (), str(path))
    return validated(StaticsScene, data, str(path)).named(path.stem)


def is_statics(path: Path) -> bool:
    """Whether a file is of bodies at rest: it says what holds or loads them.

    Raises SceneError if it is no YAML file.
    """
    data = read(path)
    return isinstance(data, Mapping) and ("supports" in data or "loads" in data)


def read(path: Path) -> Any:
    """What a YAML file says."""
    return yaml_reader.parse(yaml_reader.read_text(path), str(path))
