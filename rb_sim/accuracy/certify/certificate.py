"""A certificate: the largest errors of a run, where they come from, and up to when they hold."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rb_sim.accuracy.choice import QUANTITIES as NAMES
from rb_sim.accuracy.choice import listed


@dataclass(frozen=True)
class Certificate:
    """Errors of a run, none smaller than the true one."""

    setting: str
    """how it was integrated."""
    checked_by: tuple[str, str]
    """settings of the two runs that it was compared with."""
    errors: tuple[float, ...]
    """largest error of each of NAMES up to `known_until`, in UNITS; infinite if that is 0."""
    doubt: tuple[float, ...]
    """share of it that is not the method's: by how much the two runs part, and one ulp grows."""
    one_ulp: tuple[float, ...]
    """what one ulp in every coordinate of the start grows to up to there."""
    duration: float
    """of the run [s]."""
    known_until: float
    """time up to which the two runs tell the motion to a tenth of its size [s]."""
    follows_until: float
    """time up to which the run itself does [s]."""
    rounding: bool
    """whether it is one ulp that has grown to as much by then, and not the time for the search."""
    growth: float
    """factor by which one ulp grows over the run."""
    lyapunov_time: float
    """[s]; infinite where errors do not grow exponentially."""
    runs: int
    """made for it, the run itself among them."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values; None for what is infinite: a time, errors where nothing is certain."""
        chaotic = math.isfinite(self.lyapunov_time)
        return {
            "setting": self.setting,
            "checked_by": list(self.checked_by),
            "errors": finite(self.errors),
            "doubt": finite(self.doubt),
            "one_ulp": dict(zip(NAMES, self.one_ulp, strict=True)),
            "duration": self.duration,
            "known_until": self.known_until,
            "follows_until": self.follows_until,
            "rounding": self.rounding,
            "growth": self.growth,
            "lyapunov_time": self.lyapunov_time if chaotic else None,
            "runs": self.runs,
            "text": self.lines(),
        }

    def lines(self) -> list[str]:
        """What is to be read, line by line."""
        first, second = self.checked_by
        if not self.known_until > 0.0:
            return [f"nothing is certain: {first} and {second} do not tell the same motion"]
        upto = "" if self.known_until >= self.duration else f" up to t = {self.known_until:.4g} s"
        ulp = max(self.one_ulp[:2])
        text = [
            f"no error is larger{upto} than: {listed(self.errors)}",
            f"found from {first} and {second}; of it are in doubt {max(self.doubt[:2]):.1e} (m, "
            f"rad); one ulp at the start makes {ulp:.1e} (m, rad)",
        ]
        if math.isfinite(self.lyapunov_time):
            text.append(f"errors grow by a factor of e in {self.lyapunov_time:.3g} s (chaos or an "
                        "instability)")  # fmt: skip
        if self.follows_until < self.duration:
            text.append(
                f"beyond t = {self.follows_until:.4g} s the run does not tell where the bodies are"
                f"{self._remedy()}"
            )
        return text

    def _remedy(self) -> str:
        if self.follows_until < self.known_until:
            return "; a smaller step or tolerance does"
        return "; nor does any in double precision" if self.rounding else ""


def finite(errors: tuple[float, ...]) -> dict[str, float | None]:
    """Errors by name, None where nothing bounds them."""
    pairs = zip(NAMES, errors, strict=True)
    return {name: error if math.isfinite(error) else None for name, error in pairs}
