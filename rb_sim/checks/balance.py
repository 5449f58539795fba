# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Balances of a run from its samples: energy against work, momentum against impulse.

Both are independent of the integrator: they use only what is logged. Their limit is the quadrature
over the samples, which is stated with them.

The work of contacts, impacts included, is among the samples; only the other powers are integrated.
Momentum is not balanced with contacts: their forces jump and strike between samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.rounding import SOLVED
from rb_sim.checks.sample_integrals import MOST, Quadrature, Resolution, integrals
from rb_sim.io.contact_power import contacts_of, smooth_power
from rb_sim.numerics.rotations import cross, norms, rotate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rb_sim.checks.sample_integrals import Flags
    from rb_sim.mechanics.samples import Array, ContactEvent, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Body, Scene


# What happened to the contacts of a run, counted and summed up.


FIRST_EVENTS = 10
"""Events that a summary lists."""


class Events:
    """What happened to the contacts of a run, in bounded memory."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._first: list[ContactEvent] = []
        self._impulses: dict[str, Array] = {}

    def add(self, events: tuple[ContactEvent, ...]) -> None:
        """The next events."""
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


# What a scene says of its loads before it runs: whether they work, jump or stay unknown.


def jumps_of_tables(scene: Scene, since: float) -> list[float]:
    """Instants at which tabulated wrenches jump or bend, increasing [s]; since: where tables begin.

    At the end of a table a sample shows a wrench that acts neither before nor after, so that a
    second instant follows at once.
    """
    tables: list[Any] = [getattr(effect, "times", ()) for effect in scene.effects.values()]
    jumps = {since + float(t) for table in tables for t in table}
    return sorted(jumps | {np.nextafter(since + table[-1], np.inf) for table in tables if table})


QUIET = ("gravity", "spring", "torsion_spring")
"""Effects with a potential, but for their damping."""


def may_work(scene: Scene) -> bool:
    """Whether an effect without potential, or a joint that moves, is in the scene."""
    return bool(_effects_at_work(scene)) or _joints_move(scene)


def bodies_at_work(scene: Scene, layout: SampleLayout) -> list[int]:
    """Bodies whose motion tells the power of all loads without a potential: all of them where
    joints move, since their reactions work as well. Those of contacts are separate."""
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


def unknown_force(scene: Scene) -> str:
    """Name of the first effect that exerts an outer force that the samples do not contain; or
    ""."""
    unknown = (n for n, e in scene.effects.items() if getattr(e, "parent", None) is None)
    return next((name for name in unknown if not tells_force(scene.effects[name])), "")


def tells_force(effect: Any) -> bool:
    """Whether samples and scene contain the wrench of an effect."""
    steady = effect.type == "wrench" and effect.sine_force == effect.sine_torque == (0.0,) * 3
    return steady or effect.type in ("gravity", "commanded_wrench")


# The energy that a run exchanges, with which the error of its balance is compared.


ROUNDING = 1e-13
"""Kinetic energy, relative to the energy of the loads, up to which a body counts as at rest."""


class Exchanged:
    """Scale of the energies: what the scene started with or has exchanged by right.

    The kinetic energy at the start, the fall of the potential from there, and the work of what has
    none. What an error makes, a spring that gains without end, is in none of the three.
    """

    def __init__(self, given: float = 0.0) -> None:
        """given: kinetic energy of the velocities that the scene gives, before constraints take
        theirs [J]; what is left of them then may be rounding."""
        self._given = ROUNDING**2 * given
        self._kinetic = self._fall = self._contacts = self._noise = 0.0
        self._loads = 0.0
        """weights and reactions times lengths, at the start [J]."""
        self._potential: float | None = None

    def add(self, block: SampleBlock) -> None:
        """Take the next samples into account."""
        if self._potential is None:
            self._potential = float(block.potential_energy[0])
            self._kinetic = float(block.kinetic_energy[0])
            self._noise = self._roundings(block)
        self._fall = max(self._fall, self._potential - float(block.potential_energy.min()))
        self._contacts = max(self._contacts, float(np.abs(block.contact_work).max()))

    def _roundings(self, block: SampleBlock) -> float:
        """Energy that the loads at the start make of a rounding of the places where they act."""
        force = float(np.linalg.norm(block.reaction_force[0], axis=1).sum())
        reach = float(np.abs(block.position[0]).max())
        self._loads = abs(float(block.potential_energy[0])) + force * reach
        return self._given + ROUNDING * self._loads

    @property
    def at_rest(self) -> float:
        """Energy that is no error: loads times a billionth of the lengths at which they act, by
        which solvers and tolerances may leave in doubt where a body at rest is, and what is left of
        velocities that constraints take [J]."""
        return self._given + SOLVED * self._loads

    def scale(self, work: float) -> float:
        """[J]; 0 where nothing but rounding has moved. work: its size, of forces without potential
        [J]."""
        found = self._kinetic + self._fall + work + self._contacts
        return found if found > self._noise else 0.0


def farthest(points: Array) -> float:
    """The largest coordinate."""
    return float(max(points.max(), -points.min()))


# What acts from outside, whose impulse momentum is held against.


class Load(NamedTuple):
    """A wrench on a body, world axes."""

    body: int
    parent: int | None
    """the body on which it acts the other way round; None: the world."""
    force: Array
    """[N], shape (n, 3) or (3,)."""
    torque: Array
    """[N m], about the point."""
    point: Array
    """where it acts, from the world's origin [m]."""


