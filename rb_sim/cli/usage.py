"""Errors of usage in one line, as all other errors: what was wrong, and whose --help to read.

Help shows a flag as one: newer versions of typer write a type after it, as if it took a value.
"""

from __future__ import annotations

import re
import sys
from typing import Any

from typer.core import TyperCommand, TyperGroup

INTERRUPTED = 130
"""Exit code after SIGINT."""


class PlainFlags(TyperCommand):
    """A verb whose help shows no type behind a flag."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The arguments and options, --help included."""
        return _without_types(super().get_params(ctx))


class OneLineErrors(TyperGroup):
    """The verbs of the program; a wrong option or argument is told in one line, not in a box."""

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
            # told by what it has, not by class: older versions of typer raise click's own classes,
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


def _complain(error: Any) -> int:
    """Print the error; its exit code."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":  # `rb_sim` alone: its message is the help
        error.show()
        return int(error.exit_code)
    message = _bad_value(error) or " ".join(str(error.format_message()).split()).rstrip(".")
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
