# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Arguments and options: those that several verbs share, and all of the larger verbs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer


def _key_value(changes: list[str] | None) -> list[str]:
    for change in changes or ():
        if "=" not in change:
            example = "must be KEY=VALUE, e.g. bodies.top.mass=2"
            raise typer.BadParameter(f"got {change!r}; {example}", param_hint="--set")
    return list(changes or ())  # not None: old typer asks its length


Scene = Annotated[
    str, typer.Argument(metavar="SCENE", help="Scene: a YAML file, or a name from `rb_sim scenes`.")
]
AnyScene = Annotated[
    str,
    typer.Argument(
        metavar="SCENE", help="Scene: a YAML file, or a name from `rb_sim scenes [--statics]`."
    ),
]
Bag = Annotated[
    Path,
    typer.Argument(
        metavar="BAG",
        help="Bag recorded by rb_sim: a folder (also that of a run) or an .mcap file.",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="DIR", help="Folder for the results; created if it does not exist."
    ),
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
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace a run that DIR already contains.")
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
AnyBag = Annotated[
    Path,
    typer.Argument(
        metavar="BAG", help="Bag: a folder (also that of a run), an .mcap or a .db3 file."
    ),
]
Wrench = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[BODY=]TOPIC",
        help="Topic of an applied wrench in a bag not recorded by rb_sim, or none; repeatable: "
        "they add up.",
        show_default="by frame and name",
    ),
]
"""As `recorded_by_others` takes them."""
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


@dataclass(frozen=True)
class RunOptions:
    """Arguments of `rb_sim run`. None: the scene's own value, or the default."""

    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="Scene: a YAML file, a name from `rb_sim scenes`, or a bag that contains one.",
        ),
    ]
    out: Out = None
    overwrite: Overwrite = False
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Simulated time; default: the scene's.")
    ] = None
    rate: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Samples per simulated second; default: the scene's."),
    ] = None
    method: Method = None
    step: Step = None
    tolerance: Tolerance = None
    no_bag: Annotated[bool, typer.Option("--no-bag", help="Do not write DIR/bag.")] = False
    rerun: Annotated[
        bool | None,
        typer.Option(
            "--rerun/--no-rerun",
            help="Write DIR/recording.rrd (Rerun), or do not.",
            show_default="if rerun-sdk is installed",
        ),
    ] = None
    no_plots: Annotated[bool, typer.Option("--no-plots", help="Do not write DIR/plots.png.")] = (
        False
    )
    npz: Annotated[
        Path | None,
        typer.Option(
            "--npz",
            metavar="FILE.npz",
            help="Write all samples as numpy arrays; they are kept in memory until the end.",
        ),
    ] = None
    accelerations: Annotated[
        bool,
        typer.Option(
            "--accelerations",
            help="Record accelerations of the bodies: bag (BODY/accel), plots, .npz.",
        ),
    ] = False
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print warnings and errors only.")
    ] = False
    wall_stamps: Annotated[
        bool,
        typer.Option(
            "--wall-stamps",
            help="Use wall-clock time for the log times in the bag instead of simulated time.",
        ),
    ] = False
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 3 if an accuracy check fails.")
    ] = False
    certify: Annotated[
        bool,
        typer.Option(
            "--certify",
            help="Bound the errors of pose, twist and reactions with runs of other methods.",
        ),
    ] = False
    check: Annotated[
        bool | None,
        typer.Option(
            "--check/--no-check",
            help="Measure the global error with a second run at 0.62 of the step or a tenth of the "
            "tolerance; default: for runs up to about 20 s of CPU time.",
        ),
    ] = None
    max_wall: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Stop the run after this wall-clock time, with exit code 1.",
        ),
    ] = None
    change: Change = None
    split_size: Annotated[
        int | None, typer.Option(metavar="BYTES", help="Start a new bag file at this size.")
    ] = None
    split_duration: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Start a new bag file after this simulated time."),
    ] = None


