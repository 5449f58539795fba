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
from importlib import import_module
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
    place: str, options: type | None = None, **settings: Any
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorator that registers a verb by its declaration: a function without a body, whose
    docstring is the help and whose arguments are those of the function that does it, which is
    imported when the verb is called and returns the exit code.

    place: module of rb_sim.cli.verbs and name of that function. options: dataclass of the
    arguments, which the function takes instead.
    """
    module, _, name = place.partition(":")

    def register(declared: Callable[..., None]) -> Callable[..., None]:
        def act(keywords: dict[str, Any]) -> int | None:
            does = getattr(import_module(f"rb_sim.cli.verbs.{module}"), name)
            return does(**keywords) if options is None else does(options(**keywords))

        @functools.wraps(declared)
        def call(**keywords: Any) -> None:
            raise typer.Exit(_exit_code(lambda: act(keywords)))

        signature = inspect.signature(declared if options is None else options, eval_str=True)
        call.__signature__ = signature  # type: ignore[attr-defined]
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


@verb("run:run", opt.RunOptions)
def run() -> None:
    """Simulate a scene without ROS, record it, and print a summary with its accuracy.

    With --out, DIR gets bag/ (ROS 2, MCAP), recording.rrd (Rerun), plots.png and summary.json.
    """


@verb("scenes:scenes")
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
) -> None:
    """List the scenes that come with rb_sim, one line each, or print one (NAME --show)."""


@verb("scenes:layout")
def layout(
    scene: opt.Scene,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder for the layouts.", show_default="the current folder"
        ),
    ] = None,
) -> None:
    """Write layouts for Foxglove, RViz and PlotJuggler with the topics of a scene.

    They fit the node (rb_sim node SCENE) and the bags of rb_sim run SCENE.
    """


@verb("scenes:warm")
def warm(
    scene: Annotated[
        list[str] | None,
        typer.Argument(help="Scenes: files or names; default: all shipped ones."),
    ] = None,
    method: opt.Method = None,
) -> None:
    """Compile scenes in advance so that their first run starts at once."""


@verb("replay:recover")
def recover(
    bag: opt.Bag,
    directory: Annotated[
        Path | None, typer.Argument(help="Folder for the repaired bag; default: BAG_recovered.")
    ] = None,
) -> None:
    """Repair a bag that is damaged or was not finished (process killed, disk full)."""


@verb(
    "scenes:node",
    context_settings={
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "allow_interspersed_args": False,
    },
    options_metavar="",
)
def node(context: typer.Context, scene: opt.Scene) -> None:
    """Simulate a scene as a ROS 2 node: SCENE [--ros-args -p NAME:=VALUE ...].

    Same as rb_sim_node; `rb_sim_node --help` lists the parameters.
    """


@verb("statics:statics")
def statics(scene: opt.AnyScene, out: opt.Out = None, changes: opt.Change = None) -> None:
    """Compute reactions of bodies at rest, their ranges if not unique, or why none exist.

    A scene of motion is taken at its initial pose, without velocities and commands.
    """


@verb("explain:explain")
def explain(scene: opt.Scene, out: opt.Out = None, changes: opt.Change = None) -> None:
    """List the parts of a scene and the CPU time that each one costs."""


@verb("linearize:linearize")
def linearize(
    scene: opt.Scene,
    at: opt.At = 0.0,
    axes: opt.Axes = "world",
    turning: opt.Turning = 0.0,
    out: opt.Out = None,
    changes: opt.Change = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON, including A, B, C and D, instead of tables.")
    ] = False,
) -> None:
    """Linearise a scene: A, B, C, D with names, eigenvalues, damping.

    With --out, DIR gets linear_model.npz with arrays for python-control, the poles as poles.png
    and, of a scene with commanded wrenches, the frequency responses as bode.png.
    """


# Verbs that run one or many scenes more than once.


@verb("accuracy:of_scene")
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
    changes: opt.Change = None,
) -> None:
    """Measure error against CPU time for each method on a scene.

    For a statics scene: the accuracy of its reactions.
    """


@verb("hard_cases:hard_cases", name="hard-cases")
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
) -> None:
    """Run scenes that are hard to simulate and print the margin of each bound.

    With --out, DIR gets hard-cases.json, .md and .png. Exit code 1 if one fails.
    """


@verb("sweep:of_arguments")
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
) -> None:
    """Run a scene many times with varied parameters; runs that DIR already contains are kept."""


# Verbs that read bags.


@verb("replay:of_arguments")
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
) -> None:
    """Show a bag in the Rerun viewer, save a picture or a film of it, or publish its topics."""


@verb("replay:show")
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


@verb("info:info")
def info(bag: opt.AnyBag, as_json: opt.Json = False) -> None:
    """List the contents of a bag: scene, settings, versions, topics, rates, gaps, damage."""


@verb("analyze:analyze", opt.AnalyzeOptions)
def analyze() -> None:
    """Report rates, gaps, energy, momenta, wrenches and spectra of any bag with poses."""


@verb("resim:resim", opt.ResimOptions)
def resim() -> None:
    """Simulate a recorded run again: bit for bit the same, or with changes."""


@verb("compare:compare", opt.CompareOptions)
def compare() -> None:
    """Compare two motions: largest differences, when they begin, how fast they grow."""


@verb("fit:fit", opt.FitOptions)
def fit() -> None:
    """Fit parameters of a scene to a recorded motion."""


def main() -> None:
    """Entry point of the console script; leaves through sys.exit."""
    sys.stdout = Unread(sys.stdout)  # type: ignore[assignment]
    sys.stderr = sys.stderr or sys.stdout
    app(prog_name="rb_sim")


if __name__ == "__main__":
    main()
