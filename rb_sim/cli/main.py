# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Entry point of the command line: parses arguments, calls a verb, and turns errors into one line
and an exit code."""

from __future__ import annotations

import functools
import inspect
import os
import re
import sys
import warnings
from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from rb_sim.base import __version__
from rb_sim.base.errors import RbSimError, SceneWarning, SimulationError
from rb_sim.base.names import meant
from rb_sim.cli import options as opt
from rb_sim.cli.plain import Unread
from rb_sim.simulation.signals import EARLY, TerminatedError, terminable

# Usage errors are printed in one line, as all other errors: the problem, and which --help to read.
#
# Help shows a flag without a type: newer versions of typer print one, as if the flag took a value.


INTERRUPTED = 130
"""Exit code after SIGINT."""


class PlainFlags(TyperCommand):
    """A verb that refuses empty arguments, and whose help shows no type behind a flag."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As the base class; an error knows whose --help to name also without its value."""
        try:
            if not ctx.ignore_unknown_options:
                _refuse_empty(args)
            return super().parse_args(ctx, args)
        except Exception as error:
            if hasattr(error, "format_message") and getattr(error, "ctx", None) is None:
                error.ctx = ctx  # type: ignore[attr-defined]
            raise

    def get_params(self, ctx: Any) -> list[Any]:
        """The arguments and options, including --help."""
        return _without_types(super().get_params(ctx))


class OneLineErrors(TyperGroup):
    """Group of all verbs; a usage error is printed in one line instead of a box."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The options of the program itself, including --help."""
        return _without_types(super().get_params(ctx))

    def main(self, *arguments: Any, standalone_mode: bool = True, **keywords: Any) -> Any:
        """Parse the arguments, call the verb and leave through sys.exit, as the base class does."""
        if not standalone_mode:
            return super().main(*arguments, standalone_mode=False, **keywords)
        try:
            code = super().main(*arguments, standalone_mode=False, **keywords)
        except Exception as error:
            if isinstance(error.__cause__, KeyboardInterrupt):  # older versions of typer
                print("interrupted", file=sys.stderr, flush=True)
                sys.exit(INTERRUPTED)
            # recognised by attributes, not by class: older versions of typer raise click's own
            # classes, newer ones a copy of them
            if not (hasattr(error, "format_message") and hasattr(error, "exit_code")):
                raise
            code = _complain(error)
        sys.exit(code if isinstance(code, int) else 0)


def _refuse_empty(args: list[str]) -> None:
    """Refuse an empty word: as a path it would be the current folder. Raises typer.BadParameter."""
    for before, word in zip(["", *args], args, strict=False):
        if not word or re.fullmatch(r"--[\w-]+=", word):
            option = before if before.startswith("-") and before != "--" else "an argument"
            raise typer.BadParameter(
                "is empty; must have a value", param_hint=word.rstrip("=") or option
            )


def _without_types(params: list[Any]) -> list[Any]:
    """The same options, with an empty metavar for flags."""
    for param in params:
        if getattr(param, "is_flag", False):
            param.metavar = ""
    return params


NEAREST = re.compile(r"(?:\.? Did you mean| \(Possible options:) *'?([\w-]+)'?[?)]$")
"""The suggested name at the end of a message of click, in the forms of its versions."""

NO_COMMAND = re.compile(r"No such command '(.*)'")


