"""Which fixed step would do, where one did not: found by running the scene with others."""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np

from rb_sim.contact.motion import motion_of
from rb_sim.engine.samples import Array, block_of, empty_block
from rb_sim.errors import RbSimError
from rb_sim.scene.compiled import Compiled

MOST_STEPS = 200_000
"""Steps of all trials together, divided by the number of bodies."""

MOST_TIME = 1.0
"""CPU time of all trials together [s]: nobody waits long for the word that a run has failed."""

PIECE = 64
"""Steps of a trial between two looks at the clock."""

MOST_TRIALS = 16
"""Halvings of the step."""

LARGER = 3
"""Doublings that are tried where no smaller step does."""

ALIKE = 0.5
"""Difference of the total energies at the end, relative to the largest energy there, up to which
two steps tell the same motion: one that is still finite but unstable, or that the method damps to
rest, is not to be recommended."""

CLOSE = 1e-3
"""Likewise of a step that is named rather than a larger one that is only ALIKE; its angular
momentum differs by no more than ten times as much."""


def advice(compiled: Compiled, method: Any, failed_at: float, end: float) -> str:
    """A phrase about the step: one that does, or that none does of those tried.

    method: with the fixed `step` [s] that failed at `failed_at` [s]; end: of the run [s]. A step
    does where it and its half get to the end and tell the same energy there: CLOSE if one is found,
    else ALIKE. Trials begin at the scene's initial state; a run too long for them is tried to a
    little past the failure.
    """
    most = MOST_STEPS // max(1, len(compiled.layout.bodies))
    whole = end / method.step * 256 <= most
    horizon = end if whole else min(end, 1.5 * failed_at + 10.0 * method.step)
    where = "to the end" if whole or horizon == end else f"to t = {horizon:.3g} s at least"
    smallest, trials, left = method.step, _Trials(compiled, method, horizon), most
    rough = ""
    try:
        for k in range(1, MOST_TRIALS + 1):
            step = method.step / 2**k
            left -= 2 * math.ceil(horizon / step)
            if left < 0:
                break
            if trials.does(step, CLOSE):
                return f"with step {step:g} s it runs {where}"
            if not rough and trials.does(step):
                rough = f"with step {step:g} s it runs {where}, roughly"
            smallest = step
        if rough:
            return rough
        for k in range(1, LARGER + 1):
            step = method.step * 2**k
            if trials.does(step):
                return f"smaller steps fail, too; with step {step:g} s it runs {where}"
    except _OutOfTimeError:
        if rough:
            return rough
    tried = "" if smallest == method.step else f"steps down to {smallest:g} s fail, too; "
    return f"{tried}use method dopri853 with a tolerance"


class _OutOfTimeError(Exception):
    """The trials have taken MOST_TIME."""


class _End(NamedTuple):
    """What a run shows at its end."""

    energies: tuple[float, float]
    """kinetic and potential [J]."""
    spin: Array
    """angular momentum about the world's origin [N m s], (3,)."""


class _Trials:
    """Ends of runs, each step run once; None where it does not get there."""

    def __init__(self, compiled: Compiled, method: Any, horizon: float) -> None:
        self._compiled, self._method, self._horizon = compiled, method, horizon
        self._found: dict[float, _End | None] = {}
        self._end = time.process_time() + MOST_TIME

    def _look(self) -> None:
        """Raise _OutOfTimeError if the trials have taken their time."""
        if time.process_time() > self._end:
            raise _OutOfTimeError

    def does(self, step: float, alike: float = ALIKE) -> bool:
        """Whether the step and its half tell the same finite motion."""
        a, b = self._at_end(step), self._at_end(0.5 * step)
        if a is None or b is None:
            return False
        energies = (*a.energies, *b.energies)
        if abs(sum(a.energies) - sum(b.energies)) > alike * max(map(abs, energies)):
            return False
        spins = np.linalg.norm([a.spin, b.spin, a.spin - b.spin], axis=1)
        return alike == ALIKE or bool(spins[2] <= 10.0 * alike * max(spins[0], spins[1]))

    def _at_end(self, step: float) -> _End | None:
        if step not in self._found:
            self._found[step] = self._run(step)
        return self._found[step]

    def _run(self, step: float) -> _End | None:
        layout = self._compiled.layout
        try:
            motion = motion_of(self._compiled, self._method._replace(step=step))
            motion.watch = self._look
            for piece in range(1, math.ceil(self._horizon / (PIECE * step))):
                motion.run_to([piece * PIECE * step])
                self._look()
            motion.run_to([self._horizon])
            row = motion.sample()
        except (RbSimError, ArithmeticError):
            return None
        block = block_of(row[:, 0], row, layout, empty_block(1, layout).command)
        energies = float(block.kinetic_energy[0]), float(block.potential_energy[0])
        return _End(energies, block.angular_momentum[0]) if np.isfinite(energies).all() else None
