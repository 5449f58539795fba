"""Arguments and options of the verbs, each described once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Scene = Annotated[
    str, typer.Argument(metavar="SCENE", help="A YAML file, or a name that `rb_sim scenes` lists.")
]
SceneOrBag = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="A YAML file, a name of `rb_sim scenes`, or a bag: the scene in it.",
    ),
]
Bag = Annotated[
    Path, typer.Argument(metavar="BAG", help="A folder or .mcap file recorded by rb_sim.")
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for the results, made if need be."),
]
Duration = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Simulated time instead of the scene's.")
]
Rate = Annotated[float | None, typer.Option(metavar="HZ", help="Samples per simulated second.")]
Method = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="euler, rk4, dopri853, gauss6, radau5, taylor, time_stepping (contacts) or auto.",
    ),
]
Step = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Fixed step; not with --tolerance.")
]
Tolerance = Annotated[
    float | None,
    typer.Option(metavar="NUMBER", help="Of the adaptive step; for auto the global error."),
]
NoBag = Annotated[bool, typer.Option("--no-bag", help="Write no DIR/bag.")]
Rerun = Annotated[
    bool | None,
    typer.Option(
        "--rerun/--no-rerun",
        help="DIR/recording.rrd: insist on it, or leave it out.",
        show_default="if rerun-sdk is installed",
    ),
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace the run that is in DIR already.")
]
NoPlots = Annotated[bool, typer.Option("--no-plots", help="Write no DIR/plots.png.")]
Npz = Annotated[
    Path | None,
    typer.Option("--npz", metavar="FILE.npz", help="All samples as numpy arrays; kept in memory."),
]
Accelerations = Annotated[
    bool,
    typer.Option(
        "--accelerations",
        help="Of the bodies, linear and angular: into the bag (BODY/accel), plots and .npz.",
    ),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.")
]
WallStamps = Annotated[
    bool,
    typer.Option(
        "--wall-stamps",
        help="Log times in the bag are those of the wall, not simulated time.",
    ),
]
SplitSize = Annotated[
    int | None, typer.Option(metavar="BYTES", help="Begin another file of the bag at this size.")
]
SplitDuration = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Likewise, after this simulated time.")
]
Strict = Annotated[
    bool, typer.Option("--strict", help="Exit code 3 if a watch sees accuracy lost.")
]
Certify = Annotated[
    bool,
    typer.Option(
        "--certify",
        help="Bound the errors of pose, twist and reactions by runs of other methods.",
    ),
]
Check = Annotated[
    bool | None,
    typer.Option(
        "--check/--no-check",
        help="State the global error by a second run at half of the steps or a tenth of the "
        "tolerance; by default of runs up to about 20 s.",
    ),
]
MaxWall = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="End a run that takes longer than this by the clock on the wall, exit code 1.",
    ),
]
Change = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Of the scene, as bodies.top.mass=2; may be repeated."
    ),
]
At = Annotated[
    float, typer.Option("--at", metavar="SECONDS", help="Instant of the motion to linearise about.")
]
Axes = Annotated[
    str, typer.Option(metavar="NAME", help="Of the states: world, or body (they turn with it).")
]
Turning = Annotated[
    float,
    typer.Option(metavar="RAD/S", help="The world's axes turn about z at this rate."),
]
