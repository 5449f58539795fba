# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim statics SCENE [--out DIR]`: static reactions, or why there is no equilibrium."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rb_sim.base.plain_data import write_json
from rb_sim.cli.plain import plain_console
from rb_sim.cli.verbs.scenes import with_changes
from rb_sim.equilibrium.statics import solve
from rb_sim.equilibrium.statics_tables import as_dict, print_report
from rb_sim.scene.load import load_statics
from rb_sim.simulation.outputs import writing


def statics(scene: str | Path, out: Path | None = None, changes: Sequence[str] = ()) -> int:
    """Solve a scene at its initial pose and print the reactions.

    With `out` also write statics.json and statics.png. changes: KEY=VALUE of the scene.

    Returns the exit code: 0 if the bodies can stay at rest, else 1.
    Raises RbSimError for a scene that cannot be read or a folder that cannot be written.
    """
    description = with_changes(scene, changes, load_statics)
    result = solve(description)
    console = plain_console()
    print_report(description, result, console)
    if out is not None:
        from rb_sim.equilibrium.statics_picture import save_picture  # imports matplotlib, when used

        with writing(out):
            write_json(as_dict(description, result), out / "statics.json")
            save_picture(description, result, out / "statics.png")
        console.print(f"wrote {out / 'statics.json'} and {out / 'statics.png'}")
    return 1 if result.verdict == "no equilibrium" else 0
