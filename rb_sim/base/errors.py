# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors, each in one line with field, value and allowed values, and findings of accuracy checks.

Findings have quantity, value, limit, time and place, and advice.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple


class RbSimError(Exception):
    """Base of all errors of rb_sim; its text is one line: the mistake and the allowed values."""

    @property
    def lines(self) -> tuple[str, ...]:
        """The text with a line for each mistake."""
        return (str(self),)


class SceneError(RbSimError):
    """The scene is not valid, or cannot be simulated.

    Attributes:
        file: Path of the scene file, or "<scene>" for one made in memory.
        key: Path of the key concerned, e.g. "bodies.ball.mass"; "" for the file itself.
        message: The mistake and the allowed values.
    """

    def __init__(
        self, message: str, *, key: str = "", file: str = "<scene>", others: Sequence[str] = ()
    ) -> None:
        """others: further mistakes, each with its key; they are part of `message`."""
        self.message = "; ".join((message, *others))
        self.key = key
        self.file = file
        self._set: tuple[str, ...] = ()
        self._mistakes = (": ".join(part for part in (key, message) if part), *others)
        super().__init__(": ".join(part for part in (file, key, self.message) if part))

    @property
    def lines(self) -> tuple[str, ...]:
        """The text with a line for each mistake."""
        return tuple(self._place(line) + line for line in self._mistakes)

    def _place(self, line: str) -> str:
        key = line.partition(": ")[0]
        if any(key == own or key.startswith((f"{own}.", f"{own}[")) for own in self._set):
            return "--set "
        return f"{self.file}: " if self.file else ""

    @classmethod
    @contextmanager
    def after(cls, changes: Sequence[str]) -> Iterator[None]:
        """Context for a scene with values KEY=VALUE of `--set`: for these keys the lines of an
        error name the option instead of the file."""
        try:
            yield
        except cls as error:
            error._set = tuple(change.partition("=")[0].strip() for change in changes)
            raise


class UnknownNameError(RbSimError, KeyError):
    """A name that does not exist in a mapping of a run; also a KeyError."""

    def __str__(self) -> str:
        return str(self.args[0])


class MissingExtraError(RbSimError):
    """An optional library is not installed; the text says how to install it.

    extra: of rb_sim that installs it, or "" for a library by its own name.
    """

    def __init__(self, library: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs the package {library!r}: install it with pip install "
            + (f"'rb_sim[{extra}]'" if extra else library)
        )


class SimulationError(RbSimError):
    """The integration cannot continue; the text has time, reason and, if it helps, a step."""


class StepTooLargeError(SimulationError):
    """The state is no longer finite with a fixed step; a smaller step may help."""


class AccuracyWarning(UserWarning):
    """An accuracy check failed; the text has quantity, value, limit, time, body and advice."""


class SceneWarning(UserWarning):
    """A value of a scene that users of other programs often mean differently; the text states its
    meaning in rb_sim."""


class SinkError(RbSimError):
    """A recording that cannot be opened, written or read; the text names the file.

    After a failed write the sink is closed; the caller drops it and continues.
    """


def check_ending(path: Path | None, ending: str) -> None:
    """Refuse a file name with another suffix. Raises SinkError."""
    if path is not None and path.suffix != ending:
        raise SinkError(f"{path}: the name must end in {ending}")


@contextmanager
def named_if_lacking() -> Iterator[None]:
    """Context (and decorator) that turns an ImportError of a package that rb_sim needs into one
    line with its name and how to install it."""
    try:
        yield
    except ImportError as error:
        from rb_sim.base.installed import complaint

        if not (line := complaint(error=error)):
            raise
        raise ImportError(line.removeprefix("error: "), name=error.name) from None


class Check(NamedTuple):
    """An accuracy check as the reference page of messages describes it."""

    quantity: str
    limit: str
    cause: str
    cure: str


FINER = "the step that the message names, or an adaptive method with a tolerance"

