"""How exact the reactions of bodies at rest are, and what they cost.

Nothing is integrated, so there is no ladder: what is left of the balance of forces and torques, the
error against a closed form where one is known, and the time of the solution.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rb_sim.accuracy.closed_forms.statics import ExactReactions, exact_reactions
from rb_sim.statics.admissible import eliminate
from rb_sim.statics.equilibrium import assemble
from rb_sim.statics.model import StaticsScene
from rb_sim.statics.result import StaticsResult
from rb_sim.statics.solve import solve

SPELL = 0.2
"""CPU time over which a solution is repeated [s]; the best counts."""


@dataclass(frozen=True)
class Answer:
    """One question put to the solver; errors relative to the largest load."""

    name: str
    forces: float
    """what is left of the balance of forces, of the worst body; nan without equilibrium."""
    torques: float
    """the same of torques, over the largest lever arm."""
    error: float
    """against the closed form: force of the worst support, or end of a range; nan without one."""
    cost: float
    """CPU time of one solution [s]."""


@dataclass(frozen=True)
class StaticsAccuracy:
    """What the reactions of one scene are worth."""

    scene: str
    result: StaticsResult
    exact: ExactReactions | None
    load: float
    """the largest: force, or torque over `lever` [N]."""
    lever: float
    """largest distance of a point of application from the middle of those on its body [m]."""
    answers: tuple[Answer, ...]


def measure(scene: StaticsScene, spell: float = SPELL) -> StaticsAccuracy:
    """Solve the scene, compare with its closed form, and time it for a spell [s]."""
    system = assemble(scene)
    load, lever = eliminate(system).force, system.lever
    result, exact = solve(scene), exact_reactions(scene)
    names = ["reactions" if result.reactions else "the verdict"]
    if result.reactions and not result.determinate:
        names.append("with their ranges")
    force, torque = (
        max((float(np.linalg.norm(part[i])) for part in result.balance.values()), default=math.nan)
        for i in (0, 1)
    )
    errors = error_of_reactions(result, exact), error_of_ranges(result, exact)
    answers = tuple(
        Answer(
            name,
            force / load,
            torque / (load * lever),
            error / load,
            cpu_time(lambda ranges=bool(i): solve(scene, ranges=ranges), spell),
        )
        for i, (name, error) in enumerate(zip(names, errors, strict=False))
    )
    return StaticsAccuracy(scene.name, result, exact, load, lever, answers)


def error_of_reactions(result: StaticsResult, exact: ExactReactions | None) -> float:
    """Of the worst support [N]; nan where nothing is known."""
    if exact is None or not result.reactions:
        return math.nan
    return max(
        float(np.linalg.norm(result.reactions[name].force - force))
        for name, force in exact.forces.items()
    )


def error_of_ranges(result: StaticsResult, exact: ExactReactions | None) -> float:
    """Of the worst end of a range of normal forces [N]; nan where nothing is known."""
    if exact is None or not exact.ranges or not result.reactions:
        return math.nan
    ends = ((result.ranges[name].along, span) for name, span in exact.ranges.items())
    return max(
        math.inf if found is None else float(np.abs(found - np.array(span)).max())
        for found, span in ends
    )


def cpu_time(act: Callable[[], object], spell: float) -> float:
    """CPU time of one call, the best of those that fit into the spell; one is made at least [s]."""
    best, total = math.inf, 0.0
    while True:
        start = time.process_time()
        act()
        spent = time.process_time() - start
        best, total = min(best, spent), total + max(spent, 1e-6)
        if total >= spell:
            return best
