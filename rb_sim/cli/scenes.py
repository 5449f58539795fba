"""`rb_sim scenes`: what comes with the package, one line each."""

from __future__ import annotations

from pathlib import Path

from rb_sim.errors import RbSimError


def scenes(folder: Path | None = None) -> int:
    """List the shipped scenes, or those of a folder. Raises RbSimError if there are none."""
    from rb_sim.scene.listing import list_scenes

    listed = list_scenes(folder)
    if not listed:
        where = "the installation has no scenes" if folder is None else f"{folder}: no scene in it"
        raise RbSimError(f"{where}; a scene is a YAML file with bodies")
    width = max(len(scene.name) for scene in listed)
    for scene in listed:
        print(f"{scene.name:{width}}  {scene.description}".rstrip())
    return 0
