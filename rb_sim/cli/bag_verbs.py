"""The verbs that read bags: their arguments, and which file does the work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from rb_sim.cli import options as opt

AnyBag = Annotated[
    Path, typer.Argument(metavar="BAG", help="Bag: a folder, an .mcap or a .db3 file.")
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
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def replay(
    bag: AnyBag,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.rrd", help="Save a Rerun recording instead of opening the viewer."
        ),
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Save a picture instead of opening the viewer."),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mp4", help="Save a film of the motion (needs ffmpeg)."),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(
            metavar="SCENE",
            help="Scene whose bodies the joint states of a bag not recorded by rb_sim place.",
        ),
    ] = None,
    publish: Annotated[
        bool,
        typer.Option(
            "--publish",
            help="Publish its topics over DDS, with /clock, instead of opening the viewer.",
        ),
    ] = False,
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            help="With --publish: speed relative to real time; 0: as fast as possible. Default: 1.",
        ),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="With --publish: repeat for ever.")] = False,
    start: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="With --publish: start at this time of the run."),
    ] = None,
) -> int:
    """Show a bag in the Rerun viewer, save a picture or a film of it, or publish its topics."""
    from rb_sim.cli.verbs.replay import PlayOptions, play
    from rb_sim.cli.verbs.replay import replay as show

    options = PlayOptions(rate, loop, start)
    if publish:
        return play(bag, options, alone=save is screenshot is video is scene is None)
    options.refuse()
    show(bag, save, screenshot, video, scene)
    return 0


def show(
    source: Annotated[
        str,
        typer.Argument(
            metavar="OUT|BAG|SCENE",
            help="Folder of a run, a bag (also of another program), or a scene (simulated first).",
        ),
    ],
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html", help="The page.", show_default="OUT/show.html, else NAME.html"
        ),
    ] = None,
    browse: Annotated[
        bool, typer.Option("--open", help="Open the page in the web browser.")
    ] = False,
) -> None:
    """Write one HTML page that shows a run in 3D with a time slider, forces and plots.

    The page is one file under 3 MB that works without a network and without rb_sim.
    """
    from rb_sim.cli.verbs.replay import show as write_page

    write_page(source, save, browse=browse)


def info(bag: AnyBag, json: Json = False) -> int:
    """List the contents of a bag: scene, settings, versions, topics, rates, gaps, damage."""
    from rb_sim.cli.verbs.info import info as tell

    return tell(bag, json)


def resim(
    bag: opt.Bag,
    out: opt.Out = None,
    scene: Annotated[
        str | None,
        typer.Option(metavar="SCENE", help="Simulate this scene instead of the recorded one."),
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change a value of the scene, e.g. bodies.top.mass=2; repeatable.",
        ),
    ] = None,
    method: opt.Method = None,
    step: opt.Step = None,
    tolerance: opt.Tolerance = None,
    overwrite: opt.Overwrite = False,
    json: Json = False,
) -> int:
    """Simulate a recorded run again: bit for bit the same, or with changes."""
    from rb_sim.cli.verbs.resim import ResimOptions
    from rb_sim.cli.verbs.resim import resim as again

    changes = tuple(change or ())
    return again(ResimOptions(bag, out, scene, changes, method, step, tolerance, json, overwrite))


def compare(
    a: AnyBag,
    b: Annotated[
        str, typer.Argument(metavar="OTHER", help="Bag, scene or CSV file to compare with.")
    ],
    out: opt.Out = None,
    align: Annotated[
        str | None,
        typer.Option(
            metavar="none|first|offset|clock",
            help="Clock of OTHER: none: as recorded; first: equal first stamps; offset: estimated "
            "from the motions; clock: offset and drift (at most 1e-4) estimated.",
            show_default="none; offset if the times do not overlap",
        ),
    ] = None,
    match: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NAME", help="Body of BAG and its name in OTHER; repeatable."),
    ] = None,
    wrench: Wrench = None,
    max_position: Annotated[
        float | None,
        typer.Option(metavar="M", help="Exit 1 if positions differ by more."),
    ] = None,
    max_angle: Annotated[
        float | None, typer.Option(metavar="RAD", help="Exit 1 if attitudes differ by more.")
    ] = None,
    max_velocity: Annotated[
        float | None, typer.Option(metavar="M/S", help="Exit 1 if velocities differ by more.")
    ] = None,
    max_spin: Annotated[
        float | None,
        typer.Option(metavar="RAD/S", help="Exit 1 if angular velocities differ by more."),
    ] = None,
    max_force: Annotated[
        float | None, typer.Option(metavar="N", help="Exit 1 if reaction forces differ by more.")
    ] = None,
    max_torque: Annotated[
        float | None, typer.Option(metavar="NM", help="Exit 1 if reaction torques differ by more.")
    ] = None,
    screenshot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Save a picture of both motions.")
    ] = None,
    json: Json = False,
) -> int:
    """Compare two motions: largest differences, when they begin, how fast they grow."""
    from rb_sim.cli.verbs.compare import CompareOptions
    from rb_sim.cli.verbs.compare import compare as beside

    given = {"position": max_position, "angle": max_angle, "velocity": max_velocity,
             "spin": max_spin, "force": max_force, "torque": max_torque}  # fmt: skip
    bounds = {name: value for name, value in given.items() if value is not None}
    pairs = tuple(match or ())
    acting = tuple(wrench or ())
    return beside(CompareOptions(a, b, out, json, align, pairs, acting, bounds, screenshot))


def analyze(
    bag: AnyBag,
    out: opt.Out = None,
    topic: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Analyse this topic only; repeatable.")
    ] = None,
    masses: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Scene or URDF with the masses, for a bag not recorded by rb_sim; a scene also "
            "gives effects and constraints.",
        ),
    ] = None,
    parquet: Annotated[
        bool, typer.Option("--parquet", help="Also write DIR/samples.parquet.")
    ] = False,
    json: Json = False,
) -> int:
    """Report rates, gaps, energy, momenta, wrenches and spectra of any bag with poses."""
    from rb_sim.cli.verbs.analyze import AnalyzeOptions
    from rb_sim.cli.verbs.analyze import analyze as read

    topics = tuple(topic or ())
    return read(AnalyzeOptions(bag, out, topics, masses, parquet, json))


def fit(
    bag: AnyBag,
    free: Annotated[
        str,
        typer.Option(
            metavar="KEY,KEY",
            help="Parameters to fit, e.g. bodies.top.mass,effects.air.coefficient.",
        ),
    ],
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE", help="Scene to fit; default: the one in the bag.")
    ] = None,
    out: opt.Out = None,
    match: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=BODY", help="Pose in the bag and its body of the scene; repeatable."
        ),
    ] = None,
    wrench: Wrench = None,
    noise: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="M RAD",
            help="Standard deviation of positions and attitudes; default: estimated.",
        ),
    ] = None,
    json: Json = False,
) -> int:
    """Fit parameters of a scene to a recorded motion."""
    from rb_sim.cli.verbs.fit import FitOptions
    from rb_sim.cli.verbs.fit import fit as solve

    pairs, acting = tuple(match or ()), tuple(wrench or ())
    return solve(FitOptions(bag, free, scene, out, pairs, acting, noise, json))


def register(verb: Callable[..., Any]) -> None:
    """Make each of them a verb of the program."""
    for function in (replay, show, info, analyze, resim, compare, fit):
        verb()(function)