def _complain(error: Any) -> int:
    """Print the error; returns its exit code."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":  # `rb_sim` alone: its message is the help
        error.show()
        return int(error.exit_code)
    message = _bad_value(error) or " ".join(str(error.format_message()).split()).rstrip(".")
    message = re.sub(r"^Invalid value for '?(.+?)'?: ", r"\1: ", message)
    message = NEAREST.sub(r" (did you mean \1?)", message).replace("argument(s)", "argument")
    if message.startswith("No such option") and context is not None:
        message = f"No such option: {error.option_name}{_nearest_option(error, context)}"
    if takers := _verbs_with(getattr(error, "option_name", None), context):
        message = f"{error.option_name}: must stand after the command ({', '.join(takers)})"
    if message.startswith("Got unexpected extra argument") and context is not None:
        given = [p for p in context.command.params if getattr(p, "multiple", False)]
        message += "".join(
            f"; {p.opts[0]} takes one value: repeat it" for p in given if context.params.get(p.name)
        )
    verb = NO_COMMAND.fullmatch(message)
    if verb is not None and context is not None:  # older versions of typer suggest none
        near = get_close_matches(verb[1], context.command.list_commands(context), n=1)
        message += f" (did you mean {near[0]}?)" if near else _scene_to_run(verb[1])
    program = "rb_sim" if context is None else context.command_path
    print(f"error: {message}; see {program} --help", file=sys.stderr, flush=True)
    return int(error.exit_code)


def _nearest_option(error: Any, context: Any) -> str:
    """The option that was probably meant, by the names that scenes suggest keys with."""
    options = [opt for param in context.command.params for opt in param.opts if opt[:2] == "--"]
    near = meant(error.option_name.lstrip("-").replace("-", "_"), [o[2:] for o in options])
    return f" (did you mean --{near}?)" if near else ""


def _scene_to_run(word: str) -> str:
    """A hint for a scene in the place of a command; "" for another word."""
    from rb_sim.scene.listing import find_scene

    try:
        find_scene(word)
    except RbSimError:
        return ""
    return f" ({word} is a scene: rb_sim run {word})"


MOST_VERBS = 3
"""That one line lists."""


def _verbs_with(option: str | None, context: Any) -> list[str]:
    """Commands that take an option that was given before any of them; few."""
    verbs = getattr(getattr(context, "command", None), "commands", {})
    names = [
        name for name, verb in verbs.items() if any(option in param.opts for param in verb.params)
    ]
    return names[:MOST_VERBS] + (["..."] if len(names) > MOST_VERBS else [])


KINDS = {"float": "a number", "int": "a whole number", "integer": "a whole number"}
"""Allowed values by click's name of the type, or by the first word of pydantic's error type
(int_parsing)."""

CLICKS_WORDS = re.compile(r"'(?P<value>.*)' is not a valid (?P<kind>float|integer)", re.DOTALL)
"""Message of click, with which older versions of typer parse numbers; newer ones use pydantic."""


def _bad_value(error: Any) -> str:
    """Option, value and allowed values if a number cannot be parsed; else ""."""
    names = getattr(getattr(error, "param", None), "opts", None)
    if not names:
        return ""
    cause = error.__cause__ or error.__context__
    details = cause.errors() if hasattr(cause, "errors") else []
    clicks = CLICKS_WORDS.match(str(getattr(error, "message", "")))
    if details:
        kind, value = KINDS.get(details[0]["type"].split("_")[0]), details[0]["input"]
    elif clicks is not None:
        kind, value = KINDS[clicks["kind"]], clicks["value"]
    else:
        return ""
    return f"{names[0]}: got {value!r}; must be {kind}" if kind else ""


BAD_INPUT, FAILED = 2, 1

app = typer.Typer(
    name="rb_sim",
    cls=OneLineErrors,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Simulate constrained rigid bodies: motion and the reaction of every constraint.",
    epilog="Exit codes: 0 success; 1 the simulation or a log failed; 2 bad input; 3 an accuracy "
    "check failed (--strict); 4 the logs of the node lack a part; 130, 143 interrupted.",
)


def verb(
    options: type | None = None, **settings: Any
) -> Callable[[Callable[..., int | None]], Callable[..., None]]:
    """Decorator that registers a function as a verb: it returns the exit code; RbSimError becomes
    one line.

    options: dataclass of the verb's arguments, which the function takes; None: it has them itself.
    """

    def register(function: Callable[..., int | None]) -> Callable[..., None]:
        @functools.wraps(function)
        def call(*arguments: Any, **keywords: Any) -> None:
            if options is not None:
                arguments, keywords = (options(**keywords),), {}
            raise typer.Exit(_exit_code(lambda: function(*arguments, **keywords)))

        if options is not None:
            call.__signature__ = inspect.signature(options, eval_str=True)  # type: ignore[attr-defined]
        app.command(cls=PlainFlags, **settings)(call)
        return call

    return register


def _exit_code(act: Callable[[], int | None]) -> int:
    warnings.formatwarning = _one_line
    try:
        EARLY.hand_over()
        with terminable():
            code = act() or 0
            sys.stdout.flush()  # a full disk is found here, not as Python ends
            return code
    except SimulationError as error:
        code, line = FAILED, f"error: {error}"
    except RbSimError as error:
        code, line = BAD_INPUT, "\n".join(f"error: {mistake}" for mistake in error.lines)
    except ModuleNotFoundError as error:
        from rb_sim.base.installed import complaint

        code, line = FAILED, complaint(error=error) or f"error: {error}"
    except TerminatedError as error:
        code, line = 128 + error.number, "interrupted"
    except KeyboardInterrupt:
        code, line = INTERRUPTED, "interrupted"
    print(line, file=sys.stderr, flush=True)
    if code >= 128 and _still_compiles():
        sys.stdout.flush()
        os._exit(code)
    return code


_FORMAT = warnings.formatwarning


def _one_line(message: Any, category: Any, *where: Any, **more: Any) -> str:
    """A SceneWarning without file and line of rb_sim's sources; other warnings in Python's
    format."""
    if issubclass(category, SceneWarning):
        return f"warning: {message}\n"
    return _FORMAT(message, category, *where, **more)


def _still_compiles() -> bool:
    """Whether LLVM still runs in a thread that could not be stopped."""
    program = sys.modules.get("rb_sim.compiler.program")
    return program is not None and program.left_alone()


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"rb_sim {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            help="Print the version and exit.",
            is_eager=True,
            callback=_print_version,
        ),
    ] = False,
) -> None:
    """Options of the program itself."""


@verb(opt.RunOptions)
def run(options: opt.RunOptions) -> int:
    """Simulate a scene without ROS, record it, and print a summary with its accuracy.

    With --out, DIR gets bag/ (ROS 2, MCAP), recording.rrd (Rerun), plots.png and summary.json.
    """
    from rb_sim.cli.verbs.run import run as run_scene

    return run_scene(options)


@verb()
def scenes(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DIR | NAME]", help="A folder of scenes; with --show the name of a scene."
        ),
    ] = None,
    show: Annotated[bool, typer.Option("--show", help="Print the YAML of the scene NAME.")] = False,
    statics: Annotated[
        bool, typer.Option("--statics", help="List statics scenes (bodies at rest).")
    ] = False,
) -> int:
    """List the scenes that come with rb_sim, one line each, or print one (NAME --show)."""
    from rb_sim.cli.verbs.scenes import scenes as list_them
    from rb_sim.scene.listing import find_scene

    if show:
        if folder is None:
            raise RbSimError("--show: got no scene; must be the NAME of a scene")
        text = find_scene(str(folder)).read_text(encoding="utf-8")
        print(text, end="" if text.endswith("\n") else "\n")
        return 0

    return list_them(folder, statics)


@verb()
def layout(
    scene: opt.Scene,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder for the layouts.", show_default="the current folder"
        ),
    ] = None,
) -> int:
    """Write layouts for Foxglove, RViz and PlotJuggler with the topics of a scene.

    They fit the node (rb_sim node SCENE) and the bags of rb_sim run SCENE.
    """
    from rb_sim.cli.verbs.scenes import layout as write_layouts

    return write_layouts(scene, out)


@verb()
def warm(
    scene: Annotated[
        list[str] | None,
        typer.Argument(help="Scenes: files or names; default: all shipped ones."),
    ] = None,
    method: opt.Method = None,
) -> int:
    """Compile scenes in advance so that their first run starts at once."""
    from rb_sim.cli.verbs.scenes import warm as warm_scenes

    return warm_scenes(scene or [], method)


@verb()
def recover(
    bag: opt.Bag,
    directory: Annotated[
        Path | None, typer.Argument(help="Folder for the repaired bag; default: BAG_recovered.")
    ] = None,
) -> None:
    """Repair a bag that is damaged or was not finished (process killed, disk full)."""
    from rb_sim.cli.verbs.replay import recover as recover_bag

    recover_bag(bag, directory)


@verb(
    context_settings={
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "allow_interspersed_args": False,
    },
    options_metavar="",
)
def node(context: typer.Context, scene: opt.Scene) -> int:
    """Simulate a scene as a ROS 2 node: SCENE [--ros-args -p NAME:=VALUE ...].

    Same as rb_sim_node; `rb_sim_node --help` lists the parameters.
    """
    from rb_sim.ros.main import main as run_node
    from rb_sim.scene.listing import find_scene

    return run_node([str(find_scene(scene)), *context.args])


@verb()
def statics(
    scene: opt.AnyScene,
    out: opt.Out = None,
    change: opt.Change = None,
) -> int:
    """Compute reactions of bodies at rest, their ranges if not unique, or why none exist.

    A scene of motion is taken at its initial pose, without velocities and commands.
    """
    from rb_sim.cli.verbs.statics import statics as solve

    return solve(scene, out, change or ())


@verb()
def explain(scene: opt.Scene, out: opt.Out = None, change: opt.Change = None) -> int:
    """List the parts of a scene and the CPU time that each one costs."""
    from rb_sim.cli.verbs.explain import explain as tell

    return tell(scene, out, change or ())


@verb()
def linearize(
    scene: opt.Scene,
    at: opt.At = 0.0,
    axes: opt.Axes = "world",
    turning: opt.Turning = 0.0,
    out: opt.Out = None,
    change: opt.Change = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON, including A, B, C and D, instead of tables.")
    ] = False,
) -> int:
    """Linearise a scene: A, B, C, D with names, eigenvalues, damping.

    With --out, DIR gets linear_model.npz with arrays for python-control, the poles as poles.png
    and, of a scene with commanded wrenches, the frequency responses as bode.png.
    """
    from rb_sim.cli.verbs.linearize import linearize as tell

    return tell(scene, at, axes, turning, out, json, change or ())


# Verbs that run one or many scenes more than once.


@verb()
def accuracy(
    scene: opt.AnyScene,
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
    change: opt.Change = None,
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
        return of_statics(path, out, target, change or ())
    return of_motion(path, out, target, budget, change or ())


@verb(name="hard-cases")
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


@verb()
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


# Verbs that read bags.


@verb()
def replay(
    bag: opt.AnyBag,
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


@verb()
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


@verb()
def info(bag: opt.AnyBag, json: opt.Json = False) -> int:
    """List the contents of a bag: scene, settings, versions, topics, rates, gaps, damage."""
    from rb_sim.cli.verbs.info import info as tell

    return tell(bag, json)


@verb(opt.AnalyzeOptions)
def analyze(options: opt.AnalyzeOptions) -> int:
    """Report rates, gaps, energy, momenta, wrenches and spectra of any bag with poses."""
    from rb_sim.cli.verbs.analyze import analyze as read

    return read(options)


@verb(opt.ResimOptions)
def resim(options: opt.ResimOptions) -> int:
    """Simulate a recorded run again: bit for bit the same, or with changes."""
    from rb_sim.cli.verbs.resim import resim as again

    return again(options)


@verb(opt.CompareOptions)
def compare(options: opt.CompareOptions) -> int:
    """Compare two motions: largest differences, when they begin, how fast they grow."""
    from rb_sim.cli.verbs.compare import compare as beside

    return beside(options)


@verb(opt.FitOptions)
def fit(options: opt.FitOptions) -> int:
    """Fit parameters of a scene to a recorded motion."""
    from rb_sim.cli.verbs.fit import fit as solve

    return solve(options)


def main() -> None:
    """Entry point of the console script; leaves through sys.exit."""
    sys.stdout = Unread(sys.stdout)  # type: ignore[assignment]
    sys.stderr = sys.stderr or sys.stdout
    app(prog_name="rb_sim")


if __name__ == "__main__":
    main()
