"""A setting of a method, and a choice among settings with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from rb_sim.engine.methods.registry import METHODS, build

QUANTITIES = ("position", "rotation", "linear_velocity", "angular_velocity", "force", "torque")
UNITS = ("m", "rad", "m/s", "rad/s", "N", "N m")


def listed(errors: Sequence[float]) -> str:
    """The errors of QUANTITIES with their units."""
    return ", ".join(
        f"{name.replace('_', ' ')} {error:.1e} {unit}"
        for name, error, unit in zip(QUANTITIES, errors, UNITS, strict=True)
    )


class Setting(NamedTuple):
    """A method with a fixed step [s] or a local tolerance: exactly one of the two is set."""

    name: str
    step: float | None = None
    tolerance: float | None = None

    @property
    def order(self) -> int:
        return METHODS[self.name].order

    @property
    def knob(self) -> float:
        """The step [s] or the tolerance."""
        return self.step if self.step is not None else float(self.tolerance or 0.0)

    @property
    def power(self) -> float:
        """Exponent of the knob in the global error, as theory has it."""
        return float(self.order) if self.step is not None else 1.0

    def with_knob(self, value: float) -> Setting:
        if self.step is not None:
            return self._replace(step=value)
        return self._replace(tolerance=value)

    def build(self, duration: float) -> Any:
        """The method for the kernel; duration [s] bounds an adaptive step."""
        return build(self.name, step=self.step, tolerance=self.tolerance, largest_step=duration)

    def __str__(self) -> str:
        if self.step is not None:
            return f"{self.name}, step {self.step:.3g} s"
        return f"{self.name}, tolerance {self.tolerance:.3g}"


@dataclass(frozen=True)
class Choice:
    """What `method: auto` decided, and why."""

    method: str
    step: float | None
    """fixed step [s], or None."""
    tolerance: float | None
    """local tolerance of an adaptive step, or None."""
    target: float
    """global error of the pose asked for [rad, m]."""
    predicted_error: float
    """largest pose error over the scene's duration, measured against the checked run [rad, m]."""
    cost: float
    """CPU seconds per simulated second."""
    reached: bool
    """False where round-off, chaos or the search's budget keep the error above the target."""
    reason: str
    errors: tuple[float, ...] = ()
    """largest errors of position [m], rotation [rad], linear and angular velocity [m/s, rad/s],
    reaction force [N] and torque [N m] over the duration, the doubt of the checked run added."""

    @property
    def setting(self) -> Setting:
        return Setting(self.method, self.step, self.tolerance)

    def build(self, duration: float) -> Any:
        """The method for the kernel."""
        return self.setting.build(duration)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for a summary or a recording."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.setting}: {self.reason}"
