"""`rb_sim scenes`: what comes with the package, one line each."""

from __future__ import annotations

from pathlib import Path

from rb_sim.errors import RbSimError

STATICS = "statics"
"""Folder of the scenes of bodies at rest, among the shipped ones."""


def scenes(folder: Path | None = None, statics: bool = False) -> int:
    """List the shipped scenes, or those of a folder. Raises RbSimError if there are none.

    statics: list the shipped scenes for `rb_sim statics`.
    """
    from rb_sim.scene.listing import list_scenes

    listed = list_scenes(statics_folder() if statics and folder is None else folder)
    if not listed:
        where = "the installation has no scenes" if folder is None else f"{folder}: no scene in it"
        raise RbSimError(f"{where}; a scene is a YAML file with bodies")
    width = max(len(scene.name) for scene in listed)
    for scene in listed:
        print(f"{scene.name:{width}}  {scene.description}".rstrip())
    return 0


def statics_folder() -> Path | None:
    """Where the shipped scenes of bodies at rest are; None if they were not installed."""
    from rb_sim.scene.listing import scene_folders

    return next((f / STATICS for f in scene_folders() if (f / STATICS).is_dir()), None)


def find_statics(name_or_path: str) -> Path:
    """Path of a statics scene given by its file or by its bare name."""
    path, shipped = Path(name_or_path), shipped_statics()
    if path.exists() or not shipped or path.name != name_or_path:
        return path
    if name_or_path in shipped:
        return shipped[name_or_path]
    names = ", ".join(shipped)
    raise RbSimError(
        f"{name_or_path}: does not exist; statics scenes that come with rb_sim: {names}"
    )


def find_moving_or_at_rest(name_or_path: str) -> tuple[Path, bool]:
    """(path, True for a statics scene) of a file of either kind or a bare shipped name.

    Raises SceneError for a file that is no YAML, and one that lists the shipped scenes of motion.
    """
    from rb_sim.scene.listing import find_scene
    from rb_sim.statics.load import is_statics

    shipped = shipped_statics()
    if name_or_path in shipped and not Path(name_or_path).exists():
        return shipped[name_or_path], True
    path = find_scene(name_or_path)
    return path, is_statics(path)


def shipped_statics() -> dict[str, Path]:
    """The shipped scenes of bodies at rest, by name."""
    folder = statics_folder()
    return {} if folder is None else {file.stem: file for file in sorted(folder.glob("*.yaml"))}
