"""The command line: reads arguments, calls a verb, turns errors into one line and an exit code."""

from __future__ import annotations

import functools
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
from rb_sim.cli import bag_verbs, study_verbs
from rb_sim.cli import options as opt
from rb_sim.simulation.signals import EARLY, TerminatedError, terminable

# Errors of usage in one line, as all other errors: what was wrong, and whose --help to read.
#
# Help shows a flag as one: newer versions of typer write a type after it, as if it took a value.


INTERRUPTED = 130
"""Exit code after SIGINT."""


class PlainFlags(TyperCommand):
    """A verb whose help shows no type behind a flag."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The arguments and options, --help included."""
        return _without_types(super().get_params(ctx))


class OneLineErrors(TyperGroup):
    """The verbs of the program; a wrong option or argument gets one line, not a box."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The options of the program itself, --help included."""
        return _without_types(super().get_params(ctx))

    def main(self, *arguments: Any, standalone_mode: bool = True, **keywords: Any) -> Any:
        """Parse, call the verb and leave through sys.exit, as the base class does."""
        if not standalone_mode:
            return super().main(*arguments, standalone_mode=False, **keywords)
        try:
            code = super().main(*arguments, standalone_mode=False, **keywords)
        except Exception as error:
            if isinstance(error.__cause__, KeyboardInterrupt):  # older versions of typer
                print("interrupted", file=sys.stderr, flush=True)
                sys.exit(INTERRUPTED)
            # known by what it has, not by class: older versions of typer raise click's own classes,
            # newer ones a copy of them
            if not (hasattr(error, "format_message") and hasattr(error, "exit_code")):
                raise
            code = _complain(error)
        sys.exit(code if isinstance(code, int) else 0)


def _without_types(params: list[Any]) -> list[Any]:
    """The same options; flags have an empty name for the value that they do not take."""
    for param in params:
        if getattr(param, "is_flag", False):
            param.metavar = ""
    return params


NEAREST = re.compile(
    r"(?:\.| \(Possible options:| Did you mean) *(?:Did you mean)? *'?([\w-]+)'?[?)]$"
)
"""The nearest name at the end of a message of click's, in the forms of its versions."""

NO_COMMAND = re.compile(r"No such command '(.*)'")


