"""Balances of a run from its samples: energy against work, momentum against impulse.

Both are independent of the integrator: they use only what is logged. Their limit is the quadrature
over the samples, which is stated with them.

The work of contacts, impacts included, is among the samples; only the other powers are integrated.
Momentum is not balanced with contacts: their forces jump and strike between samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.sinks.contact_power import contacts_of, smooth_power
from rb_sim.sinks.frames import rotate
from rb_sim.watches.quadrature import CheckedQuadrature

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, ContactEvent, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


ROUNDING = 1e-13
"""Relative energy below which a body at rest has not moved."""


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


class Ledger:
    """Follows the samples of one run."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._scene, self._layout = scene, layout
        self.samples = 0
        self.worst_residual = 0.0
        self.unknown_force = unknown_force(scene) or next(iter(contacts_of(scene)), "")
        """effect whose force the samples do not tell, or contact, for which momentum is not
        balanced; or ""."""
        self.has_work = False
        """whether forces without a potential, but for contacts, have done any so far."""
        self._jumps, self._ends = jumps_of_tables(scene), ends_of_tables(scene)
        self._events = Events()
        self._work = CheckedQuadrature(1)
        self._impulse = CheckedQuadrature(6)
        self._first: SampleBlock | None = None
        self._last: SampleBlock | None = None
        self._energies = _Exchanged()
        self._momentum_scale = np.zeros(2)
        self._momentum_noise = np.zeros(2)

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        if not len(block):
            return
        self._first = self._first or block
        self._last = block
        self.samples += len(block)
        self.worst_residual = max(self.worst_residual, float(block.residual.max()))
        self._energies.add(block)
        self._events.add(block.events)
        power = smooth_power(block, self._scene, self._layout)
        self._energies.work(block, power)
        self.has_work |= bool(power.any())
        breaks = sorted({event.t for event in block.events if event.t > self._first.t[0]})
        breaks = sorted({*breaks, *self._jumps_until(float(block.t[-1]))})
        kept = ~np.isin(block.t, self._ends)
        kept[-1] = True
        self._work.add(block.t[kept], power[kept, None], breaks)
        if not self.unknown_force:
            self._impulse.add(block.t, external_wrench(block, self._scene, self._layout))
            size = np.array([_largest(block.momentum), _largest(block.angular_momentum)])
            self._momentum_scale = np.maximum(self._momentum_scale, size)
            self._momentum_noise = self._roundings(block)

    def _jumps_until(self, end: float) -> list[float]:
        """Instants up to `end`, not yet given, at which a table jumps or bends."""
        assert self._first is not None
        found = [t for t in self._jumps if self._first.t[0] < t <= end]
        self._jumps = [t for t in self._jumps if t > end]
        return found

    def _roundings(self, block: SampleBlock) -> Array:
        """Impulse that reactions make of their roundings up to the block's end, (2,)."""
        assert self._first is not None
        force = np.linalg.norm(block.reaction_force, axis=2).sum(axis=1).max(initial=0.0)
        reach = max(
            float(np.abs(block.position).max(initial=0.0)),
            float(np.abs(block.anchor).max(initial=0.0)),
        )
        span = float(block.t[-1] - self._first.t[0])
        return ROUNDING * force * span * np.array([1.0, reach])

    @property
    def end(self) -> float | None:
        """Time of the last sample [s]."""
        return None if self._last is None else float(self._last.t[-1])

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
        """Balances of linear and angular momentum (about the world origin), or None."""
        if self._first is None or self._last is None or self.unknown_force:
            return None
        impulse, doubt = self._impulse.finish()
        balances = {}
        for k, name in enumerate(("linear", "angular")):
            part = slice(3 * k, 3 * k + 3)
            field = "momentum" if name == "linear" else "angular_momentum"
            change = getattr(self._last, field)[-1] - getattr(self._first, field)[0]
            error = float(np.linalg.norm(change - impulse[part]))
            scale = max(float(self._momentum_scale[k]), float(np.linalg.norm(impulse[part])))
            scale = scale if scale > self._momentum_noise[k] else 0.0
            balances[name] = Balance(error, scale, float(np.linalg.norm(doubt[part]))).as_dict()
        return balances


