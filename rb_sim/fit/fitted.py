"""What a fit found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rb_sim.fit.parameters import Free


@dataclass
class Fitted:
    """The result. Arrays are in the order of `free`."""

    free: list[Free]
    values: np.ndarray
    errors: np.ndarray
    """standard errors; inf for a number that the recording does not determine."""
    correlation: np.ndarray
    noise: dict[str, float]
    """[m] and [rad], as given or as left."""
    residuals: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]
    """by body: t, position residuals (n, 3), attitude residuals (n, 3)."""
    runs: int
    message: str
    undetermined: list[str]
    data: dict[str, Any]
    """the scene with the fitted values."""
    limited: list[str]
    """numbers that are held by a limit of what the scene takes; their errors know nothing of it."""
    correlation_left: float = 0.0
    """of neighbours in what is left where it is not noise, else 0: the scene is another one than
    was recorded, or the search ended elsewhere, and the errors mean nothing."""
    outliers: tuple[str, ...] = ()
    """poses that lie far from all others beside that motion, a line for each body."""
    lost: tuple[str, ...] = ()
    """what watches saw of lost accuracy in the motion with the fitted values, a line each."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        names = [number.name for number in self.free]
        return {
            "numbers": {
                name: {"start": n.start, "value": float(v), "error": float(e)}
                for name, n, v, e in zip(names, self.free, self.values, self.errors, strict=True)
            },
            "correlation": self.correlation.tolist(),
            "noise": self.noise,
            "runs": self.runs,
            "message": self.message,
            "undetermined": self.undetermined,
            "limited": self.limited,
            "correlation_left": self.correlation_left,
            "outliers": list(self.outliers),
            "lost": list(self.lost),
        }
