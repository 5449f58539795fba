"""Balances of a run from its samples: energy against work, momentum against impulse.

Both are independent of the integrator: they use only what is logged. Their limit is the quadrature
over the samples, which is stated with them.

The work of contacts, impacts included, is among the samples; only the other powers are integrated.
Momentum is not balanced with contacts: their forces jump and strike between samples.

A block of samples may also be passed with a glance: work is summed up all the same, momentum is
then balanced over the stretches before and after it.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.sinks.contact_power import contacts_of, smooth_power
from rb_sim.sinks.frames import cross, norms
from rb_sim.watches.contact_events import Events
from rb_sim.watches.exchanged import ROUNDING, Exchanged, farthest
from rb_sim.watches.impulses import Impulses
from rb_sim.watches.loads import ends_of_tables, jumps_of_tables, may_work, unknown_force
from rb_sim.watches.quadrature import CheckedQuadrature

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Body, Scene

SPARSE = 16
"""Of so many samples a glance takes in one for the spin of bodies."""


class Balance(NamedTuple):
    """change - supply, which would be zero without error."""

    error: float
    """norm of the difference; with its sign for energy."""
    scale: float
    """what the error is to be compared with."""
    quadrature: float
    """change of the supply where only every other sample is used."""

    @property
    def relative(self) -> float | None:
        return abs(self.error) / self.scale if self.scale > 0.0 else None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "error": self.error,
            "relative": self.relative,
            "scale": self.scale,
            "quadrature": self.quadrature,
        }


def _given(body: Body) -> tuple[float, float, float]:
    """Momentum, angular momentum and kinetic energy of the velocities that the scene gives."""
    speed, spin = np.linalg.norm(body.linear_velocity), np.array(body.angular_velocity)
    own = body.inertia @ spin
    momentum = float(body.mass * speed)
    about = momentum * float(np.linalg.norm(body.position)) + float(np.linalg.norm(own))
    return momentum, about, 0.5 * float(momentum * speed + own @ spin)


class Ledger:
    """Follows the samples of one run.

    since: stamp at which the scene's own time was zero [s].
    """

    def __init__(self, scene: Scene, layout: SampleLayout, since: float = 0.0) -> None:
        self._scene, self._layout = scene, layout
        self.samples = 0
        self.worst_residual = 0.0
        """of all samples."""
        self.unknown_force = unknown_force(scene) or next(iter(contacts_of(scene)), "")
        """effect whose force the samples do not tell, or contact, for which momentum is not
        balanced; or ""."""
        self.has_work = False
        """whether forces without a potential, but for contacts, have done any so far, or may have
        where contacts change more often than samples are taken."""
        self.worked = 0.0
        """size of the power of these forces over time so far, by trapezoids of the samples [J]."""
        self._jumps = [since + t for t in jumps_of_tables(scene)]
        self._given_jumps = 0
        """of these, that are behind."""
        self._ends = [since + t for t in ends_of_tables(scene)]
        self._events = Events()
        self._work = CheckedQuadrature(1)
        self._impulses = Impulses(scene, layout)
        self._first: SampleBlock | None = None
        self._last: SampleBlock | None = None
        self._may_work = bool(contacts_of(scene)) or may_work(scene)
        self._may_work_smoothly = may_work(scene)
        given = np.array([_given(scene.bodies[name]) for name in layout.bodies])
        self._energies = Exchanged(float(given[:, 2].sum()))
        self._given = given[:, :2].sum(axis=0)
        self._momentum_noise = np.zeros(2)
        self._own = np.zeros(2)
        """the largest sums of the sizes of each body's momentum and angular momentum."""
        inertias = [scene.bodies[name].inertia for name in layout.bodies]
        self._moments = np.array([np.linalg.norm(inertia, 2) for inertia in inertias])
        self._masses = np.array([scene.bodies[name].mass for name in layout.bodies])

    def add(self, block: SampleBlock, breaks: Sequence[float] = ()) -> None:
        """The next samples. breaks: increasing, where commands change; a sample there is after."""
        if not len(block):
            return
        self._pass(block, len(block), block.worst_residual)
        self._energies.add(block)
        self._events.add(block.events)
        if self._may_work or block.power.any():
            self._integrate(block, smooth_power(block, self._scene, self._layout), breaks)
        self.look_back(block, breaks)

    def glance(self, block: SampleBlock, count: int, residual: float) -> float:
        """The next samples, without events: only what cannot be made up for later, `leave_out`
        before samples that are looked at again.

        count: of them; residual: the worst. Returns the energy balance at the end, about [J].
        """
        self._pass(block, count, residual)
        if self._may_work_smoothly:
            self._integrate(block, smooth_power(block, self._scene, self._layout))
        return self._energies.glance(block)

    def leave_out(self) -> None:
        """The momentum over the samples that follow is not balanced."""
        self._impulses.leave_out()

    def saw(self, block: SampleBlock) -> None:
        """Samples beside those of the run, of the same motion: how much energy it exchanges."""
        self._energies.saw(block)

    def look_back(self, block: SampleBlock, breaks: Sequence[float] = ()) -> None:
        """Balance the momentum over the last block as well, at which a glance was taken."""
        if not self.unknown_force:
            self._impulses.add(block, breaks)
            self._momentum_noise = self._roundings(block)

    def _pass(self, block: SampleBlock, count: int, residual: float) -> None:
        if self._first is None:
            self._first = block
        self._last = block
        self.samples += count
        self.worst_residual = max(self.worst_residual, residual)

    def _integrate(self, block: SampleBlock, power: Array, commands: Sequence[float] = ()) -> None:
        """Add the work of the block, piece by piece."""
        assert self._first is not None
        begin, end = float(self._first.t[0]), float(block.t[-1])
        if not self.has_work:
            # a body that sticks at every sample, and slips between, shows none
            hidden = self._may_work_smoothly and len(block.events) >= len(block)
            self.has_work = bool(power.any()) or hidden
        breaks = {event.t for event in block.events if event.t > begin}
        breaks.update(self._jumps_until(begin, end), commands)
        t, f = block.t, power
        if any(t[0] <= instant <= end for instant in self._ends):
            kept = ~np.isin(t, self._ends)
            kept[-1] = True
            t, f = t[kept], f[kept]
        self._work.add(t, f[:, None], sorted(breaks))
        self.worked, signed = self._work.by_trapezoids()[0].tolist()
        self._energies.work(self.worked, signed)

    def _jumps_until(self, begin: float, end: float) -> list[float]:
        """Instants up to `end`, not yet given, at which a table jumps or bends."""
        jumps, first = self._jumps, self._given_jumps
        if first == len(jumps) or jumps[first] > end:
            return []
        self._given_jumps = bisect_right(jumps, end, first)
        return [t for t in jumps[first : self._given_jumps] if t > begin]

    def _roundings(self, block: SampleBlock) -> Array:
        """Momentum and angular momentum that are not told from the roundings of what adds up to
        them, each body's own and the impulses of reactions up to the block's end, (2,)."""
        assert self._first is not None
        own, reach = norms(block.linear_velocity) * self._masses, farthest(block.position)
        noise = np.array([own.sum(axis=1).max(), (own * norms(block.position)).sum(axis=1).max()])
        about = norms(cross(block.position, block.linear_velocity)) * self._masses
        about = about + norms(block.angular_velocity) * self._moments
        self._own = np.maximum(self._own, [noise[0], about.sum(axis=1).max()])
        noise += self._given
        if block.reaction_force.shape[1]:
            force, reach = norms(block.reaction_force), max(reach, farthest(block.anchor))
            span = float(block.t[-1] - self._first.t[0])
            noise += force.sum(axis=1).max() * span * np.array([1.0, reach])
        return ROUNDING * noise

    @property
    def exchanged(self) -> float:
        """What an error of the energy is compared with [J]."""
        return self._energies.scale

    @property
    def rounding(self) -> float:
        """Energy that is no error but a rounding of the loads [J]."""
        return self._energies.rounding

    @property
    def at_rest(self) -> float:
        """Energy that is no error of what stands still [J]."""
        return self._energies.at_rest

    @property
    def end(self) -> float | None:
        """Time of the last sample [s]."""
        return None if self._last is None else float(self._last.t[-1])

    @property
    def initial(self) -> float:
        """Energy of the first sample [J]."""
        return 0.0 if self._first is None else float(self._first.energy[0])

    def energy(self) -> dict[str, Any] | None:
        """Energies, work of forces without potential and the balance [J]; None without samples."""
        if self._first is None or self._last is None:
            return None
        (work,), (doubt,) = self._work.finish()
        work += self._contact_work()
        initial, final = float(self._first.energy[0]), float(self._last.energy[-1])
        scale = self._energies.scale
        balance = Balance(final - initial - float(work), scale, float(doubt))
        return {"initial": initial, "final": final, "work": float(work), **balance.as_dict()}

    def first_beyond(self, block: SampleBlock, bound: float) -> int:
        """Index in the block just added at which the energy balance passes `bound`, about.

        Within a block the work is summed from its end backwards, by trapezoids with the correction
        dt^2 / 12 (f'(t0) - f'(t1)); what that changes is not held against the motion.
        """
        energy = self.energy()
        if energy is None:
            return 0
        power = smooth_power(block, self._scene, self._layout)
        dt = np.diff(block.t)
        slope = np.gradient(power, block.t) if len(block) > 2 else np.zeros(len(block))
        correction = dt * dt * (slope[:-1] - slope[1:]) / 12.0
        pieces = 0.5 * dt * (power[1:] + power[:-1]) + correction
        done = np.append(0.0, np.cumsum(pieces)) + block.contact_work - block.contact_work[-1]
        work = energy["work"] + done - done[-1]
        error = np.abs(block.energy - energy["initial"] - work) - np.abs(correction).sum()
        beyond = np.flatnonzero(~(error <= bound * energy["scale"]))
        return int(beyond[0]) if len(beyond) else len(block) - 1

    def contacts(self) -> dict[str, Any] | None:
        """Work [J] and events of the contacts; None if the scene has none."""
        if not self._layout.contacts:
            return None
        return {"work": self._contact_work(), **self._events.as_dict()}

    def _contact_work(self) -> float:
        """From the first sample to the last [J]."""
        if self._first is None or self._last is None:
            return 0.0
        return float(self._last.contact_work[-1] - self._first.contact_work[0])

    def momentum(self) -> dict[str, Any] | None:
        """Balances of linear and angular momentum (about the world origin), or None.

        share: of the samples over whose stretches they are drawn; 1 where none was left out.
        """
        if self._first is None or self._last is None or self.unknown_force:
            return None
        missed, impulse, doubt = self._impulses.finish()
        share = self._impulses.samples / self.samples
        balances = {}
        for k, name in enumerate(("linear", "angular")):
            part = slice(3 * k, 3 * k + 3)
            error = float(np.linalg.norm(missed[part]))
            # what bodies have of their own counts, too: the total of all may be zero
            scale = max(float(self._own[k]), float(np.linalg.norm(impulse[part])))
            scale = max(scale, float(self._impulses.largest[k]))
            scale = scale if scale > self._momentum_noise[k] else 0.0
            balance = Balance(error, scale, float(np.linalg.norm(doubt[part])))
            balances[name] = balance.as_dict() | {"share": share}
        return balances