CHECKS: dict[str, Check] = {
    "global error": Check(
        "difference from a second run with 0.62 of the step or a tenth of the tolerance (fixed "
        "steps with contacts: with `dopri853` by events), relative to the motion",
        "0.01; with `method: auto` its tolerance",
        "step or tolerance too large; a chaotic or unstable motion",
        "the setting that the message names; for chaos a shorter duration",
    ),
    "auto": Check(
        "smallest global error that can be assured [m, rad]",
        "the tolerance",
        "round-off, chaos or an instability exceeds the tolerance of `method: auto`",
        "a larger tolerance or a shorter duration",
    ),
    "energy": Check(
        "change of energy minus work, relative to the energy exchanged; or energy gained in "
        "contacts",
        "10 x tolerance x steps, between 1e-9 and 1e-3; fixed step 1e-3, first order 2e-2; gained "
        "in contacts 1e-2",
        "step or tolerance too large for the fastest motion or the stiffest spring",
        FINER + "; for stiff springs `radau5`",
    ),
    "momentum": Check(
        "change of linear momentum minus impulse, relative to the largest momentum",
        "ten times that of energy",
        "step or tolerance too large",
        FINER,
    ),
    "angular momentum": Check(
        "change of angular momentum minus angular impulse, relative to the largest",
        "ten times that of energy",
        "step or tolerance too large",
        FINER,
    ),
    "residual": Check(
        "largest violation of a constraint, relative to the scene's size or speed",
        "1e-9; 1e-6 with contacts",
        "constraints that contradict each other; `time_stepping` is of first order",
        "check the constraint that the message names; a smaller step; `dopri853`",
    ),
    "inside": Check(
        "penetration of a shape into the support of a contact that lists points [m]",
        "1e-3 of the shape's size",
        "only the listed points make contact",
        "more points, or none so that the whole shape makes contact",
    ),
    "singular configuration": Check(
        "number of constraint equations that become dependent",
        "0",
        "the linkage passes a position from which several motions are possible",
        "end the run before, or change lengths or drives so that it is not reached",
    ),
    "step": Check(
        "estimated error of all fixed steps, relative to the velocity or of an attitude [rad]; "
        "rotation in one step [rad]",
        "0.1; pi",
        "the fixed step does not resolve the motion",
        FINER,
    ),
    "events": Check(
        "contact events between two samples",
        "50",
        "a contact chatters: it opens and closes continually",
        "`method: time_stepping`",
    ),
    "contact steps": Check(
        "with `time_stepping`, the first of these above its limit: residual of the friction "
        "problem; fraction of steps in which a contact point runs round a rim, a contact has "
        "several solutions (Painleve's paradox) or a rough contact slips; energy lost or gained "
        "in contacts; velocity error due to a rotating normal",
        "residual 1e-6; fractions 0; energy 0.02 lost, 0.01 gained, of the exchanged; velocity "
        "0.05",
        "the step is too long for the contacts, or rigid friction has several or no solutions",
        "the step that the message names, or an event-driven method",
    ),
    "ambiguous": Check(
        "difference between solutions of the contact problem that are all admissible",
        "the tolerance; 1e-3",
        "impact or friction laws leave several solutions, or round-off decides between them",
        "if the message names a setting, use it; else take the result as one of several",
    ),
}
"""All checks by name; a warning begins with that name."""


