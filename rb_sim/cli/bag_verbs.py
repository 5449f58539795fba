"""The verbs that read bags: their arguments, and which file does the work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from rb_sim.cli import options as opt

AnyBag = Annotated[Path, typer.Argument(metavar="BAG", help="A folder, an .mcap or a .db3 file.")]
Wrench = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[BODY=]TOPIC",
        help="Bags of others: wrench that was commanded (several add up), or none.",
        show_default="by frame and name",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def replay(
    bag: AnyBag,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE.rrd", help="Save the recording; no viewer.")
    ] = None,
    screenshot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Save a picture; no viewer.")
    ] = None,
    video: Annotated[
        Path | None, typer.Option(metavar="FILE.mp4", help="Save a film of the motion (ffmpeg).")
    ] = None,
    publish: Annotated[
        bool, typer.Option("--publish", help="Play its topics over DDS, with /clock; no viewer.")
    ] = False,
    rate: Annotated[
        float | None,
        typer.Option(metavar="X", help="--publish: times real time (1); 0: no pacing."),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="--publish: again and again.")] = False,
    start: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="--publish: from this time of the run.")
    ] = None,
) -> int:
    """Show a recorded bag in the Rerun viewer, as a picture or film, or play its topics."""
    from rb_sim.cli.verbs.replay import PlayOptions, play
    from rb_sim.cli.verbs.replay import replay as show

    options = PlayOptions(rate, loop, start)
    if publish:
        return play(bag, options, alone=save is screenshot is video is None)
    options.refuse()
    show(bag, save, screenshot, video)
    return 0


def show(
    source: Annotated[
        str,
        typer.Argument(
            metavar="OUT|BAG|SCENE",
            help="The folder of a run, a bag (of others, too), or a scene, which is simulated.",
        ),
    ],
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html", help="The page.", show_default="OUT/show.html, else NAME.html"
        ),
    ] = None,
    browse: Annotated[bool, typer.Option("--open", help="Open it in the web browser.")] = False,
) -> None:
    """Write one HTML page that shows a run in 3D with a time slider, forces and plots.

    The page is one file under 3 MB that works without a network and without rb_sim.
    """
    from rb_sim.cli.verbs.replay import show as write_page

    write_page(source, save, browse=browse)


def info(bag: AnyBag, json: Json = False) -> int:
    """What is in a bag: scene, settings, versions, topics, rates, gaps, damage."""
    from rb_sim.cli.verbs.info import info as tell

    return tell(bag, json)


def resim(
    bag: opt.Bag,
    out: opt.Out = None,
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE", help="What if it had been this scene.")
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="What if, as bodies.top.mass=2."),
    ] = None,
    method: opt.Method = None,
    step: opt.Step = None,
    tolerance: opt.Tolerance = None,
    overwrite: opt.Overwrite = False,
    json: Json = False,
) -> int:
    """Simulate a recorded run again: the same to the last bit, or what if."""
    from rb_sim.cli.verbs.resim import ResimOptions
    from rb_sim.cli.verbs.resim import resim as again

    changes = tuple(change or ())
    return again(ResimOptions(bag, out, scene, changes, method, step, tolerance, json, overwrite))


def compare(
    a: AnyBag,
    b: Annotated[str, typer.Argument(metavar="OTHER", help="A bag, a scene or a CSV file.")],
    out: opt.Out = None,
    align: Annotated[
        str | None,
        typer.Option(
            metavar="none|first|offset|clock",
            help="Clock of OTHER: as recorded; first stamps together; offset estimated from the"
            " motions; offset and drift (at most 1e-4) estimated.",
            show_default="none; offset if the times do not overlap",
        ),
    ] = None,
    match: Annotated[
        list[str] | None, typer.Option(metavar="NAME=NAME", help="Which body is which.")
    ] = None,
    wrench: Wrench = None,
    max_position: Annotated[float | None, typer.Option(metavar="M", help="Else exit 1.")] = None,
    max_angle: Annotated[float | None, typer.Option(metavar="RAD", help="Likewise.")] = None,
    max_velocity: Annotated[float | None, typer.Option(metavar="M/S", help="Likewise.")] = None,
    max_spin: Annotated[float | None, typer.Option(metavar="RAD/S", help="Likewise.")] = None,
    max_force: Annotated[float | None, typer.Option(metavar="N", help="Of reactions.")] = None,
    max_torque: Annotated[float | None, typer.Option(metavar="NM", help="Likewise.")] = None,
    screenshot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Save a picture of both motions.")
    ] = None,
    json: Json = False,
) -> int:
    """Lay a recorded motion beside another one: how far apart, since when, how fast."""
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
        list[str] | None, typer.Option(metavar="NAME", help="Only this one; may be repeated.")
    ] = None,
    masses: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Of bags of others: scene, for balances and constraints, too, or .urdf.",
        ),
    ] = None,
    parquet: Annotated[
        bool, typer.Option("--parquet", help="Write DIR/samples.parquet as well.")
    ] = False,
    json: Json = False,
) -> int:
    """Rates, gaps, energy, momenta, wrenches, spectra of any bag with poses; a report."""
    from rb_sim.cli.verbs.analyze import AnalyzeOptions
    from rb_sim.cli.verbs.analyze import analyze as read

    topics = tuple(topic or ())
    return read(AnalyzeOptions(bag, out, topics, masses, parquet, json))


def fit(
    bag: AnyBag,
    free: Annotated[
        str, typer.Option(metavar="KEY,KEY", help="As bodies.top.mass,effects.air.coefficient.")
    ],
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE", help="Instead of the scene in the bag.")
    ] = None,
    out: opt.Out = None,
    match: Annotated[
        list[str] | None, typer.Option(metavar="BODY=NAME", help="Which pose is of which body.")
    ] = None,
    wrench: Wrench = None,
    noise: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="M RAD", help="Of positions and attitudes; else it is estimated."),
    ] = None,
    json: Json = False,
) -> int:
    """Find the numbers of a scene that make it follow a recorded motion."""
    from rb_sim.cli.verbs.fit import FitOptions
    from rb_sim.cli.verbs.fit import fit as solve

    pairs, acting = tuple(match or ()), tuple(wrench or ())
    return solve(FitOptions(bag, free, scene, out, pairs, acting, noise, json))


def register(verb: Callable[..., Any]) -> None:
    """Make each of them a verb of the program."""
    for function in (replay, show, info, analyze, resim, compare, fit):
        verb()(function)
