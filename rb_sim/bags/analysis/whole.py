# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Energy and momentum balances of foreign bags: bodies against the recorded wrenches and effects.

Momenta and energies come from differentiated poses; loads from the effects of a scene, if given,
and from recorded wrenches. A wrench acts ON the body at its origin: in body axes if its frame is
the body's, in world axes if its frame is the world.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.accuracy.checks.balance import Account, Balance
from rb_sim.bags.analysis.derivatives import WINDOW, Body, Jump, Motion, Scatter
from rb_sim.bags.analysis.scene_laws import ConstraintFigures, Found, SceneLaws
from rb_sim.bags.info import GAP, GrowingTime, forward, held, joined, linear
from rb_sim.bags.transforms import words
from rb_sim.mechanics.samples import Array
from rb_sim.numerics.rotations import conjugate, cross, from_rotation_vector, product, rotate, unit
from rb_sim.scene.schema import Scene

ROWS = 8192
"""Samples processed at once."""
MOST = 16 * ROWS
"""Samples buffered while waiting for another source; beyond it that source counts as silent."""
LATE = 2.0
"""Periods of the poses: a smaller step back is a late message, a larger one a set clock."""
SURELY = 2.0
"""Number of standard deviations reported as the bound of noise."""
SAME = 1000
"""Time difference [ns] within which poses of several bodies count as simultaneous."""


class _Acting(NamedTuple):
    """Readings of one source of wrenches."""

    body: str
    own_axes: bool
    """in body axes; else in world axes."""
    t: list[Array]
    """growing time [s]."""
    values: list[Array]
    new: list[tuple[Array, Array]]
    """stamps and values not yet converted to growing time."""
    silent: list[int]
    """number of instants evaluated, and of those without a reading near."""


