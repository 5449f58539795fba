# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim scenes`, `warm` and `layout`: list scenes, compile them in advance, write layouts."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rb_sim.base.errors import RbSimError, SceneError

if TYPE_CHECKING:
    import typer

    from rb_sim.scene.schema import Scene

Loaded = TypeVar("Loaded", bound="Scene")


# `rb_sim warm`: compile in advance, so that a first run starts as fast as a second one.


def warm(scene: Sequence[str] | None = None, method: str | None = None) -> int:
    """Compile the given scenes (files or names), or all shipped ones if there are none, into the
    cache.

    method: replaces the scenes' own. A scene that cannot be loaded is reported, the others are
    compiled; the exit code is 2 then. Raises RbSimError if a given scene does not exist.
    """
    from rb_sim.scene.listing import find_scene, list_scenes
    from rb_sim.scene.load import load_scene
    from rb_sim.simulation.simulation import compiled

    paths = [find_scene(name) for name in scene or ()] or [scene.path for scene in list_scenes()]
    if not paths:
        raise RbSimError("the installation has no scenes; name one: rb_sim warm SCENE")
    failed = False
    for i, path in enumerate(paths, start=1):
        notes: list[str] = []
        began = time.perf_counter()
        place = f"[{i}/{len(paths)}] {path.stem}"
        print(f"{place} ...", end="", flush=True)
        try:
            compiled(load_scene(path, method=method), notes.append)
        except RbSimError as error:
            failed = True
            print(flush=True)
            line = of_option(error) if isinstance(error, SceneError) else error
            print(f"error: {line}", file=sys.stderr, flush=True)
            continue
        took = time.perf_counter() - began
        print(f" {'compiled' if notes else 'from the cache'}, {took:.1f} s", flush=True)
        for note in notes[1:]:
            print(note, file=sys.stderr, flush=True)
    return 2 if failed else 0


# `rb_sim layout`: layouts of other programs for the topics of a scene.


def layout(scene: str, out: Path | None = None) -> int:
    """Write layouts of a scene for Foxglove, RViz and PlotJuggler into `out` or the current folder.

    Raises SceneError; RbSimError for a folder that cannot be written.
    """
    from rb_sim.io.layouts import foxglove, plotjuggler, rviz, shown
    from rb_sim.scene.compile import compile_scene
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene
    from rb_sim.simulation.outputs import writing

    loaded = load_scene(find_scene(scene))
    topics = shown(loaded, compile_scene(loaded).layout)
    folder = Path() if out is None else out
    texts = {
        f"{loaded.name}.foxglove.json": foxglove(topics),
        f"{loaded.name}.rviz": rviz(topics),
        f"{loaded.name}.plotjuggler.xml": plotjuggler(topics),
    }
    with writing(folder):
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
            print(f"wrote {folder / file}")
    for line in topics.left_out:
        print(f"note: {line}", file=sys.stderr, flush=True)
    return 0


def node(context: typer.Context, scene: str) -> int:
    """Run the node with the arguments that follow the scene; returns its status."""
    from rb_sim.ros.main import main as run_node
    from rb_sim.scene.listing import find_scene

    return run_node([str(find_scene(scene)), *context.args])


def scenes(folder: Path | None = None, show: bool = False, statics: bool = False) -> int:
    """Print the shipped scenes, or those of a folder. Raises RbSimError if there are none.

    show: print the YAML of the scene `folder` instead. statics: the shipped scenes for `rb_sim
    statics`.
    """
    from rb_sim.scene.listing import find_scene, list_scenes, statics_folder

    if show:
        if folder is None:
            raise RbSimError("--show: got no scene; must be the NAME of a scene")
        text = find_scene(str(folder)).read_text(encoding="utf-8")
        print(text, end="" if text.endswith("\n") else "\n")
        return 0
    listed = list_scenes(statics_folder() if statics and folder is None else folder)
    if not listed:
        where = "the installation has no scenes" if folder is None else f"{folder}: no scene in it"
        raise RbSimError(f"{where}; a scene is a YAML file with bodies")
    width = max(len(scene.name) for scene in listed)
    for scene in listed:
        print(f"{scene.name:{width}}  {scene.description}".rstrip())
    return 0


def with_changes(
    name_or_path: str | Path,
    changes: Sequence[str],
    load: Callable[..., Loaded],
    **overrides: Any,
) -> Loaded:
    """The scene of a file or of a shipped name with KEY=VALUE in place of its values.

    load: load_scene, which takes `overrides` as well, or load_statics.
    Raises SceneError, and RbSimError for what is no KEY=VALUE.
    """
    from rb_sim.io.bag.reader import with_values
    from rb_sim.scene import yaml_reader
    from rb_sim.scene.listing import find_scene

    path = find_scene(str(name_or_path))
    if not changes:
        return load(path, **overrides)
    data = with_values(yaml_reader.parse(yaml_reader.read_text(path), str(path)), changes)
    with SceneError.after(changes):
        return load(data, name=path.stem, file=str(path), **overrides)


def of_option(error: SceneError) -> RbSimError:
    """The error of a scene, or of the option that replaces a value of it."""
    section, _, name = error.key.partition(".")
    return RbSimError(f"--{name}: {error.message}") if section == "override" else error


def scene_to_run(name_or_path: str, overrides: Mapping[str, Any]) -> Scene:
    """The scene of a file, of a shipped name, or in a bag recorded by rb_sim.

    A bag's scene runs as recorded (method, step, duration) unless an entry of `overrides` that is
    not None replaces a value; recorded commands are not applied.

    Raises SceneError, with the key override.NAME for an invalid override; SinkError.
    """
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene, scene_from_mapping

    path = Path(name_or_path)
    if not (path.suffix in (".mcap", ".db3") or _holds_bag(path)):
        return load_scene(find_scene(name_or_path), **overrides)
    from rb_sim.io.bag.reader import BagReader

    recorded = BagReader(path).scene
    try:
        own = vars(recorded.simulation)
        scene = scene_from_mapping(recorded.text, name=recorded.name, file=str(path))
        as_recorded = {name: own[name] for name in ("duration", "rate", "method")}
        as_recorded |= {name: own[name] for name in ("step", "tolerance") if own.get(name)}
        given = {name: value for name, value in overrides.items() if value is not None}
        if {"step", "tolerance", "method"} & set(given):
            as_recorded = {k: as_recorded[k] for k in as_recorded if k not in ("step", "tolerance")}
        return scene_from_mapping(
            scene.text, name=scene.name, file=str(path), **(as_recorded | given)
        )
    except KeyError as missing:
        raise RbSimError(f"{path}: its record of the simulation lacks {missing}") from None


def _holds_bag(path: Path) -> bool:
    if not path.is_dir():  # the library of bags need not be loaded then
        return False
    from rb_sim.io.bag.folder import holds_bag

    return holds_bag(path)
