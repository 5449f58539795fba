"""Whether `auto` makes a run of a method that is seldom the cheapest: a run of it is a wait for its
machine code, too, so its price is asked first."""

from __future__ import annotations

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.prices import evaluations
from rb_sim.engine.methods.registry import METHODS
from rb_sim.engine.tables.laws import BODIES
from rb_sim.graph.series import NoSeriesError
from rb_sim.scene.compiled import Compiled

STRETCH, GROWTH = 0.25, 1.0 / 8.0
"""A step along a series is hardly longer than max(1, STRETCH tolerance^-GROWTH) steps of dopri853,
which fall with their tolerance: it is 1.3, 2.3 and 4 of them at 1e-5, 1e-9 and 1e-12 on chains."""


def worth_a_run(setting: Setting, compiled: Compiled, factor: float) -> bool:
    """Whether the method may come within the factor of what dopri853 costs with its tolerance.

    Asked only of methods with which `auto` does not begin (`weighed` of the registry).
    """
    entry, tolerance = METHODS[setting.name], setting.tolerance
    if entry.weighed(compiled.system) or tolerance is None:
        return True
    longer = max(1.0, STRETCH * tolerance**-GROWTH)
    dearer = evaluations(setting.name, tolerance, compiled)
    dearer /= evaluations("dopri853", tolerance, compiled)
    return dearer <= factor * longer and (entry.family != "taylor" or expands(compiled))


def expands(compiled: Compiled) -> bool:
    """Whether the laws have a Taylor series that is not longer to make than any run takes.

    From BODIES bodies on the laws are made kind by kind, but their series from the whole graph.
    """
    if len(compiled.layout.bodies) >= BODIES:
        return False
    laws: object = compiled.laws
    try:
        return getattr(laws, "series", None) is not None
    except NoSeriesError:
        return False
