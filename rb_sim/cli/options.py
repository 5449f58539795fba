# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Arguments and options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def _key_value(changes: list[str] | None) -> list[str] | None:
    for change in changes or ():
        if "=" not in change:
            example = "must be KEY=VALUE, e.g. bodies.top.mass=2"
            raise typer.BadParameter(f"got {change!r}; {example}", param_hint="--set")
    return changes


Scene = Annotated[
    str, typer.Argument(metavar="SCENE", help="Scene: a YAML file, or a name from `rb_sim scenes`.")
]
SceneOrBag = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="Scene: a YAML file, a name from `rb_sim scenes`, or a bag that contains one.",
    ),
]
Bag = Annotated[
    Path, typer.Argument(metavar="BAG", help="Bag recorded by rb_sim: a folder or an .mcap file.")
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="DIR", help="Folder for the results; created if it does not exist."
    ),
]
Duration = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Simulated time; default: the scene's.")
]
Rate = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Samples per simulated second; default: the scene's."),
]
Method = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Integration method: euler, rk4, dopri853, gauss6, radau5, taylor, time_stepping "
        "(contacts) or auto.",
    ),
]
Step = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Fixed step size; excludes --tolerance.")
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        metavar="NUMBER",
        help="Local error per adaptive step; with auto: global error, in m and rad.",
    ),
]
NoBag = Annotated[bool, typer.Option("--no-bag", help="Do not write DIR/bag.")]
Rerun = Annotated[
    bool | None,
    typer.Option(
        "--rerun/--no-rerun",
        help="Write DIR/recording.rrd (Rerun), or do not.",
        show_default="if rerun-sdk is installed",
    ),
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace a run that DIR already contains.")
]
NoPlots = Annotated[bool, typer.Option("--no-plots", help="Do not write DIR/plots.png.")]
Npz = Annotated[
    Path | None,
    typer.Option(
        "--npz",
        metavar="FILE.npz",
        help="Write all samples as numpy arrays; they are kept in memory until the end.",
    ),
]
Accelerations = Annotated[
    bool,
    typer.Option(
        "--accelerations",
        help="Record accelerations of the bodies: bag (BODY/accel), plots, .npz.",
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print warnings and errors only.")]
WallStamps = Annotated[
    bool,
    typer.Option(
        "--wall-stamps",
        help="Use wall-clock time for the log times in the bag instead of simulated time.",
    ),
]
SplitSize = Annotated[
    int | None, typer.Option(metavar="BYTES", help="Start a new bag file at this size.")
]
SplitDuration = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Start a new bag file after this simulated time."),
]
Strict = Annotated[bool, typer.Option("--strict", help="Exit code 3 if an accuracy check fails.")]
Certify = Annotated[
    bool,
    typer.Option(
        "--certify",
        help="Bound the errors of pose, twist and reactions with runs of other methods.",
    ),
]
Check = Annotated[
    bool | None,
    typer.Option(
        "--check/--no-check",
        help="Measure the global error with a second run at 0.62 of the step or a tenth of the "
        "tolerance; default: for runs up to about 20 s of CPU time.",
    ),
]
MaxWall = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Stop the run after this wall-clock time, with exit code 1.",
    ),
]
Change = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        callback=_key_value,
        help="Change a value of the scene, e.g. bodies.top.mass=2; repeatable.",
    ),
]
At = Annotated[
    float, typer.Option("--at", metavar="SECONDS", help="Time of the motion at which to linearise.")
]
Axes = Annotated[str, typer.Option(metavar="NAME", help="Axes of the states: world or body.")]
Turning = Annotated[
    float,
    typer.Option(metavar="RAD/S", help="Rate at which the world axes turn about z."),
]