def loads(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Iterator[Load]:
    """All wrenches that samples and scene contain: reactions, and effects as of `tells_force`."""
    index, none = layout.bodies.index, np.zeros(3)
    for k, name in enumerate(layout.reactions):
        if "/" in name:
            continue  # part of a total
        parent = getattr(scene.constraints[name], "parent", None)
        parent, body = None if parent is None else index(parent), index(layout.reaction_bodies[k])
        force, torque = block.reaction_force[:, k], block.reaction_torque[:, k]
        yield Load(body, parent, force, torque, block.anchor[:, k])
    effects: list[Any] = [effect for effect in scene.effects.values() if tells_force(effect)]
    for effect in effects:
        if effect.type == "gravity":
            for body in map(index, effect.bodies or layout.bodies):
                weight = scene.bodies[layout.bodies[body]].mass * np.array(effect.acceleration)
                yield Load(body, None, weight, none, block.position[:, body])
            continue
        body, point_B = index(effect.body), np.array(getattr(effect, "point_B", none))
        if effect.type == "commanded_wrench":
            force, torque = np.split(block.command[:, layout.commanded.index(effect.body)], 2, 1)
        else:
            force, torque = (np.tile(v, (len(block), 1)) for v in (effect.force, effect.torque))
            if effect.frame == "body":
                q = block.orientation[:, body]
                force, torque = rotate(q, force), rotate(q, torque)
        yield Load(body, None, force, torque, _point(block, scene, layout, effect.body, point_B))


def external_wrench(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Array:
    """Sum of the outer [force, torque about the world origin], world axes, shape (n, 6)."""
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
    """A point of the body, given from its origin in body axes, in the world, shape (n, 3)."""
    i = layout.bodies.index(body)
    arm = point_B - np.array(scene.bodies[body].center_of_mass)
    return block.position[:, i] + rotate(block.orientation[:, i], np.tile(arm, (len(block), 1)))


class Balance(NamedTuple):
    """What has changed against what was supplied."""

    error: float
    """change - supply, which would be zero without error."""
    scale: float
    """that it is compared with; 0 if nothing was exchanged."""
    uncertainty: float
    """how far the supply may be wrong that is integrated over the samples."""
    unsure: float
    """how far the samples are from the change in the intervals that are left out."""
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
    """Momentum, angular momentum and kinetic energy of the velocities that the scene gives."""
    speed, spin = np.linalg.norm(body.linear_velocity), np.array(body.angular_velocity)
    own = body.inertia @ spin
    momentum = float(body.mass * speed)
    about = momentum * float(np.linalg.norm(body.position)) + float(np.linalg.norm(own))
    return momentum, about, 0.5 * float(momentum * speed + own @ spin)


class Account:
    """What is kept, and what is supplied to it, over samples; memory does not grow.

    Where the samples do not tell what acted in an interval it is left out: supplied is what has
    changed there, and in doubt by how far the samples are from it.
    """

    def __init__(self, columns: int) -> None:
        self._rule = Quadrature(columns)
        self._first, self._unsure = np.zeros((2, columns))
        self._left_out = np.zeros((2, columns))
        """sum of the changes there, and of their sizes."""
        self._end: tuple[Array, ...] = ()
        """time, what is kept and what is supplied at the last sample."""

    def add(self, t: Array, kept: Array, supply: Array, left_out: Flags) -> None:
        """The next samples. t: shape (n,); kept, and its rate as far as it is known, (n, columns);
        left_out: whether the interval up to each sample is, (n,)."""
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
        """Change less supply, how far the supply may be wrong, by how much the samples are off the
        change in what is left out, the supply, and the sum of its sizes."""
        supplied, uncertainty, size = self._rule.total()
        supplied, size = supplied + self._left_out[0], size + self._left_out[1]
        error = self._end[1][0] - self._first - supplied
        return error, uncertainty, self._unsure, supplied, size

    def in_stretches(self) -> tuple[Array, Array]:
        """Change and supply without those of the intervals that are left out."""
        error, _, _, supplied, _ = self.total()
        supply = supplied - self._left_out[0]
        return error + supply, supply


class Ledger:
    """Follows the samples of one run.

    since: stamp at which the scene's own time was zero [s].

    Energy, but for the work of contacts, changes by the power of what has no potential, momentum by
    the wrench from outside.  Intervals between samples are left out in which a load jumps, or which
    do not resolve the bodies that tell it: what it does between two samples shows in neither.
    """

    def __init__(self, scene: Scene, layout: SampleLayout, since: float = 0.0) -> None:
        self._scene, self._layout = scene, layout
        self.samples = 0
        self.worst_residual = 0.0
        """of all samples."""
        self.unknown_force = unknown_force(scene) or next(iter(contacts_of(scene)), "")
        """effect whose force the samples do not tell, or contact, for which momentum is not
        balanced; or ""."""
        self._may_work = may_work(scene)
        self._at_work = bodies_at_work(scene, layout)
        """Samples that do not resolve a body on a spring tell the work of a drag on another one all
        the same."""
        self._pushed = not self.unknown_force and bool(scene.effects or scene.constraints)
        """whether something acts from outside."""
        self._has_work = False
        """whether forces without a potential, but for contacts, have done any so far, or may have
        between two samples."""
        self._jumps = np.array(jumps_of_tables(scene, since))
        """instants after the last sample at which a load jumps or bends."""
        self._events = Events()
        self._work, self._impulse = Account(1), Account(6)
        self._resolution, self._missed = Resolution(), np.zeros(2)
        """... and how many intervals are not resolved, for energy and for momenta."""
        self._first: SampleBlock | None = None
        self._last: SampleBlock | None = None
        given = np.array([_given(scene.bodies[name]) for name in layout.bodies])
        self._energies = Exchanged(float(given[:, 2].sum()))
        self._given = given[:, :2].sum(axis=0)
        self._momentum_noise = np.zeros(2)
        self._largest = np.zeros(2)
        """the largest momentum and angular momentum, and sums of the sizes of each body's own."""
        inertias = [scene.bodies[name].inertia for name in layout.bodies]
        self._moments = np.array([np.linalg.norm(inertia, 2) for inertia in inertias])
        self._masses = np.array([scene.bodies[name].mass for name in layout.bodies])

    def add(self, block: SampleBlock, breaks: Sequence[float] = ()) -> None:
        """The next samples. breaks: increasing, where commands change; a sample there is after."""
        if not len(block):
            return
        self._last = block
        if self._first is None:
            self._first = block
        self.samples += len(block)
        self.worst_residual = max(self.worst_residual, block.worst_residual)
        self._energies.add(block)
        self._events.add(block.events)
        power = smooth_power(block, self._scene, self._layout)
        missed, jumped = np.zeros((2, len(block)), dtype=bool), self._jumped(block, breaks)
        # a pulse between two samples, and a body that sticks at each and slips between, show none
        hidden = self._may_work and bool(jumped.any())
        self._has_work = self._has_work or hidden or bool(power.any())
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
        """Momentum and angular momentum that cannot be distinguished from the roundings of what
        adds up to them, each body's own and the impulses of reactions up to the block's end,
        (2,)."""
        assert self._first is not None
        own, reach = norms(block.linear_velocity) * self._masses, farthest(block.position)
        noise = np.array([own.sum(axis=1).max(), (own * norms(block.position)).sum(axis=1).max()])
        about = norms(cross(block.position, block.linear_velocity)) * self._masses
        about = about + norms(block.angular_velocity) * self._moments
        total = norms(block.momentum).max(), norms(block.angular_momentum).max()
        sizes = [noise[0], about.sum(axis=1).max()]
        # what bodies have of their own counts, too: the total of all may be zero
        self._largest = np.maximum(self._largest, np.maximum(sizes, total))
        noise += self._given
        if block.reaction_force.shape[1]:
            force, reach = norms(block.reaction_force), max(reach, farthest(block.anchor))
            span = float(block.t[-1] - self._first.t[0])
            noise += force.sum(axis=1).max() * span * np.array([1.0, reach])
        return ROUNDING * noise

    @property
    def exchanged(self) -> float:
        """What an error of the energy is compared with [J]."""
        if self._last is None:
            return 0.0
        *_, size = self._work.total()
        return self._energies.scale(float(size[0]))

    @property
    def at_rest(self) -> float:
        """Energy that is no error of what stands still [J]."""
        return self._energies.at_rest

    @property
    def end(self) -> float | None:
        """Time of the last sample [s]."""
        return None if self._last is None else float(self._last.t[-1])

    def energy(self) -> dict[str, Any] | None:
        """Energies, work of forces without potential and the balance [J]; None without samples."""
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
        """Index in the block just added at which the energy balance passes `bound`, about."""
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
        """Those that are known, by the names of their checks."""
        if self._last is None:
            return {}
        error, uncertainty, unsure, _, size = (float(row[0]) for row in self._work.total())
        known = (self._missed <= MOST * (self.samples - 1)).tolist()
        found = {
            "energy": Balance(error, self._energies.scale(size), uncertainty, unsure, known[0])
        }
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
