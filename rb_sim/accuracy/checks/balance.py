# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Balances of a run from its samples: energy against work, momentum against impulse.

They use only logged values, independent of the integrator, and are limited by the quadrature over
the samples, whose uncertainty is given with them. The work of contacts, including impacts, is
logged; only other powers are integrated. Momentum is not balanced with contacts, whose forces jump
between samples.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.accuracy.checks.sample_integrals import MOST, Quadrature, Resolution, integrals
from rb_sim.base.rounding import SOLVED
from rb_sim.io.contact_power import contacts_of, smooth_power
from rb_sim.numerics.rotations import cross, norms, rotate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rb_sim.accuracy.checks.sample_integrals import Flags
    from rb_sim.mechanics.samples import Array, ContactEvent, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Body, Scene


FIRST_EVENTS = 10
"""Number of events that a summary lists."""


class Events:
    """Counts and impulses of the contact events of a run, in bounded memory."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._first: list[ContactEvent] = []
        self._impulses: dict[str, Array] = {}

    def add(self, events: tuple[ContactEvent, ...]) -> None:
        """Add events."""
        self._first += events[: FIRST_EVENTS - len(self._first)]
        for event in events:
            self._counts[event.kind] = self._counts.get(event.kind, 0) + 1
            if any(event.impulse):
                before = self._impulses.get(event.contact, np.zeros(3))
                self._impulses[event.contact] = before + event.impulse

    def as_dict(self) -> dict[str, Any]:
        """For JSON: events by kind, the first of them, and the sum of impulses [N s] by contact."""
        return {
            "events": dict(self._counts),
            "first_events": [
                {"t": e.t, "contact": e.contact, "kind": e.kind, "impulse": list(e.impulse)}
                for e in self._first
            ],
            "impulses": {name: sum_.tolist() for name, sum_ in self._impulses.items()},
        }


# The loads of a scene: which do work, jump, or are not among the samples.


def jumps_of_tables(scene: Scene, since: float) -> list[float]:
    """Instants at which tabulated wrenches jump or bend, increasing; since: start of tables [s].

    A sample at the end of a table has a wrench that acts neither before nor after, so that the next
    double follows as a second instant.
    """
    tables: list[Any] = [getattr(effect, "times", ()) for effect in scene.effects.values()]
    jumps = {since + float(t) for table in tables for t in table}
    return sorted(jumps | {np.nextafter(since + table[-1], np.inf) for table in tables if table})


QUIET = ("gravity", "spring", "torsion_spring")
"""Effects with a potential, except for their damping."""


def may_work(scene: Scene) -> bool:
    """Whether the scene has an effect without potential, or a driven joint."""
    return bool(_effects_at_work(scene)) or _joints_move(scene)


def bodies_at_work(scene: Scene, layout: SampleLayout) -> list[int]:
    """Indices of the bodies on which loads without a potential do work, without contacts: all of
    them with driven joints, whose reactions do work."""
    effects = _effects_at_work(scene)
    acted_on = {getattr(effect, end, None) for effect in effects for end in ("body", "parent")}
    every = _joints_move(scene)
    return [i for i, name in enumerate(layout.bodies) if every or name in acted_on]


def _effects_at_work(scene: Scene) -> list[Any]:
    effects: list[Any] = list(scene.effects.values())
    return [e for e in effects if e.type not in QUIET or getattr(e, "damping", 0.0)]


def _joints_move(scene: Scene) -> bool:
    constraints: list[Any] = list(scene.constraints.values())
    return any(getattr(spec, "rate", 0.0) for spec in constraints)


def contacts_may_give(scene: Scene) -> bool:
    """Whether contacts may do positive work by their laws: driven or compliant supports."""
    return any(
        getattr(spec, "motion", None) or getattr(spec, "compliance", None) or spec.type == "string"
        for spec in contacts_of(scene).values()
    )


def unknown_force(scene: Scene) -> str:
    """Name of the first effect with an external force that is not among the samples; or ""."""
    unknown = (n for n, e in scene.effects.items() if getattr(e, "parent", None) is None)
    return next((name for name in unknown if not is_known(scene.effects[name])), "")


def is_known(effect: Any) -> bool:
    """Whether the wrench of an effect follows from samples and scene."""
    steady = effect.type == "wrench" and effect.sine_force == effect.sine_torque == (0.0,) * 3
    return steady or effect.type in ("gravity", "commanded_wrench")


# The energy that a run exchanges, which is the scale of its energy error.


ROUNDING = 1e-13
"""Kinetic energy, relative to the energy of the loads, up to which a body counts as at rest."""


class Exchanged:
    """Scale of the energy error: initial kinetic energy, largest fall of the potential, and the
    absolute works of loads without a potential. Energy that errors create is in none of these."""

    def __init__(self, given: float = 0.0, contacts_give: bool = True) -> None:
        """given: kinetic energy of the scene's velocities before they are projected onto the
        constraints [J]; the rest after projection may be rounding. contacts_give: whether contacts
        may do positive work by their laws."""
        self._contacts_give = contacts_give
        self._given = ROUNDING**2 * given
        self._kinetic = self._fall = self._contacts = self._noise = 0.0
        self._loads = 0.0
        """weights and reactions times lengths at the start [J]."""
        self._potential: float | None = None

    def add(self, block: SampleBlock) -> None:
        """Add samples."""
        if self._potential is None:
            self._potential = float(block.potential_energy[0])
            self._kinetic = float(block.kinetic_energy[0])
            self._noise = self._roundings(block)
        self._fall = max(self._fall, self._potential - float(block.potential_energy.min()))
        work = block.contact_work
        exchanged = np.abs(work) if self._contacts_give else -work
        self._contacts = max(self._contacts, float(exchanged.max()))

    def _roundings(self, block: SampleBlock) -> float:
        """Energy by which the initial loads change it if their points are rounded [J]."""
        force = float(np.linalg.norm(block.reaction_force[0], axis=1).sum())
        reach = float(np.abs(block.position[0]).max())
        self._loads = abs(float(block.potential_energy[0])) + force * reach
        return self._given + ROUNDING * self._loads

    @property
    def at_rest(self) -> float:
        """Energy below which a difference is no error of a body at rest [J]: loads times SOLVED of
        the lengths, to which solvers determine positions, and the rest of projected velocities."""
        return self._given + SOLVED * self._loads

    def scale(self, work: float) -> float:
        """The scale [J]; 0 if the motion is only rounding. work: sum of the absolute works of loads
        without a potential [J]."""
        found = self._kinetic + self._fall + work + self._contacts
        return found if found > self._noise else 0.0


def farthest(points: Array) -> float:
    """The largest coordinate."""
    return float(max(points.max(), -points.min()))


# The external wrench, whose impulse is compared with the change of momentum.


class Load(NamedTuple):
    """A wrench on a body, world axes."""

    body: int
    parent: int | None
    """the body on which it acts in the opposite direction; None: the world."""
    force: Array
    """[N], shape (n, 3) or (3,)."""
    torque: Array
    """[N m], about the point."""
    point: Array
    """point of application, from the world's origin [m]."""


