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
            metavar="SCENE",
            help="Scene: a YAML file, or a name from `rb_sim scenes [--statics]`.",
        ),
    ],
    out: opt.Out = None,
    target: Annotated[
        float | None,
        typer.Option(
            metavar="ERROR",
            help="Global error in m and rad; the cheapest setting within it is printed.",
        ),
    ] = None,
    budget: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="Wall-clock time of all runs, without compiling."),
    ] = 60.0,
) -> int:
    """Measure error against CPU time for each method on a scene.

    For a statics scene: the accuracy of its reactions.
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
        Path | None, typer.Argument(help="Folder with your own cases; default: the shipped ones.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Run only cases whose name contains this; repeatable."),
    ] = None,
    out: opt.Out = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Run only the cases that take a few seconds.")
    ] = False,
) -> int:
    """Run scenes that are hard to simulate and print the margin of each bound.

    With --out, DIR gets hard-cases.json, .md and .png. Exit code 1 if one fails.
    """
    from rb_sim.cli.verbs.hard_cases import hard_cases as run_cases

    return run_cases(folder, only or (), out, quick)


def sweep(
    plan: Annotated[
        str,
        typer.Argument(
            metavar="PLAN | report | list",
            help="Plan: a YAML file or the name of a shipped one; or `report DIR`; or `list`.",
        ),
    ],
    folder: Annotated[
        Path | None, typer.Argument(metavar="[DIR]", help="With `report`: folder of a sweep.")
    ] = None,
    out: opt.Out = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Number of processes; default: one per core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Address of a dask scheduler to use instead of local processes."
        ),
    ] = None,
    batch: Annotated[
        int | None,
        typer.Option(metavar="RUNS", help="Runs per task; default: about one second of work."),
    ] = None,
    lanes: Annotated[
        bool,
        typer.Option(
            "--lanes/--no-lanes", help="Compute several runs at once with vector instructions."
        ),
    ] = True,
) -> int:
    """Run a scene many times with varied parameters; runs that DIR already contains are kept."""
    from rb_sim.cli.verbs import sweep as verbs

    if plan == "list":
        return verbs.sweep_plans()
    if plan == "report":
        if folder is None:
            raise RbSimError("report: got no folder; must be the folder of a sweep (its --out)")
        return verbs.sweep_report(folder)
    if folder is not None:
        raise RbSimError(f"got {str(folder)!r}; give the folder of the results as --out {folder}")
    return verbs.sweep(plan, out, workers, scheduler, batch, lanes)


def register(verb: Callable[..., Any]) -> None:
    """Add the verbs, in the order of the help."""
    verb()(accuracy)
    verb(name="hard-cases")(hard_cases)
    verb()(sweep)
