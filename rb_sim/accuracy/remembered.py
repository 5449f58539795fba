"""Choices of `method: auto` kept on disk by the scene's hash: the search is made once."""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields
from pathlib import Path
from typing import Any

from rb_sim.accuracy.auto import choose
from rb_sim.accuracy.choice import Choice
from rb_sim.compiler import shipped
from rb_sim.graph import store
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.schema import Scene

FOLDER = "auto"


def remembered_choice(scene: Scene, compiled: Compiled) -> Choice:
    """The choice for this scene, from disk if it was made before with these sources."""
    path = place_of(scene, compiled)
    known = read(path)
    if known is not None:
        return known
    choice = choose(compiled, scene.simulation)
    write(path, choice)
    return choice


def place_of(scene: Scene, compiled: Compiled) -> Path | None:
    """The file of the choice: named after what the motion depends on, in a folder named after the
    sources; None where nothing can be kept."""
    text = scene.model_dump_json(exclude={"description"}, warnings=False)
    digest = hashlib.sha256(f"{compiled.reduced} {text}".encode())
    folder = store.version_folder(FOLDER, shipped.digest())
    return None if folder is None else folder / f"{digest.hexdigest()[:32]}.json"


def read(path: Path | None) -> Choice | None:
    """The choice in the file; None if there is none, or none that can be read."""
    if path is None:
        return None
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        known: dict[str, Any] = {field.name: values[field.name] for field in fields(Choice)}
        known["errors"] = tuple(known["errors"])
        return Choice(**known)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def write(path: Path | None, choice: Choice) -> None:
    """Keep the choice; where the folder cannot be written it is made again next time."""
    if path is None:
        return
    part = path.with_name(f"{path.name}.{id(choice)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(json.dumps(choice.as_dict()), encoding="utf-8")
        part.replace(path)  # another process may write the same
    except OSError:
        return