class Whole:
    """Balances all bodies of a scene together, sample by sample.

    bodies: their mass properties. notes: lines about excluded data.
    """

    def __init__(self, scene: Scene, bodies: dict[str, Body]) -> None:
        laws = SceneLaws(scene)
        self._effects = sorted(scene.effects)
        self._supports = [
            name
            for name, spec in scene.constraints.items()
            if getattr(spec, "parent", None) is None and spec.type != "free"  # type: ignore[attr-defined]
        ]
        """constraints to the world: their reactions change the momentum."""
        self._commanded = {
            str(spec.body)  # type: ignore[attr-defined]
            for spec in scene.effects.values()
            if spec.commandable
        }
        """bodies with commands, each of which holds until the next one."""
        self.constraints = ConstraintFigures(laws)
        self.notes: list[str] = []
        self._laws, self._bodies = laws, bodies
        self._waiting: dict[str, list[tuple[Array, Array]]] = {name: [] for name in laws.bodies}
        self._acting: dict[str, _Acting] = {}
        self._balance = _Balance()
        self._time = GrowingTime()
        self._late = np.inf
        self._scatter: dict[str, Scatter] = {}
        self._random = np.random.default_rng(0)

    def motion(self, body: str, motion: Motion, jumps: Sequence[Jump] = ()) -> None:
        """Append motion of a body, and the steps back in its stamps before it."""
        q = unit(motion.orientation)
        rows = [motion.position, q, motion.velocity, rotate(conjugate(q), motion.spin)]
        if self._late == np.inf:
            self._late = LATE * float(motion.t[-1] - motion.t[0]) / max(1, len(motion.t) - 1)
        source = f"poses of {body}"
        for old, new in jumps:
            if old - new > self._late:
                self._time.jump(source, old, new)
        self._scatter[body] = motion.scatter
        self._waiting[body].append((self._time.of(source, motion.t), np.hstack(rows)))
        if sum(len(t) for t, _ in self._waiting[body]) >= ROWS:
            self._take()

    def wrench(self, source: str, body: str, own_axes: bool, t: Array, values: Array) -> None:
        """Append readings, shape (n, 6), of a source of wrenches on a body."""
        acting = self._acting.setdefault(source, _Acting(body, own_axes, [], [], [], [0, 0]))
        acting.new.append((t, values))

    def finish(self, seen: Container[str] = ()) -> dict[str, Any]:
        """Energy and momentum balances, their sources, and the constraint errors.

        seen: bodies that have poses, even if too few to differentiate.
        """
        self._take(last=True)
        self.notes += self._time.notes()
        absent = [name for name, parts in self._waiting.items() if not parts and not self.samples]
        few = [name for name in absent if name in seen]
        none = [name for name in absent if name not in seen]
        if absent:
            lacks = [f"no poses of {', '.join(none)}"] if none else []
            lacks += [f"too few poses in a row of {', '.join(few)}"] if few else []
            self.notes.append(f"{', '.join(lacks)}: no balance, no constraints")
        elif not self.samples:
            names = ", ".join(self._waiting)
            self.notes.append(f"{names}: no instant at which all poses are known: no balance")
        self.notes += [
            f"{source}: no reading near {acting.silent[1]} of {acting.silent[0]} instants of the "
            "poses: taken as zero before its first and after its last, as linear in between"
            for source, acting in self._acting.items()
            if acting.silent[1] and acting.body not in self._commanded
        ]
        found = self._balance.as_dict()
        recorded = {word for source in self._acting for word in words(source)}
        lacks = [name for name in self._supports if name not in recorded]
        if lacks:
            found |= {"momentum": None, "momentum_lacks_reactions_of": lacks}
        acted = {"wrenches": sorted(self._acting), "effects": self._effects}
        return {**found, **acted, "constraints": self.reported}

    @property
    def samples(self) -> int:
        """Number of instants at which all bodies are known."""
        return self._balance.samples

    @property
    def reported(self) -> dict[str, Any] | None:
        """Constraint errors; None without samples."""
        return self.constraints.as_dict() if self.samples else None

    def _take(self, last: bool = False) -> None:
        """Evaluate the instants that all sources have reached; at the end all instants."""
        if not all(self._waiting.values()):
            return
        for source, acting in self._acting.items():
            for stamps, values in acting.new:
                acting.t.append(self._time.found(source, stamps, self._late))
                acting.values.append(values)
            acting.new.clear()
        columns = {name: joined(*zip(*parts, strict=True)) for name, parts in self._waiting.items()}
        full = max(len(t) for t, _ in columns.values()) > MOST
        ends = [t[-1] for t, _ in columns.values()]
        if not last and not full:
            ends += [acting.t[-1][-1] for acting in self._acting.values()]
        limit = np.inf if last else min(ends)
        ready = {}
        for name, (t, rows) in columns.items():
            upto = int(np.searchsorted(t, limit, side="right"))
            ready[name] = t[:upto], rows[:upto]
            rest = [(t[upto:], rows[upto:])] if upto < len(t) else []
            self._waiting[name] = rest if not last else self._waiting[name]
        t, y = _together(list(ready.values()))
        for first in range(0, len(t), ROWS):
            part = slice(first, first + ROWS)
            self._evaluate(t[part], y[part])
        if len(t):
            self._forget(float(t[-1]))

    def _evaluate(self, t: Array, y: Array) -> None:
        stamps = self._time.stamps(t)
        found = self._laws.at(stamps, y)
        self.constraints.add(stamps, found)
        state, supply = self._balanced(t, y, found)
        other = self._with_noise(y)
        noise = None
        if other is not None:
            noisy = self._balanced(t, other, self._laws.at(stamps, other))
            noise = noisy[0] - state, noisy[1] - supply
        for acting in self._acting.values():
            acting.silent[0] += len(t)
            at = np.concatenate(acting.t)
            acting.silent[1] += int(_silent(at[forward(at)], t).sum())
        self._balance.add(t, found.kinetic, state, supply, noise)

    def _balanced(self, t: Array, y: Array, found: Found) -> tuple[Array, Array]:
        """Energy and momenta, and their rates of supply, shape (n, 7) each."""
        power, loads = found.power.copy(), found.loads.copy()
        for acting in self._acting.values():
            i = self._laws.bodies.index(acting.body)
            p, q, v, w_B = np.split(y[:, 13 * i : 13 * i + 13], [3, 7, 10], axis=1)
            wrench = self._acting_at(t, acting)
            force, torque = wrench[:, :3], wrench[:, 3:]
            if acting.own_axes:
                force, torque = rotate(q, force), rotate(q, torque)
            arm = -rotate(q, self._bodies[acting.body].center_of_mass)
            torque = torque + cross(arm, force)  # about the centre of mass
            power += np.sum(force * v + torque * rotate(q, w_B), axis=1)
            loads += np.hstack([force, torque + cross(p, force)])
        energy = found.kinetic + found.potential
        return np.column_stack([energy, found.momenta]), np.column_stack([power, loads])

    def _acting_at(self, t: Array, acting: _Acting) -> Array:
        """Wrenches of a source at times t, (n, 6): interpolated linearly; commands hold until the
        next one, as in a simulation."""
        at, values = joined(acting.t, acting.values)
        if acting.body in self._commanded:
            return held(t, at, values)
        return linear(t, at, values, outside=0.0)

    def _with_noise(self, y: Array) -> Array | None:
        """Copy of the motion with as much noise added as it contains; None without noise."""
        if not any(max(scatter) > 0.0 for scatter in self._scatter.values()):
            return None
        y = y.copy()
        for i, name in enumerate(self._laws.bodies):
            scatter = self._scatter[name]
            p, turn, v, w = (
                size / np.sqrt(3.0) * self._random.standard_normal((len(y), 3)) for size in scatter
            )
            own = y[:, 13 * i : 13 * i + 13]
            own[:, :3] += p
            own[:, 3:7] = product(from_rotation_vector(turn), own[:, 3:7])
            own[:, 7:10] += v
            own[:, 10:] += w
        return y

    def _forget(self, before: float) -> None:
        """Drop readings before time `before` [s], except the last one."""
        for acting in self._acting.values():
            while len(acting.t) > 1 and acting.t[1][0] <= before:
                del acting.t[0], acting.values[0]


