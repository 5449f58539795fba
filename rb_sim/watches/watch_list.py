"""All watches of one run: fed with the samples as they come, asked for findings at any time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rb_sim.engine.samples import ARRAYS
from rb_sim.watches.balance import Ledger
from rb_sim.watches.bounds import RESIDUAL, Effort
from rb_sim.watches.dead_point import Conditioning
from rb_sim.watches.finding import Finding
from rb_sim.watches.half_turn import HalfTurns
from rb_sim.watches.resolution import Resolution
from rb_sim.watches.violated import violated_constraint

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

CONTACT_RESIDUAL = 1e-6
"""In contact the residual also tells overlaps, which an event's location leaves behind."""

DOUBTS = 10.0
"""A balance is broken where its error passes its bound and this many times what leaving out every
other sample changes the integral by: else the samples, not the motion, are at fault."""

FEW_REJECTED = 100
"""Attempts; an adaptive method may grope this often without a word."""

ULPS = 16.0
"""A step or a sample period below this many units in the last place of the time is distorted."""

MOST_EVENTS_PER_SAMPLE = 50.0
CHATTER = 1000
"""Events, all in all and on average between two samples, that say: a contact chatters."""

MOST_CHANGES = 16
"""Changes of commands in one block above which no balance is drawn: a stream of commands leaves
pieces of a few samples, which say nothing and would cost more than the motion."""

ENOUGH = 1e-6
"""Relative change of an impulse above which a step of time stepping is told as unsolved."""

MOST_TURN = np.pi
"""Angle in one fixed step [rad] above which the step cannot tell a turn from the opposite one."""

ADVISED_TURN = 0.5
"""Angle in one step that methods of order 4 and above resolve [rad]."""

EPS = float(np.finfo(float).eps)


