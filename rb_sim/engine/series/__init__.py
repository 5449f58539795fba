"""Variables in which a system's Taylor series is much cheaper than in its coordinates: one line
each."""

from typing import Any

from rb_sim.engine.series.fixed_axis import AS_PENDULUM
from rb_sim.engine.series.rolling_disk import IN_ANGLES
from rb_sim.engine.series.rolling_sphere import IN_WORLD_AXES
from rb_sim.engine.series.variables import Variables

KNOWN: tuple[Variables, ...] = (IN_ANGLES, IN_WORLD_AXES, AS_PENDULUM)


def variables_of(system: Any) -> Variables | None:
    """Such variables for this compiled system, or None."""
    return next((known for known in KNOWN if known.suits(system)), None)