class Finding(NamedTuple):
    """Loss of accuracy found by a check; each check reports its first one."""

    check: str
    """name of the check, a key of CHECKS."""
    t: float
    """simulated time of the first sample beyond the bound [s]."""
    figure: float
    bound: float
    what: str
    """quantity, with its unit in brackets at the end if it has one."""
    where: str
    """body, constraint or contact, or "" if none applies."""
    advice: str
    """advice on how to avoid it."""
    finer_step: float | None = None
    """fixed step to try first [s], from the order of the method; None if no step helps."""

    def as_dict(self) -> dict[str, Any]:
        """The finding as JSON data."""
        return {**self._asdict(), "text": str(self)}

    def __str__(self) -> str:
        return f"{self.seen}; {self.advice}"

    @property
    def seen(self) -> str:
        """The finding as one line, without advice."""
        place = f" ({self.where})" if self.where else ""
        quantity, _, unit = self.what.removesuffix("]").partition(" [")
        unit = f" {unit}" if unit else ""
        figure = f"{self.figure:.2g}{unit}" if math.isfinite(self.figure) else "not finite"
        return (
            f"{self.check}: {quantity} is {figure} (limit {self.bound:.2g}{unit}) "
            f"at t = {self.t:.6g} s{place}"
        )


class GlobalError(NamedTuple):
    """Largest error of a run as measured by a second run, or why it is not known."""

    relative: float = math.nan
    """error relative to the motion; infinite if the second run ended before the first."""
    t: float = 0.0
    """time of the largest error [s]."""
    body: str = ""
    pose: float = math.nan
    """largest absolute difference of a centre of mass [m] or an attitude [rad]."""
    by: str = ""
    """method and setting of the second run."""
    unknown: str = ""
    """reason why there is no error; "" if there is one."""
    upto: float | None = None
    """end of the compared part of the run [s]; None: the whole run."""
    why: str = ""
    """reason why the rest was not compared."""
    below: bool = False
    """whether the value is only an upper bound, from a coarser second run."""

    @property
    def known(self) -> bool:
        """Whether a second run was made."""
        return not self.unknown

    def as_dict(self) -> dict[str, Any]:
        """The error as JSON data."""
        return {**self._asdict(), "text": str(self)}

    def __str__(self) -> str:
        if self.unknown:
            return f"not known: {self.unknown}"
        if not math.isfinite(self.relative):
            return f"not known: the second run ({self.by}) failed at t = {self.t:.6g} s"
        by = f"by a second run ({self.by})"
        if self.upto is not None:
            by += f" up to t = {self.upto:.4g} s; {self.why}"
        if self.below:
            by += "; --check states the error itself"
        if not self.relative > 0.0:
            return f"at round-off, {by}"
        share = f"{'below ' if self.below else ''}{self.relative:.1g} of the motion"
        return f"{share}, at t = {self.t:.4g} s ({self.body}), {by}"


def findings_in(summary: Mapping[str, Any] | None) -> tuple[Finding, ...]:
    """Findings in the summary of a run; entries of another format are omitted."""
    warnings = (summary or {}).get("warnings") or ()
    known = ({k: each[k] for k in Finding._fields if k in each} for each in warnings)
    least = set(Finding._fields) - set(Finding._field_defaults)
    return tuple(Finding(**each) for each in known if least <= each.keys())


def global_error_in(summary: Mapping[str, Any] | None) -> GlobalError | None:
    """The global error in the summary of a run; None if there is none."""
    given = (summary or {}).get("global_error") or {}
    nan = {k: math.nan for k in ("relative", "pose") if given.get(k, 0.0) is None}
    known: dict[str, Any] = {k: given[k] for k in GlobalError._fields if k in given} | nan
    return GlobalError(**known) if known else None


def lines_of(findings: Iterable[Finding]) -> list[str]:
    """A line for each finding; advice that several share stands in the last of them."""
    found = list(findings)
    last = {finding.advice: k for k, finding in enumerate(found)}
    return [
        str(finding) if k == last[finding.advice] else finding.seen
        for k, finding in enumerate(found)
    ]


def tell(lines: Iterable[str], findings: Iterable[Finding], stacklevel: int = 1) -> None:
    """Issue a warning for each line, and an AccuracyWarning for each finding."""
    for line in lines:
        warnings.warn(line, stacklevel=stacklevel + 1)
    for line in lines_of(findings):
        warnings.warn(line, AccuracyWarning, stacklevel=stacklevel + 1)
