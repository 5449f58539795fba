"""What fixed steps have made of a run, as the run in half steps shows: a line of its summary."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from rb_sim.engine.methods.registry import METHODS
from rb_sim.half_steps import SAME_STEP

if TYPE_CHECKING:
    from rb_sim.simulation import Simulation


def error_of_steps(simulation: Simulation, span: float) -> dict[str, Any] | None:
    """The error of a run up to `span` [s] with fixed steps; None of other runs, and where `auto`
    has measured it.

    Two runs of order p in steps h and h/2 are apart by 1 - 2^-p of the error of the first.
    """
    setting = simulation.setting
    if setting.step is None or simulation.choice is not None or not span > 0.0:
        return None
    share, t, body, of, upto, turn, turned = simulation.coarseness.strayed
    apart = 1.0 - 2.0 ** -METHODS[setting.name].order
    return {
        "relative": share / apart,
        "t": t,
        "body": body,
        "of": of,
        "turn": min(turn / apart, math.pi),
        "turned": turned,
        "upto": upto,
        "all": upto >= span * (1.0 - SAME_STEP),
    }


def told(error: dict[str, Any]) -> str:
    """The same in words."""
    upto = error["upto"]
    if not upto > 0.0:
        return "not known: --certify bounds it"
    size, turn, text = error["relative"], error["turn"], "none that half steps show"
    if size > 0.0:
        whose = f"{error['body']}'s" if error["body"] else "the"
        text = f"by half steps about {size:.2g} of {whose} {error['of']} at t = {error['t']:.6g} s"
    if size > 0.0 and turn > 0.0:
        text += f" and {turn:.2g} rad in the attitude of {error['turned']}"
    return (
        text if error["all"] else f"{text}; after t = {upto:.6g} s not known: --certify bounds it"
    )