class _Exchanged:
    """Scale of the energies: what the scene started with or has exchanged by right.

    The kinetic energy at the start, the fall of the potential from there, and the work of what has
    none. What an error makes, a spring that gains without end, is in none of the three.
    """

    def __init__(self) -> None:
        self._kinetic = self._fall = self._works = self._contacts = self._noise = 0.0
        self._potential: float | None = None
        self._last: tuple[float, float] | None = None

    def add(self, block: SampleBlock) -> None:
        if self._potential is None:
            self._potential = float(block.potential_energy[0])
            self._kinetic = float(block.kinetic_energy[0])
            self._noise = self._roundings(block)
        self._fall = max(self._fall, self._potential - float(block.potential_energy.min()))
        self._contacts = max(self._contacts, float(np.abs(block.contact_work).max()))

    def work(self, block: SampleBlock, power: Array) -> None:
        """Add the size of the work of forces without potential over the block."""
        t, size = block.t, np.abs(power)
        if self._last is not None:
            t, size = np.append(self._last[0], t), np.append(self._last[1], size)
        self._works += float(0.5 * np.sum(np.diff(t) * (size[1:] + size[:-1])))
        self._last = float(t[-1]), float(size[-1])

    def _roundings(self, block: SampleBlock) -> float:
        """Energy that the loads at the start make of a rounding of the places where they act."""
        force = float(np.linalg.norm(block.reaction_force[0], axis=1).sum())
        reach = float(np.abs(block.position[0]).max())
        return ROUNDING * (abs(float(block.potential_energy[0])) + force * reach)

    @property
    def scale(self) -> float:
        """[J]; 0 where nothing but rounding has moved."""
        found = self._kinetic + self._fall + self._works + self._contacts
        return found if found > self._noise else 0.0


def _largest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())


def jumps_of_tables(scene: Scene) -> list[float]:
    """Instants at which tabulated wrenches jump or bend, increasing [s]."""
    times: list[Any] = [getattr(effect, "times", ()) for effect in scene.effects.values()]
    return sorted({float(t) for table in times for t in table})


def ends_of_tables(scene: Scene) -> list[float]:
    """Instants at which a sample shows a wrench that acts neither before nor after [s]."""
    times: list[Any] = [getattr(effect, "times", ()) for effect in scene.effects.values()]
    return [float(table[-1]) for table in times if table]


def unknown_force(scene: Scene) -> str:
    """Name of the first effect that exerts an outer force not told by the samples; or ""."""
    for name, effect in scene.effects.items():
        kind: str = effect.type  # type: ignore[attr-defined]
        between_bodies = getattr(effect, "parent", None) is not None
        steady = kind == "wrench" and effect.sine_force == effect.sine_torque == (0.0,) * 3  # type: ignore[attr-defined]
        if not (kind in ("gravity", "commanded_wrench") or between_bodies or steady):
            return name
    return ""


def external_wrench(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Array:
    """Sum of the outer [force, torque about the world origin], world axes, shape (n, 6)."""
    total = np.zeros((len(block), 6))
    for k, name in enumerate(layout.reactions):
        if "/" in name or getattr(scene.constraints[name], "parent", None) is not None:
            continue  # part of a total, or an inner force
        put(total, block.reaction_force[:, k], block.reaction_torque[:, k], block.anchor[:, k])
    for effect in scene.effects.values():
        kind: str = effect.type  # type: ignore[attr-defined]
        if kind == "gravity":
            _put_gravity(total, effect, block, scene, layout)
        elif kind == "commanded_wrench":
            command = block.command[:, layout.commanded.index(effect.body)]  # type: ignore[attr-defined]
            origin = _point(block, scene, layout, effect.body, np.zeros(3))  # type: ignore[attr-defined]
            put(total, command[:, :3], command[:, 3:], origin)
        elif kind == "wrench":
            _put_wrench(total, effect, block, scene, layout)
    return total


def put(total: Array, force: Array, torque: Array, point: Array) -> None:
    """Add a force at `point` and a free torque, in place; each (n, 3) or (3,)."""
    total[:, :3] += force
    total[:, 3:] += torque + np.cross(point, force)


def _put_gravity(
    total: Array, effect: Any, block: SampleBlock, scene: Scene, layout: SampleLayout
) -> None:
    for body in effect.bodies or layout.bodies:
        force = scene.bodies[body].mass * np.array(effect.acceleration)
        put(total, force, np.zeros(3), block.position[:, layout.bodies.index(body)])


def _put_wrench(
    total: Array, effect: Any, block: SampleBlock, scene: Scene, layout: SampleLayout
) -> None:
    point = _point(block, scene, layout, effect.body, np.array(effect.point_B))
    force, torque = (np.tile(v, (len(block), 1)) for v in (effect.force, effect.torque))
    if effect.frame == "body":
        q = block.orientation[:, layout.bodies.index(effect.body)]
        force, torque = rotate(q, force), rotate(q, torque)
    put(total, force, torque, point)


def _point(
    block: SampleBlock, scene: Scene, layout: SampleLayout, body: str, point_B: Array
) -> Array:
    """A point of the body, given from its origin in body axes, in the world, shape (n, 3)."""
    i = layout.bodies.index(body)
    arm = point_B - np.array(scene.bodies[body].center_of_mass)
    return block.position[:, i] + rotate(block.orientation[:, i], np.tile(arm, (len(block), 1)))
