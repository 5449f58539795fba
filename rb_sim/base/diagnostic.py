"""A finding of an accuracy check: quantity, value, limit, time, place, and what to try."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from rb_sim.base.errors import AccuracyWarning


class Finding(NamedTuple):
    """One loss of accuracy; each check reports its first."""

    watch: str
    """which: global error, auto, energy, momentum, angular momentum, residual, inside,
    singular configuration, step, time, turn, half turn, events, solver, running contact, aim,
    paradox, rough, ambiguous."""
    t: float
    """simulated time of the first sample beyond the bound [s]."""
    figure: float
    bound: float
    what: str
    """the quantity, with its unit in brackets at the end if it has one."""
    where: str
    """the body, constraint or contact concerned, or ""."""
    advice: str
    """what to try."""
    finer_step: float | None = None
    """fixed step to try first [s], from the order of the method; None where no step mends it."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
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
            f"{self.watch}: {quantity} is {figure} (limit {self.bound:.2g}{unit}) "
            f"at t = {self.t:.6g} s{place}"
        )


class GlobalError(NamedTuple):
    """How far a run is from the motion at most, or why that is not known."""

    relative: float = math.nan
    """share of the motion; infinite where the second run could not go as far as the first."""
    t: float = 0.0
    """when it is largest [s]."""
    body: str = ""
    pose: float = math.nan
    """largest difference of a centre of mass [m] or an attitude [rad] itself."""
    by: str = ""
    """what the second run was made with."""
    unknown: str = ""
    """why no error is stated."""
    upto: float | None = None
    """end of the part of the run that was compared [s]; None: all of it was."""

    @property
    def known(self) -> bool:
        """Whether a second run was made."""
        return not self.unknown

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**self._asdict(), "text": str(self)}

    def __str__(self) -> str:
        if self.unknown:
            return f"not known: {self.unknown}"
        if not math.isfinite(self.relative):
            return f"not known: the second run ({self.by}) failed at t = {self.t:.6g} s"
        by = f"by a second run ({self.by})"
        if self.upto is not None:
            by += f" up to t = {self.upto:.4g} s; use --check for the whole run"
        if not self.relative > 0.0:
            return f"at round-off, {by}"
        return f"{self.relative:.1g} of the motion, at t = {self.t:.4g} s ({self.body}), {by}"


def findings_in(summary: Mapping[str, Any] | None) -> tuple[Finding, ...]:
    """Those that a summary of a run tells; what another version wrote otherwise is left out."""
    told = (summary or {}).get("warnings") or ()
    known = ({k: each[k] for k in Finding._fields if k in each} for each in told)
    least = set(Finding._fields) - set(Finding._field_defaults)
    return tuple(Finding(**each) for each in known if least <= each.keys())


def global_error_in(summary: Mapping[str, Any] | None) -> GlobalError | None:
    """The global error that a summary of a run states; None where it states none."""
    told = (summary or {}).get("global_error") or {}
    nan = {k: math.nan for k in ("relative", "pose") if told.get(k, 0.0) is None}
    known: dict[str, Any] = {k: told[k] for k in GlobalError._fields if k in told} | nan
    return GlobalError(**known) if known else None


def tell(lines: Iterable[str], findings: Iterable[Finding], stacklevel: int = 1) -> None:
    """Warn of each line, and of each finding as lost accuracy."""
    for line in lines:
        warnings.warn(line, stacklevel=stacklevel + 1)
    for finding in findings:
        warnings.warn(str(finding), AccuracyWarning, stacklevel=stacklevel + 1)
