# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim accuracy SCENE [--out DIR] [--target 1e-6]`: error against CPU time of each method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rb_sim.accuracy.accuracy_tables import (
    as_dict,
    measure,
    print_report,
    print_statics,
    statics_as_dict,
)
from rb_sim.accuracy.ladder import climb
from rb_sim.base.errors import RbSimError
from rb_sim.base.plain_data import write_json
from rb_sim.cli.plain import plain_console, progress
from rb_sim.cli.verbs.scenes import with_changes
from rb_sim.scene.listing import find_scene
from rb_sim.scene.load import is_statics, load_scene, load_statics
from rb_sim.simulation.outputs import writing


def of_scene(
    scene: str, out: Path | None, target: float | None, budget: float, changes: Sequence[str]
) -> int:
    """`accuracy`, or `of_statics` for a statics scene."""
    path = find_scene(scene)
    if is_statics(path):
        return of_statics(path, out, target, changes)
    return accuracy(path, out, target, budget, changes)


def accuracy(
    scene: str | Path,
    out: Path | None = None,
    target: float | None = None,
    budget: float = 60.0,
    changes: Sequence[str] = (),
) -> int:
    """Run the scene with every method, coarse to fine; print the CPU time of each error.

    scene: YAML file. out: folder for accuracy.json and accuracy.png, created if absent. target:
    required global error [rad, m]. budget: wall-clock time of the runs [s]; compiling the methods
    for a new kind of scene adds to it once per machine.

    Returns the exit code 0. Raises RbSimError for a scene that cannot be simulated, a value that is
    not > 0, or a folder that cannot be written.
    """
    for name, value in (("target", target), ("budget", budget)):
        if value is not None and not value > 0.0:
            raise RbSimError(f"--{name}: got {value!r}; must be a number > 0")
    described = with_changes(scene, changes, load_scene)
    with progress() as show:
        result = climb(described, budget, target, show)
    console = plain_console()
    print_report(result, console, target)
    if out is not None:
        from rb_sim.accuracy.accuracy_tables import save_picture  # imports matplotlib, when used

        with writing(out):
            write_json(as_dict(result, target), out / "accuracy.json")
            save_picture(result, out / "accuracy.png", target)
        console.print(f"wrote {out / 'accuracy.json'} and {out / 'accuracy.png'}")
    return 0


def of_statics(
    scene: str | Path,
    out: Path | None = None,
    target: float | None = None,
    changes: Sequence[str] = (),
) -> int:
    """Solve a statics scene; print the accuracy of its reactions and their CPU time.

    out: folder for accuracy.json, created if absent. target: refused, as nothing moves.

    Returns the exit code 0. Raises RbSimError for a scene that cannot be read or a folder that
    cannot be written.
    """
    described = with_changes(scene, changes, load_statics)
    if target is not None:
        raise RbSimError(
            f"target: is a global error of the pose; the bodies of {scene} are at rest"
        )
    console = plain_console()
    result = measure(described)
    print_statics(result, console)
    if out is not None:
        path = out / "accuracy.json"
        with writing(out):
            write_json(statics_as_dict(result), path)
        console.print(f"wrote {path}")
    return 0