class WatchList:
    """Watches one run. scene, layout: of the simulation whose samples will come."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._scene, self._layout = scene, layout
        self.ledger = Ledger(scene, layout)
        self._resolution = Resolution()
        self._conditioning: Conditioning | None = None
        self._half_turns = HalfTurns(scene, layout)
        self._found: dict[str, Finding] = {}
        self._events: dict[str, int] = {}
        self._samples = 0
        self._command: np.ndarray | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What has passed its bound so far, each watch at most once, by time."""
        return tuple(sorted(self._found.values(), key=lambda finding: finding.t))

    def add(self, block: SampleBlock, effort: Effort) -> None:
        """The next samples. effort: of the run up to their end.

        Where a command changes, balances begin anew from the first sample that it has acted on.
        """
        first, jumps = 0, self._jumps(block)
        if len(jumps) > MOST_CHANGES:
            self._begin_anew()
            self._watch_block(block, effort)
            return
        for jump in jumps:
            self._add(_cut(block, first, jump), effort)
            self._begin_anew()
            first = jump
        self._add(_cut(block, first, len(block)) if first else block, effort)

    def _begin_anew(self) -> None:
        """Draw balances from the next sample on."""
        self.ledger, self._resolution = Ledger(self._scene, self._layout), Resolution()

    def _jumps(self, block: SampleBlock) -> list[int]:
        """Samples of the block that show another command than the one before."""
        if not self._layout.commanded or not len(block):
            return []
        flat = block.command.reshape(len(block), -1)
        before = flat[:1] if self._command is None else self._command
        self._command = flat[-1:].copy()
        return np.flatnonzero((flat != np.append(before, flat[:-1], 0)).any(axis=1)).tolist()

    def _add(self, block: SampleBlock, effort: Effort) -> None:
        if not len(block):
            return
        self.ledger.add(block)
        self._resolution.add(block)
        with np.errstate(all="ignore"):
            self._watch_energy(block, effort)
            self._watch_momentum(block, effort)
        self._watch_block(block, effort)

    def _watch_block(self, block: SampleBlock, effort: Effort) -> None:
        """What shows without a balance."""
        self._samples += len(block)
        with np.errstate(all="ignore"):
            self._watch_residual(block)
            self._watch_rank(block)
            self._watch_steps(block, effort)
            self._watch_turns(block, effort)
            self._watch_coarseness(effort)
            self._watch_springs(block)
            self._watch_events(block)
            self._watch_solver(block, effort)

    def _say(self, finding: Finding) -> None:
        self._found.setdefault(finding.watch, finding)

    def _watch_residual(self, block: SampleBlock) -> None:
        bound = CONTACT_RESIDUAL if self._layout.contacts else RESIDUAL
        beyond = np.flatnonzero(~(block.residual <= bound))
        if not len(beyond) or "residual" in self._found:
            return
        i = int(beyond[0])
        where = violated_constraint(self._scene, self._layout, block, i)
        advice = (
            "look for constraints that contradict each other from here on, or try method dopri853"
        )
        what = "violation of a constraint, relative to the scene's size or speed,"
        figure = float(np.nanmax(block.residual[i:])) if len(block.residual) else 0.0
        self._say(Finding("residual", float(block.t[i]), figure, bound, what, where, advice))

    def _watch_rank(self, block: SampleBlock) -> None:
        if "dead point" in self._found:
            return
        if self._conditioning is None:
            self._conditioning = Conditioning(self._scene, self._layout)
        self._conditioning.add(block)
        found = self._conditioning.found
        if found is None:
            return
        advice = (
            "there the laws of motion do not decide how it goes on: end the run before, or change "
            "lengths or drives so that it is not reached"
        )
        what = "the number of constraint lines that come to depend on others"
        self._say(Finding("dead point", found.t, 1.0, 0.0, what, found.constraint, advice))

    def _watch_energy(self, block: SampleBlock, effort: Effort) -> None:
        if "energy" in self._found:
            return
        energy = self.ledger.energy()
        if energy is None or energy["relative"] is None:
            return
        error, scale, doubt = abs(energy["error"]), energy["scale"], energy["quadrature"]
        if np.isfinite(error):
            if error <= effort.balance * scale + DOUBTS * doubt:
                return
            if self.ledger.has_work and not self._resolution.resolved:
                return
        i = self.ledger.first_beyond(block, effort.balance)
        self._say(
            Finding(
                "energy",
                float(block.t[i]),
                error / scale,
                effort.balance,
                "change of energy less work, relative to the energy exchanged",
                _liveliest(block, self._layout, i),
                effort.advice,
            )
        )

    def _watch_momentum(self, block: SampleBlock, effort: Effort) -> None:
        balances = self.ledger.momentum()
        if balances is None or not self._resolution.resolved:
            return
        for name, balance in balances.items():
            watch = "momentum" if name == "linear" else "angular momentum"
            error, scale, doubt = abs(balance["error"]), balance["scale"], balance["quadrature"]
            if watch in self._found or balance["relative"] is None:
                continue
            if np.isfinite(error) and error <= 10.0 * effort.balance * scale + DOUBTS * doubt:
                continue
            what = "change less impulse of what acts from outside, relative to the largest"
            last = len(block) - 1
            self._say(
                Finding(
                    watch,
                    float(block.t[last]),
                    error / scale,
                    10.0 * effort.balance,
                    what,
                    _liveliest(block, self._layout, last),
                    effort.advice,
                )
            )

    def _watch_steps(self, block: SampleBlock, effort: Effort) -> None:
        t = float(block.t[-1])
        if effort.rejected > max(FEW_REJECTED, effort.steps):
            share = effort.rejected / (effort.rejected + effort.steps)
            advice = (
                "the step is held down by a jump, a stiff part or a tolerance near round-off: try "
                "a looser tolerance, or an implicit method"
            )
            what = "share of attempted steps that were rejected"
            self._say(Finding("step control", t, share, 0.5, what, "", advice))
        shortest = 1.0 / self._scene.simulation.rate
        if effort.steps:
            shortest = min(shortest, t / effort.steps)
        if t > 0.0 and ULPS * EPS * t > shortest:
            advice = "times this large cannot tell such short steps apart: shift the start to 0"
            what = "resolution of the time over the step or sample period"
            self._say(Finding("time", t, EPS * t / shortest, 1.0 / ULPS, what, "", advice))

    def _watch_turns(self, block: SampleBlock, effort: Effort) -> None:
        """Whether a fixed step leaps over turns; balances are silent then, for samples do as well.

        An adaptive method compares two formulas in every step, and may take a constant spin in one.
        """
        if effort.step is None or effort.tolerance is not None:
            return
        step = effort.step
        if effort.steps > 1:  # events cut steps; the last one reaches beyond the last sample
            step = min(step, float(block.t[-1]) / (effort.steps - 1))
        spin = np.linalg.norm(block.angular_velocity, axis=2)
        beyond = np.argwhere(spin * step > MOST_TURN)
        if not len(beyond):
            return
        i, body = int(beyond[0, 0]), int(beyond[0, 1])
        fastest = float(spin[i, body])
        what = f"angle in one step of {step:.3g} s [rad]"
        advice = f"try a step below {ADVISED_TURN / fastest:.1e} s, or method dopri853"
        where = self._layout.bodies[body]
        t = float(block.t[i])
        self._say(Finding("turn", t, fastest * step, MOST_TURN, what, where, advice))

    def _watch_coarseness(self, effort: Effort) -> None:
        """Whether a fixed step follows the motion; symplectic ones keep the energy all the same."""
        share, t, body = effort.coarse
        bound = effort.coarse_bound
        if share > bound and effort.step is not None:
            what = f"what a step of {effort.step:.3g} s misses of a step's change of velocities"
            self._say(Finding("step", t, share, bound, what, body, effort.advice))

    def _watch_springs(self, block: SampleBlock) -> None:
        """Whether a torsion spring has passed half a turn."""
        jump = self._half_turns.first(block)
        if jump is not None:
            name, t, angle = jump
            what = "angle of a torsion spring [rad]"
            advice = "it counts from -pi again, so that the torque has jumped to the other sign"
            self._say(Finding("half turn", t, angle, np.pi, what, name, advice))

    def _watch_events(self, block: SampleBlock) -> None:
        for event in block.events:
            self._events[event.contact] = self._events.get(event.contact, 0) + 1
        if not self._events:
            return
        name, count = max(self._events.items(), key=lambda item: item[1])
        mean = count / self._samples
        if count > CHATTER and mean > MOST_EVENTS_PER_SAMPLE:
            advice = "the contact chatters: try method time_stepping"
            what = "number of events between two samples"
            t = float(block.t[-1])
            self._say(Finding("events", t, mean, MOST_EVENTS_PER_SAMPLE, what, name, advice))

    def _watch_solver(self, block: SampleBlock, effort: Effort) -> None:
        """Whether every step of a heap solved its friction problem within its bound of work."""
        if effort.unsolved:
            where = f"{effort.unsolved} of {effort.steps} steps"
            what = "residual of the friction problem, relative to the largest impulse,"
            advice = "the contact forces of these steps are that rough: try a smaller step"
            t, worst = float(block.t[-1]), effort.solver_residual
            self._say(Finding("solver", t, worst, ENOUGH, what, where, advice))
        if effort.turned:
            where = f"{effort.turned} of {effort.steps} steps"
            what = "share of the steps in which a point of contact ran around its body"
            advice = "each struck anew, which takes too much energy: try a much smaller step"
            t, share = float(block.t[-1]), effort.turned / max(1, effort.steps)
            self._say(Finding("running contact", t, share, 0.0, what, where, advice))
        if effort.paradox:
            where = f"{effort.paradox} of {effort.steps} steps"
            what = "share of the steps with Painleve's paradox, where several impulses fit,"
            advice = "other branches of the motion are possible: an event-driven method names them"
            t, share = float(block.t[-1]), effort.paradox / max(1, effort.steps)
            self._say(Finding("paradox", t, share, 0.0, what, where, advice))


def _cut(block: SampleBlock, first: int, end: int) -> SampleBlock:
    """Samples first to end - 1; events stay with the piece that ends the block."""
    last = end == len(block)
    part = {name: getattr(block, name)[first:end] for name in ARRAYS}
    return replace(block, **part, events=block.events if last else ())


def _liveliest(block: SampleBlock, layout: SampleLayout, i: int) -> str:
    """The body that moves most at sample i."""
    speed = np.linalg.norm(block.linear_velocity[i], axis=1)
    spin = np.linalg.norm(block.angular_velocity[i], axis=1)
    moved = np.nan_to_num(speed + spin, nan=np.inf)
    return layout.bodies[int(moved.argmax())]
