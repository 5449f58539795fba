"""A finding, by the name under which watches give it."""

from rb_sim.finding import Finding

<<<<<<< HEAD
import math
from typing import Any, NamedTuple


class Finding(NamedTuple):
    """One loss of accuracy; each watch reports its first."""

    watch: str
    """which: energy, momentum, angular momentum, residual, dead point, step control, step, time,
    turn, half turn, events, solver, running contact, paradox, ambiguous, little motion."""
    t: float
    """simulated time of the first sample beyond the bound [s]."""
    figure: float
    bound: float
    what: str
    """what the figure is, in words."""
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
        figure = f"{self.figure:.2g}" if math.isfinite(self.figure) else "not finite"
        return (
            f"{self.watch}: {self.what} is {figure} at t = {self.t:.6g} s{place}, "
            f"above {self.bound:.2g}"
        )
=======
__all__ = ["Finding"]
>>>>>>> w-bags-12