@dataclass(frozen=True)
class AnalyzeOptions:
    """Arguments of `rb_sim analyze`."""

    bag: AnyBag
    out: Out = None
    topic: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Analyse this topic only; repeatable.")
    ] = None
    masses: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Scene or URDF with the masses, for a bag not recorded by rb_sim; a scene also "
            "gives effects and constraints.",
        ),
    ] = None
    parquet: Annotated[bool, typer.Option("--parquet", help="Also write DIR/samples.parquet.")] = (
        False
    )
    as_json: Json = False


@dataclass(frozen=True)
class ResimOptions:
    """Arguments of `rb_sim resim`; scene, change, method, step and tolerance change the run."""

    bag: Bag
    out: Out = None
    scene: Annotated[
        str | None,
        typer.Option(metavar="SCENE", help="Simulate this scene instead of the recorded one."),
    ] = None
    change: Change = None
    method: Method = None
    step: Step = None
    tolerance: Tolerance = None
    overwrite: Overwrite = False
    as_json: Json = False

    @property
    def what_if(self) -> bool:
        """True if the run shall differ from the recorded one."""
        return bool(self.scene or self.change or self.method or self.step or self.tolerance)


BOUNDED = ("position", "angle", "velocity", "spin", "force", "torque")
"""Quantities whose difference may be bounded."""


@dataclass(frozen=True)
class CompareOptions:
    """Arguments of `rb_sim compare`."""

    a: AnyBag
    b: Annotated[
        str, typer.Argument(metavar="OTHER", help="Bag, scene or CSV file to compare with.")
    ]
    out: Out = None
    align: Annotated[
        str | None,
        typer.Option(
            metavar="none|first|offset|clock",
            help="Clock of OTHER: none: as recorded; first: equal first stamps; offset: estimated "
            "from the motions; clock: offset and drift (at most 1e-4) estimated.",
            show_default="none; offset if the times do not overlap",
        ),
    ] = None
    match: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NAME", help="Body of BAG and its name in OTHER; repeatable."),
    ] = None
    wrench: Wrench = None
    max_position: Annotated[
        float | None,
        typer.Option(metavar="M", help="Exit 1 if positions differ by more."),
    ] = None
    max_angle: Annotated[
        float | None, typer.Option(metavar="RAD", help="Exit 1 if attitudes differ by more.")
    ] = None
    max_velocity: Annotated[
        float | None, typer.Option(metavar="M/S", help="Exit 1 if velocities differ by more.")
    ] = None
    max_spin: Annotated[
        float | None,
        typer.Option(metavar="RAD/S", help="Exit 1 if angular velocities differ by more."),
    ] = None
    max_force: Annotated[
        float | None, typer.Option(metavar="N", help="Exit 1 if reaction forces differ by more.")
    ] = None
    max_torque: Annotated[
        float | None, typer.Option(metavar="NM", help="Exit 1 if reaction torques differ by more.")
    ] = None
    screenshot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Save a picture of both motions.")
    ] = None
    as_json: Json = False

    @property
    def bounds(self) -> dict[str, float]:
        """Largest allowed difference by quantity."""
        given = {name: getattr(self, f"max_{name}") for name in BOUNDED}
        return {name: value for name, value in given.items() if value is not None}


@dataclass(frozen=True)
class FitOptions:
    """Arguments of `rb_sim fit`."""

    bag: AnyBag
    free: Annotated[
        list[str],
        typer.Option(
            metavar="KEY,KEY",
            help="Parameters to fit, e.g. bodies.top.mass,effects.air.coefficient; repeatable.",
        ),
    ]
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE", help="Scene to fit; default: the one in the bag.")
    ] = None
    out: Out = None
    match: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=BODY", help="Pose in the bag and its body of the scene; repeatable."
        ),
    ] = None
    wrench: Wrench = None
    noise: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="M RAD",
            help="Standard deviation of positions and attitudes; default: estimated.",
        ),
    ] = None
    as_json: Json = False
