"""The verbs that run a scene, or many, more than once: accuracy, hard cases, sweeps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from rb_sim.base.errors import RbSimError
from rb_sim.cli import options as opt


def accuracy(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE", help="A YAML file, or a name of `rb_sim scenes [--statics]`."
        ),
    ],
    out: opt.Out = None,
    target: Annotated[
        float | None,
        typer.Option(
            metavar="ERROR", help="Global error in m and rad: name the cheapest way to it."
        ),
    ] = None,
    budget: Annotated[
        float, typer.Option(metavar="SECONDS", help="Wall time of the runs, compiling aside.")
    ] = 60.0,
) -> int:
    """What accuracy costs on a scene: error against time, by method.

    Of bodies at rest: how exact their reactions are.
    """
    from rb_sim.cli.verbs.accuracy import accuracy as of_motion
    from rb_sim.cli.verbs.accuracy import of_statics
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import is_statics

    path = find_scene(scene)
    if is_statics(path):
        return of_statics(path, out, target)
    return of_motion(path, out, target, budget)


def hard_cases(
    folder: Annotated[
        Path | None, typer.Argument(help="Of cases of your own, instead of the shipped ones.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Cases with this in their name; may come again."),
    ] = None,
    out: opt.Out = None,
    quick: Annotated[bool, typer.Option("--quick", help="Only those of a few seconds.")] = False,
) -> int:
    """Run scenes that are hard to simulate, and say what holds, by what margin.

    With --out, DIR gets hard-cases.json, .md and .png. Exit code 1 if one fails.
    """
    from rb_sim.cli.verbs.hard_cases import hard_cases as run_cases

    return run_cases(folder, only or (), out, quick)


def sweep(
    plan: Annotated[
        str,
        typer.Argument(
            metavar="PLAN | report | list",
            help="A YAML file or the name of a shipped plan; `report DIR`; `list`.",
        ),
    ],
    folder: Annotated[
        Path | None, typer.Argument(metavar="[DIR]", help="Of a sweep, for `report`.")
    ] = None,
    out: opt.Out = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Processes on this machine; one a core if none.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a dask scheduler, instead of workers.")
    ] = None,
    batch: Annotated[
        int | None, typer.Option(metavar="RUNS", help="Per task; about a second's worth if none.")
    ] = None,
    lanes: Annotated[
        bool, typer.Option("--lanes/--no-lanes", help="Let runs share the vectors of the machine.")
    ] = True,
) -> int:
    """Run a scene many times with varied numbers; what DIR holds already is not run again."""
    from rb_sim.cli.verbs import sweep as verbs

    if plan == "list":
        return verbs.sweep_plans()
    if plan == "report":
        if folder is None:
            raise RbSimError("report: got no folder; must be the --out of a sweep")
        return verbs.sweep_report(folder)
    if folder is not None:
        raise RbSimError(f"got {str(folder)!r}; give the folder of the results as --out {folder}")
    return verbs.sweep(plan, out, workers, scheduler, batch, lanes)


def register(verb: Callable[..., Any]) -> None:
    """Add the verbs, in the order of the help."""
    verb()(accuracy)
    verb(name="hard-cases")(hard_cases)
    verb()(sweep)