def loads(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Iterator[Load]:
    """All wrenches in the samples: of reactions, and of effects whose force is known."""
    index, none = layout.bodies.index, np.zeros(3)
    for k, name in enumerate(layout.reactions):
        if "/" in name:
            continue  # part of a total
        parent = getattr(scene.constraints[name], "parent", None)
        parent, body = None if parent is None else index(parent), index(layout.reaction_bodies[k])
        force, torque = block.reaction_force[:, k], block.reaction_torque[:, k]
        yield Load(body, parent, force, torque, block.anchor[:, k])
    effects: list[Any] = [effect for effect in scene.effects.values() if is_known(effect)]
    for effect in effects:
        if effect.type == "gravity":
            for body in map(index, effect.bodies or layout.bodies):
                weight = scene.bodies[layout.bodies[body]].mass * np.array(effect.acceleration)
                yield Load(body, None, weight, none, block.position[:, body])
            continue
        yield _wrench(block, scene, layout, effect)


def _wrench(block: SampleBlock, scene: Scene, layout: SampleLayout, effect: Any) -> Load:
    """A prescribed or commanded wrench at the samples."""
    body, n = layout.bodies.index(effect.body), len(block)
    if effect.type == "commanded_wrench":
        force, torque = np.split(block.command[:, layout.commanded.index(effect.body)], 2, 1)
    elif effect.type == "wrench_table":
        force, torque = (
            _tabulated(effect, rows, block.t) for rows in (effect.forces, effect.torques)
        )
    else:
        sine = np.sin(effect.angular_frequency * block.t + effect.phase)[:, None]
        force = np.tile(effect.force, (n, 1)) + sine * effect.sine_force
        torque = np.tile(effect.torque, (n, 1)) + sine * effect.sine_torque
    if getattr(effect, "frame", "world") == "body":
        q = block.orientation[:, body]
        force, torque = rotate(q, force), rotate(q, torque)
    point_B = np.array(getattr(effect, "point_B", np.zeros(3)))
    return Load(body, None, force, torque, _point(block, scene, layout, effect.body, point_B))


def _tabulated(effect: Any, rows: Any, t: Array) -> Array:
    """Forces or torques of a table at the times (n,), (n, 3)."""
    times, values = np.array(effect.times), np.array(rows or np.zeros((len(effect.times), 3)))
    if effect.interpolation == "hold":
        found = values[np.searchsorted(times, t, side="right").clip(1) - 1]
    else:
        found = np.stack([np.interp(t, times, column) for column in values.T], axis=1)
    acts = (t >= times[0]) & (t <= times[-1])
    return np.where(acts[:, None], found, 0.0)


WRENCHES = ("wrench", "wrench_table", "commanded_wrench")
"""Effects whose wrench follows from time, command and attitude."""


def gross_power(block: SampleBlock, scene: Scene, layout: SampleLayout, power: Array) -> Array:
    """Sum of the absolute powers of each prescribed wrench and of the other loads together [W],
    (n,); power: the sum with signs. A wrench and a drag that balance each other exchange energy
    although their sum is zero."""
    gross, rest = np.zeros(len(block)), power
    for effect in scene.effects.values():
        if effect.type in WRENCHES:
            load = _wrench(block, scene, layout, effect)
            spin = rotate(block.orientation[:, load.body], block.angular_velocity[:, load.body])
            arm = load.point - block.position[:, load.body]
            speed = block.linear_velocity[:, load.body] + cross(spin, arm)
            own = np.sum(load.force * speed + load.torque * spin, axis=1)
            gross, rest = gross + np.abs(own), rest - own
    return gross + np.abs(rest)


def external_wrench(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Array:
    """Sum of the external [force, torque about the world origin], world axes, (n, 6)."""
    total = np.zeros((len(block), 6))
    for load in loads(block, scene, layout):
        if load.parent is None:
            total[:, :3] += load.force
            total[:, 3:] += load.torque + cross(load.point, load.force)
    return total


def wrenches_on_bodies(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Array:
    """Sum of the [force, torque about the centre of mass] on each of N bodies, world axes,
    shape (n, N, 6)."""
    total = np.zeros((len(block), len(layout.bodies), 6))
    for load in loads(block, scene, layout):
        for i, sign in ((load.body, 1.0), (load.parent, -1.0)):
            if i is not None:
                moment = load.torque + cross(load.point - block.position[:, i], load.force)
                total[:, i] += sign * np.hstack([np.broadcast_to(load.force, moment.shape), moment])
    return total


def _point(
    block: SampleBlock, scene: Scene, layout: SampleLayout, body: str, point_B: Array
) -> Array:
    """World position of a point given from the body's origin in body axes, (n, 3)."""
    i = layout.bodies.index(body)
    arm = point_B - np.array(scene.bodies[body].center_of_mass)
    return block.position[:, i] + rotate(block.orientation[:, i], np.tile(arm, (len(block), 1)))


class Balance(NamedTuple):
    """The change of a quantity compared with its supply (work or impulse)."""

    error: float
    """change - supply, zero without error."""
    scale: float
    """that it is compared with; 0 if nothing was exchanged."""
    uncertainty: float
    """of the supply, as an integral over the samples."""
    unsure: float
    """difference between change and supply in the intervals that are left out."""
    known: bool
    """whether the samples resolve most of the motion."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        relative = abs(self.error) / self.scale if self.scale > 0.0 else None
        uncertainty = self.uncertainty + self.unsure
        return {
            "error": self.error, "relative": relative, "scale": self.scale,
            "quadrature": uncertainty,
        }  # fmt: skip


def _given(body: Body) -> tuple[float, float, float]:
    """Momentum, angular momentum and kinetic energy of the initial velocities in the scene."""
    speed, spin = np.linalg.norm(body.linear_velocity), np.array(body.angular_velocity)
    own = body.inertia @ spin
    momentum = float(body.mass * speed)
    about = momentum * float(np.linalg.norm(body.position)) + float(np.linalg.norm(own))
    return momentum, about, 0.5 * float(momentum * speed + own @ spin)


class Account:
    """Change and supply of a conserved quantity over samples, in bounded memory.

    Intervals that the samples do not resolve are left out: there the supply is set to the change,
    and its difference from the sampled supply is kept apart.
    """

    def __init__(self, columns: int) -> None:
        self._rule = Quadrature(columns)
        self._first, self._unsure = np.zeros((2, columns))
        self._left_out = np.zeros((2, columns))
        """sums of the changes in these intervals, and of their absolute values."""
        self._end: tuple[Array, ...] = ()
        """time, quantity and supply rate at the last sample."""

    def add(self, t: Array, kept: Array, supply: Array, left_out: Flags) -> None:
        """Add samples. t: (n,); kept: the quantity, supply: its rate, (n, columns); left_out:
        whether the interval up to each sample is left out, (n,)."""
        self._rule.add(t, supply, left_out)
        rows = t[:, None], kept, supply
        ends = self._end or tuple(row[:1] for row in rows)
        if not self._end:
            self._first = kept[0]
        self._end = tuple(row[-1:].copy() for row in rows)
        if left_out.any():
            t, kept, supply = (np.append(*pair, 0) for pair in zip(ends, rows, strict=True))
            change = np.diff(kept, axis=0)[left_out]
            trapezoid = 0.5 * (np.diff(t, axis=0) * (supply[1:] + supply[:-1]))[left_out]
            self._left_out += [change.sum(axis=0), np.abs(change).sum(axis=0)]
            self._unsure += np.abs(change - trapezoid).sum(axis=0)

    def total(self) -> tuple[Array, Array, Array, Array, Array]:
        """Change minus supply, uncertainty of the supply, difference in the intervals left out,
        supply, and its absolute sum."""
        supplied, uncertainty, size = self._rule.total()
        supplied, size = supplied + self._left_out[0], size + self._left_out[1]
        error = self._end[1][0] - self._first - supplied
        return error, uncertainty, self._unsure, supplied, size

    def in_stretches(self) -> tuple[Array, Array]:
        """Change and supply without the intervals that are left out."""
        error, _, _, supplied, _ = self.total()
        supply = supplied - self._left_out[0]
        return error + supply, supply


class Ledger:
    """The energy and momentum balances of one run.

    since: stamp at which the scene's own time was zero [s].

    Energy without the work of contacts changes by the power of loads without a potential, momentum
    by the external wrench. Intervals are left out in which a load jumps, or which do not resolve
    the motion of the bodies that the load acts on.
    """

    def __init__(self, scene: Scene, layout: SampleLayout, since: float = 0.0) -> None:
        self._scene, self._layout = scene, layout
        self.samples = 0
        self.worst_residual = 0.0
        """largest residual of all samples."""
        self.unknown_force = unknown_force(scene) or next(iter(contacts_of(scene)), "")
        """name of an effect or contact whose impulse is not among the samples, so that momentum is
        not balanced; or ""."""
        self._may_work = may_work(scene)
        self._at_work = bodies_at_work(scene, layout)
        """bodies that the samples must resolve for the energy balance."""
        self._pushed = not self.unknown_force and bool(scene.effects or scene.constraints)
        """whether there is an external load."""
        self._has_work = False
        """whether loads without a potential, other than contacts, may have done work so far."""
        self._jumps = np.array(jumps_of_tables(scene, since))
        """instants after the last sample at which a load jumps or bends."""
        self._events = Events()
        self._work, self._impulse = Account(1), Account(6)
        self._gross = Quadrature(1)
        """integral of `gross_power`."""
        self._resolution, self._missed = Resolution(), np.zeros(2)
        """... and the numbers of unresolved intervals, for energy and momenta."""
        self._first: SampleBlock | None = None
        self._last: SampleBlock | None = None
        given = np.array([_given(scene.bodies[name]) for name in layout.bodies])
        self._contacts_give = contacts_may_give(scene)
        self._energies = Exchanged(float(given[:, 2].sum()), self._contacts_give)
        self._least_contact_work, self._gained = math.inf, 0.0
        self._given = given[:, :2].sum(axis=0)
        self._momentum_noise = np.zeros(2)
        self._largest = np.zeros(2)
        """largest momentum and angular momentum, of the total and summed over the bodies."""
        inertias = [scene.bodies[name].inertia for name in layout.bodies]
        self._moments = np.array([np.linalg.norm(inertia, 2) for inertia in inertias])
        self._masses = np.array([scene.bodies[name].mass for name in layout.bodies])

    def add(self, block: SampleBlock, breaks: Sequence[float] = ()) -> None:
        """Add samples. breaks: times at which commands change, increasing [s]; a sample at such a
        time has the new command."""
        if not len(block):
            return
        self._last = block
        if self._first is None:
            self._first = block
        self.samples += len(block)
        self.worst_residual = max(self.worst_residual, block.worst_residual)
        self._energies.add(block)
        self._events.add(block.events)
        if not self._contacts_give:
            self._gained = max(self._gained, float(self.gains(block).max()))
            self._least_contact_work = min(self._least_contact_work, block.contact_work.min())
        power = smooth_power(block, self._scene, self._layout)
        missed, jumped = np.zeros((2, len(block)), dtype=bool), self._jumped(block, breaks)
        # samples show no power of a pulse between them, or of a slip that ends before the next one
        hidden = self._may_work and bool(jumped.any())
        gross = gross_power(block, self._scene, self._layout, power)
        self._gross.add(block.t, gross[:, None])
        self._has_work = self._has_work or hidden or bool(gross.any())
        if self._has_work or self._pushed:
            unresolved = self._resolution.missed(block)
            missed[0] = unresolved[:, self._at_work].any(axis=1) & self._has_work
            missed[1] = unresolved.any(axis=1)
            self._missed += missed.sum(axis=1)
        energy = (block.energy - block.contact_work)[:, None]
        self._work.add(block.t, energy, power[:, None], missed[0] | (jumped & self._has_work))
        if self.unknown_force:
            return
        self._momentum_noise = self._roundings(block)
        momenta = np.concatenate([block.momentum, block.angular_momentum], axis=1)
        wrench = np.zeros_like(momenta)
        if self._pushed:
            wrench = external_wrench(block, self._scene, self._layout)
        self._impulse.add(block.t, momenta, wrench, missed[1] | jumped)

    def _jumped(self, block: SampleBlock, commands: Sequence[float]) -> Flags:
        """Whether a load may jump in the interval up to each sample, (n,)."""
        assert self._first is not None
        begin, end = self._first.t[0], block.t[-1]
        t = np.concatenate([self._jumps, [event.t for event in block.events], commands])
        self._jumps, jumped = t[t > end], np.zeros(len(block), dtype=bool)
        jumped[np.searchsorted(block.t, t[(t > begin) & (t <= end)])] = True
        return jumped

    def _roundings(self, block: SampleBlock) -> Array:
        """Rounding errors of momentum and angular momentum, from their sums over the bodies and
        from the impulses of reactions up to the block's end, (2,)."""
        assert self._first is not None
        own, reach = norms(block.linear_velocity) * self._masses, farthest(block.position)
        noise = np.array([own.sum(axis=1).max(), (own * norms(block.position)).sum(axis=1).max()])
        about = norms(cross(block.position, block.linear_velocity)) * self._masses
        about = about + norms(block.angular_velocity) * self._moments
        total = norms(block.momentum).max(), norms(block.angular_momentum).max()
        sizes = [noise[0], about.sum(axis=1).max()]
        # sums over the bodies count as well, since the total may be zero
        self._largest = np.maximum(self._largest, np.maximum(sizes, total))
        noise += self._given
        if block.reaction_force.shape[1]:
            force, reach = norms(block.reaction_force), max(reach, farthest(block.anchor))
            span = float(block.t[-1] - self._first.t[0])
            noise += force.sum(axis=1).max() * span * np.array([1.0, reach])
        return ROUNDING * noise

    @property
    def exchanged(self) -> float:
        """The scale of the energy error [J]."""
        if self._last is None:
            return 0.0
        return self._energies.scale(self._exchanged_by_loads())

    def _exchanged_by_loads(self) -> float:
        """Sum of the energies that loads without a potential gave and took [J]."""
        return max(float(self._work.total()[4][0]), float(self._gross.total()[2, 0]))

    @property
    def gained(self) -> float:
        """Largest energy gained in contacts [J], which by their laws give none; 0 if they may do
        positive work."""
        return self._gained

    def gains(self, block: SampleBlock) -> Array:
        """Energy gained in contacts up to each sample of the block [J], (n,)."""
        work = block.contact_work
        gains: Array = work - np.minimum(self._least_contact_work, np.minimum.accumulate(work))
        return gains

    @property
    def at_rest(self) -> float:
        """As Exchanged.at_rest [J]."""
        return self._energies.at_rest

    @property
    def end(self) -> float | None:
        """Time of the last sample [s]."""
        return None if self._last is None else float(self._last.t[-1])

    def energy(self) -> dict[str, Any] | None:
        """Energies, work of loads without a potential, and balance [J]; None without samples."""
        if self._first is None or self._last is None:
            return None
        work = float(self._work.total()[3][0]) + self._contact_work()
        initial, final = float(self._first.energy[0]), float(self._last.energy[-1])
        found = self.balances()["energy"].as_dict()
        return {"initial": initial, "final": final, "work": work, **found}

    def momentum(self) -> dict[str, Any] | None:
        """Balances of linear and angular momentum (about the world origin), or None."""
        found = self.balances()
        if "momentum" not in found:
            return None
        names = ("linear", "momentum"), ("angular", "angular momentum")
        return {key: found[name].as_dict() for key, name in names}

    def first_beyond(self, block: SampleBlock, bound: float) -> int:
        """Approximate index in the block just added at which the energy balance passes `bound`."""
        energy = self.energy()
        if energy is None:
            return 0
        power = smooth_power(block, self._scene, self._layout)[:, None]
        pieces, uncertainty, _ = integrals(block.t, power)[:, :, 0]
        done = np.append(0.0, np.cumsum(pieces)) + block.contact_work
        error = block.energy - energy["initial"] - energy["work"] - (done - done[-1])
        beyond = np.flatnonzero(~(np.abs(error) - uncertainty.sum() <= bound * energy["scale"]))
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

    def balances(self) -> dict[str, Balance]:
        """The balances by the names of their checks."""
        if self._last is None:
            return {}
        error, uncertainty, unsure, *_ = (float(row[0]) for row in self._work.total())
        known = (self._missed <= MOST * (self.samples - 1)).tolist()
        found = {"energy": Balance(error, self.exchanged, uncertainty, unsure, known[0])}
        if self.unknown_force:
            return found
        *rows, impulse, _ = self._impulse.total()
        for k, name in enumerate(("momentum", "angular momentum")):
            part = slice(3 * k, 3 * k + 3)
            scale = max(float(self._largest[k]), float(np.linalg.norm(impulse[part])))
            scale = scale if scale > self._momentum_noise[k] else 0.0
            error, uncertainty, unsure = (float(np.linalg.norm(row[part])) for row in rows)
            found[name] = Balance(error, scale, uncertainty, unsure, known[1])
        return found
