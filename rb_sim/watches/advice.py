"""The forecast of a scene's run, with what would make it shorter."""

from __future__ import annotations

import math
from collections.abc import Callable

from rb_sim.forecast import ADVICE, Forecast
from rb_sim.scene.schema import Scene

ADVICE_IN_CONTACT = (
    "where points slip slowly side by side, friction limits the steps at any tolerance, since it "
    "turns each slip at the rate of mu g over its speed; try method time_stepping, a larger "
    "tolerance, or a shorter duration"
)


def advice_for(scene: Scene) -> str:
    """What to try where a run of the scene takes too long."""
    rubbing = any(
        getattr(getattr(spec, "friction", None), "static", 0.0) > 0.0
        for spec in scene.constraints.values()
    )
    adaptive = scene.simulation.step is None and scene.simulation.method != "auto"
    return ADVICE_IN_CONTACT if rubbing and adaptive else ADVICE


def forecast_for(
    scene: Scene,
    duration: float,
    tell: Callable[[str], None] | None,
    *,
    wall: float = math.inf,
) -> Forecast:
    """The forecast of a run of the scene; the rest as in Forecast."""
    return Forecast(duration, tell, wall=wall, advice=advice_for(scene))