def _complain(error: Any) -> int:
    """Print the error; its exit code."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":  # `rb_sim` alone: its message is the help
        error.show()
        return int(error.exit_code)
    message = _bad_value(error) or " ".join(str(error.format_message()).split()).rstrip(".")
    message = NEAREST.sub(r" (did you mean \1?)", message)
    verb = NO_COMMAND.fullmatch(message)
    if (
        verb is not None and context is not None
    ):  # older versions of typer do not look for the nearest
        near = get_close_matches(verb[1], context.command.list_commands(context), n=1)
        message += f" (did you mean {near[0]}?)" if near else ""
    program = "rb_sim" if context is None else context.command_path
    print(f"error: {message}; see {program} --help", file=sys.stderr, flush=True)
    return int(error.exit_code)


KINDS = {"float": "a number", "int": "a whole number", "integer": "a whole number"}
"""By click's name of the type, or the first word of pydantic's for what was wrong (int_parsing)."""

CLICKS_WORDS = re.compile(r"'(?P<value>.*)' is not a valid (?P<kind>float|integer)", re.DOTALL)
"""Of click, with which older versions of typer read numbers; newer ones take pydantic."""


def _bad_value(error: Any) -> str:
    """Option, value and what is allowed, where a number cannot be read as one; else ""."""
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
    "check failed (--strict); 130, 143 interrupted.",
)


def verb(**settings: Any) -> Callable[[Callable[..., int | None]], Callable[..., None]]:
    """Register a function as a verb: RbSimError becomes one line, its result the exit code."""

    def register(function: Callable[..., int | None]) -> Callable[..., None]:
        @functools.wraps(function)
        def call(*arguments: Any, **keywords: Any) -> None:
            raise typer.Exit(_exit_code(lambda: function(*arguments, **keywords)))

        app.command(cls=PlainFlags, **settings)(call)
        return call

    return register


def _exit_code(act: Callable[[], int | None]) -> int:
    warnings.formatwarning = _one_line
    try:
        EARLY.hand_over()
        with terminable():
            return act() or 0
    except SimulationError as error:
        code, line = FAILED, f"error: {error}"
    except RbSimError as error:
        code, line = BAD_INPUT, f"error: {error}"
    except ModuleNotFoundError as error:
        from rb_sim.base.installed import complaint

        missing = f"error: the Python module {error.name} is not installed"
        code, line = FAILED, complaint() or missing
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
    """A warning of a scene without the place in our sources, which tells a user nothing."""
    if issubclass(category, SceneWarning):
        return f"warning: {message}\n"
    return _FORMAT(message, category, *where, **more)


def _still_compiles() -> bool:
    """Whether LLVM is at work in a thread that could not be broken off."""
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


@verb()
def run(
    scene: opt.SceneOrBag,
    out: opt.Out = None,
    overwrite: opt.Overwrite = False,
    duration: opt.Duration = None,
    rate: opt.Rate = None,
    method: opt.Method = None,
    step: opt.Step = None,
    tolerance: opt.Tolerance = None,
    no_bag: opt.NoBag = False,
    rerun: opt.Rerun = None,
    no_plots: opt.NoPlots = False,
    npz: opt.Npz = None,
    accelerations: opt.Accelerations = False,
    quiet: opt.Quiet = False,
    wall_stamps: opt.WallStamps = False,
    strict: opt.Strict = False,
    certify: opt.Certify = False,
    check: opt.Check = None,
    max_wall: opt.MaxWall = None,
    change: opt.Change = None,
    split_size: opt.SplitSize = None,
    split_duration: opt.SplitDuration = None,
) -> int:
    """Simulate a scene without ROS, record it, and print a summary with its accuracy.

    With --out, DIR gets bag/ (ROS 2, MCAP), recording.rrd (Rerun), plots.png and summary.json.
    """
    from rb_sim.cli.verbs.run import RunOptions
    from rb_sim.cli.verbs.run import run as run_scene

    return run_scene(
        RunOptions(
            scene=scene,
            out=out,
            overwrite=overwrite,
            duration=duration,
            rate=rate,
            method=method,
            step=step,
            tolerance=tolerance,
            bag=not no_bag,
            rerun=rerun,
            plots=not no_plots,
            npz=npz,
            accelerations=accelerations,
            quiet=quiet,
            wall_stamps=wall_stamps,
            strict=strict,
            certify=certify,
            check=check,
            max_wall=max_wall,
            changes=tuple(change or ()),
            split_size=split_size,
            split_duration=split_duration,
        )
    )


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
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="Scene: a YAML file, or a name from `rb_sim scenes [--statics]`.",
        ),
    ],
    out: opt.Out = None,
) -> int:
    """Compute reactions of bodies at rest, their ranges if not unique, or why none exist.

    A scene of motion is taken at its initial pose, without velocities and commands.
    """
    from rb_sim.cli.verbs.statics import statics as solve
    from rb_sim.scene.listing import find_scene

    return solve(find_scene(scene), out)


@verb()
def explain(scene: opt.Scene, out: opt.Out = None) -> int:
    """List the parts of a scene and the CPU time that each one costs."""
    from rb_sim.cli.verbs.explain import explain as tell
    from rb_sim.scene.listing import find_scene

    return tell(find_scene(scene), out)


@verb()
def linearize(
    scene: opt.Scene,
    at: opt.At = 0.0,
    axes: opt.Axes = "world",
    turning: opt.Turning = 0.0,
    out: opt.Out = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON, including A, B, C and D, instead of tables.")
    ] = False,
) -> int:
    """Linearise a scene: A, B, C, D with names, eigenvalues, damping.

    With --out, DIR gets linear_model.npz with arrays for python-control, the poles as poles.png
    and, of a scene with commanded wrenches, the frequency responses as bode.png.
    """
    from rb_sim.cli.verbs.linearize import linearize as tell
    from rb_sim.scene.listing import find_scene

    return tell(find_scene(scene), at, axes, turning, out, json)


study_verbs.register(verb)
bag_verbs.register(verb)


def main() -> None:
    """Entry point of the console script; leaves through sys.exit."""
    app(prog_name="rb_sim")


if __name__ == "__main__":
    main()