class _Balance:
    """Change minus supply of energy and momenta, summed over stretches without a gap."""

    def __init__(self) -> None:
        self.samples = 0
        self.stretches = 0
        self._period: float | None = None
        self._last = 0.0
        """time of the last instant [s]."""
        self._account = Account(7)
        self._scale = np.zeros(3)
        self._ends = np.zeros(2)
        self._squares = np.zeros((2, 7))
        """sums of squares over the instants: effect of noise on the state, and on its supply."""

    def add(
        self,
        t: Array,
        kinetic: Array,
        state: Array,
        supply: Array,
        noise: tuple[Array, Array] | None = None,
    ) -> None:
        """Append instants: energy [J] and momenta [P, L], (n, 7); power [W] and force and torque
        about the world's origin that change them, (n, 7); and the effect of noise on both."""
        if not len(t):
            return
        energy, momenta = state[:, 0], state[:, 1:]
        if self._period is None:
            self._period = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
            self._ends[0], self._last, self.stretches = energy[0], t[0], 1
        self._ends[1] = energy[-1]
        if noise is not None:
            self._squares += [np.sum(each * each, axis=0) for each in noise]
        self.samples += len(t)
        sizes = [np.linalg.norm(momenta[:, k : k + 3], axis=1).max() for k in (0, 3)]
        self._scale = np.maximum(self._scale, [kinetic.max(), *sizes])
        gaps = np.diff(t, prepend=self._last) > GAP * self._period
        self.stretches += int(gaps.sum())
        self._account.add(t, state, supply, gaps)
        self._last = t[-1]

    def as_dict(self) -> dict[str, Any]:
        """Balances in the format of `Ledger`; None without samples."""
        if not self.samples:
            return {"energy": None, "momentum": None}
        error, uncertainty, *_ = self._account.total()
        change, supply = self._account.in_stretches()
        scale = np.maximum(self._scale, [np.linalg.norm(change[k]) for k in _PARTS])
        scale = np.maximum(scale, [np.linalg.norm(supply[k]) for k in _PARTS])
        noise = self._noise()
        parts = []
        for part, size in zip(_PARTS, scale.tolist(), strict=True):
            off, unsure, noisy = (
                float(np.linalg.norm(x[part])) for x in (error, uncertainty, noise)
            )
            parts.append(Balance(off, size, unsure, 0.0, True).as_dict() | {"noise": noisy})
        initial, final = self._ends.tolist()
        parts[0] |= {"error": float(error[0]), "initial": initial, "final": final,
                     "change": float(change[0]), "work": float(supply[0])}  # fmt: skip
        return {
            "stretches": self.stretches,
            "energy": parts[0],
            "momentum": {"linear": parts[1], "angular": parts[2]},
        }

    def _noise(self) -> Array:
        """Bound of the effect of noise on change minus supply, SURELY standard deviations, (7,).

        From the noise at the ends of each stretch, and of the sum over steps, whose noise is
        correlated within the filter's window."""
        step = self._period if self._period is not None and np.isfinite(self._period) else 0.0
        ends = 2.0 * self.stretches * self._squares[0] / max(1, self.samples)
        return SURELY * np.sqrt(ends + WINDOW * step**2 * self._squares[1])


_PARTS = (slice(0, 1), slice(1, 4), slice(4, 7))


def _silent(at: Array, t: Array) -> NDArray[np.bool_]:
    """Mask of the instants t within a gap of the times `at`, or outside of them."""
    steps = np.diff(at)
    far = GAP * float(np.median(steps)) if len(steps) else 0.0
    after = np.searchsorted(at, t)
    inside = np.clip(after, 1, max(1, len(at) - 1))
    width = at[np.minimum(inside, len(at) - 1)] - at[inside - 1]
    outside = (t < at[0] - far) | (t > at[-1] + far)
    return outside | ((after > 0) & (after < len(at)) & (width > far) & (at[after % len(at)] != t))


def _together(columns: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Instants at which all sources have a row, and these rows side by side."""
    t, first = columns[0]
    rows = [first]
    for other_t, other in columns[1:]:
        near = np.clip(np.searchsorted(other_t, t), 1, max(1, len(other_t) - 1))
        if len(other_t) < 2:
            return t[:0], np.empty((0, 13 * len(columns)))
        near -= t - other_t[near - 1] < other_t[near] - t
        same = np.abs(other_t[near] - t) * 1e9 < SAME
        t, rows = t[same], [r[same] for r in rows]
        rows.append(other[near[same]])
    return t, np.hstack(rows)
