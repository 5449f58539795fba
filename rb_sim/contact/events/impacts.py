"""Impacts: u+ = u- + M^-1 J^T x, all contacts at once.

Newton's restitution v_n+ = -e v_n- where the contact pushes, and Coulomb's law between impulse and
slip after it; if that would create energy, Poisson's two phases instead, and if they do too, no
rebound (Glocker, Set-Valued Force Laws, 2001).  Or one contact after the other, the fastest first,
as elastic bodies that are hard and touch at single points do (Newton's cradle).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from rb_sim.contact.events.complementarity import Bounded, Items, Normal, Problem, items_of
from rb_sim.contact.events.dense import velocities
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.system.touch import CLOSED, GAP_RATE
from rb_sim.engine.samples import Array
from rb_sim.errors import SimulationError

ENERGY_SLACK = 1e-12
"""Relative gain of kinetic energy in an impact that is round-off."""


@dataclass(frozen=True)
class Impact:
    """Impulses of one impact."""

    impulses: Array
    """of every line [N s] or [N m s], (n,)."""
    rebound: tuple[int, ...]
    """contacts that separate after it."""


def strike(
    at: Instant,
    plastic: frozenset[int] = frozenset(),
    together: frozenset[int] = frozenset(),
    alone: bool = False,
) -> Impact | None:
    """Let what approaches strike; None if nothing does.

    plastic: contacts without rebound; together: touching ones that do not part either; alone: only
    the contact that approaches fastest.
    """
    touching = at.touching()
    rates = at.system.touch[:, GAP_RATE].tolist()
    if not any(rates[c] < -at.still or must_stop_slipping(at, c) for c in touching):
        return None
    fastest = min(touching, key=rates.__getitem__)
    if alone and rates[fastest] < -at.still:
        touching = [fastest]
    u = velocities(at.system, at.y)
    v = at.lines.J @ u - at.lines.rate
    bounce = {
        c: 0.0 if c in plastic else at.laws[c].restitution for c in touching if v[at.first[c]] < 0.0
    }
    x = impulses_with(at, touching, v, {}, {}, together) if together else None
    if x is None and not rates[fastest] < -at.still:
        x = impulses_with(at, touching, v, {}, {}, stop=True)
    if x is None:
        x = newton_impulses(at, touching, v, bounce)
    if x is None or gains_energy(at, u, x):
        x = poisson_impulses(at, touching, v, bounce)
        if x is None or gains_energy(at, u, x):
            x = newton_impulses(at, touching, v, {})
    if x is None:
        raise SimulationError(
            f"no impulses satisfy the laws of impact and friction at t = {at.t:.9g} s"
        )
    at.apply(x)
    v = at.lines.J @ velocities(at.system, at.y) - at.lines.rate
    rebound = tuple(c for c in touching if v[at.first[c]] > at.still)
    return Impact(x, rebound)


def must_stop_slipping(at: Instant, c: int) -> bool:
    """A perfectly rough contact that has just come to be, does not part, and slips."""
    touch, rough = at.system.touch, math.isinf(at.laws[c].static)
    stays = touch[c, CLOSED] == 1.0 and touch[c, GAP_RATE] <= at.still
    return rough and stays and at.slip_speed(c) > at.still


def gains_energy(at: Instant, u: Array, x: Array) -> bool:
    """True if the impulses would create kinetic energy (driven supports may)."""
    p = at.lines.J.T @ x
    work = float(p @ (u + 0.5 * (at.inverse_mass @ p))) - float(x @ at.lines.rate)
    size = float(np.abs(p) @ np.abs(u)) + 1e-300
    return work > ENERGY_SLACK * size


def impulses_with(
    at: Instant,
    touching: list[int],
    v: Array,
    bounce: dict[int, float],
    least: dict[int, float],
    together: frozenset[int] = frozenset(),
    stop: bool = False,
) -> Array | None:
    """Impulses with w = A x + v + e v-, on the lines of the touching contacts.

    stop: what is perfectly rough stops slipping, also where no push would be needed; as it does
    where there are no other impulses.
    """
    form = form_of(at, touching, together)
    J = at.lines.J[form.used]
    A = J @ at.inverse_mass @ J.T
    b = v[form.used]
    for c, e in bounce.items():
        b[form.where[at.first[c]]] *= 1.0 + e
    items = form.items
    if least:
        items = items._replace(least=items.least.copy())
        for c, push in least.items():
            items.least[form.where[at.first[c]]] = push
    terms = np.abs(J) @ np.abs(velocities(at.system, at.y)) + np.abs(at.lines.rate[form.used])
    holding = [item for k, item in form.rough if v[k] <= at.still]
    solution = None
    if not (stop and holding):
        solution = Problem(A, b, items, terms).solve(at.compiled)
    if solution is None and holding:
        # what is perfectly rough stops the slip even where that alone lifts it off
        others = [item for item in form.bounded if item not in holding]
        loose = items_of(len(b), form.normals, others)._replace(least=items.least)
        solution = Problem(A, b, loose, terms).solve(at.compiled)
    if solution is None:
        return None
    x = np.zeros(len(v))
    x[form.used] = solution.x
    return x


class Form(NamedTuple):
    """Lines and laws of an impact of some contacts, which do not depend on the state."""

    used: npt.NDArray[np.intp]
    """lines that take part."""
    where: dict[int, int]
    """places of those among them."""
    normals: list[Normal]
    bounded: list[Bounded]
    rough: list[tuple[int, Bounded]]
    """(normal line, friction) of what never slips as long as it pushes."""
    items: Items


def form_of(at: Instant, touching: list[int], together: frozenset[int]) -> Form:
    """The form of an impact of these contacts; kept, since they strike again and again."""
    key = tuple(touching), together
    if key not in at.forms:
        used = lines_in_impact(at, touching)
        where = {k: i for i, k in enumerate(used)}
        normals, bounded, rough = [], [], []
        for c in touching:
            k, law = at.first[c], at.laws[c]
            normals.append(Normal(where[k], law.bilateral or c in together))
            bounds = friction_bounds(at, c, where, law.kinetic)
            bounded += bounds
            rough += [(k, bounds[0])] if math.isinf(law.kinetic) else []
        items = items_of(len(used), normals, bounded)
        at.forms[key] = Form(np.array(used), where, normals, bounded, rough, items)
    form: Form = at.forms[key]
    return form


def friction_bounds(
    at: Instant, c: int, where: dict[int, int], coefficient: float
) -> list[Bounded]:
    """Friction of contact c on slip, rolling and spinning."""
    k, law = at.first[c], at.laws[c]
    items = []
    if coefficient > 0.0:
        items.append(Bounded((where[k + 1], where[k + 2]), where[k], coefficient))
    if law.rolling_arm > 0.0:
        items.append(Bounded((where[k + 3], where[k + 4]), where[k], law.rolling_arm))
    if law.spinning_arm > 0.0:
        items.append(Bounded((where[k + 5],), where[k], law.spinning_arm))
    return items


def lines_in_impact(at: Instant, contacts: list[int]) -> list[int]:
    """Lines of the constraints and of these contacts' normals and frictions, as in impacts."""
    used = list(range(at.first[0]))
    for c in contacts:
        k, law = at.first[c], at.laws[c]
        used.append(k)
        if law.kinetic > 0.0:
            used += [k + 1, k + 2]
        if law.rolling_arm > 0.0:
            used += [k + 3, k + 4]
        if law.spinning_arm > 0.0:
            used.append(k + 5)
    return used


def newton_impulses(
    at: Instant, touching: list[int], v: Array, bounce: dict[int, float]
) -> Array | None:
    return impulses_with(at, touching, v, bounce, {})


def poisson_impulses(
    at: Instant, touching: list[int], v: Array, bounce: dict[int, float]
) -> Array | None:
    """Compression to rest, then at least e times its normal impulse once more."""
    x = impulses_with(at, touching, v, {}, {})
    if x is None:
        return None
    least = {c: e * float(x[at.first[c]]) for c, e in bounce.items()}
    after = v + at.lines.J @ (at.inverse_mass @ (at.lines.J.T @ x))
    again = impulses_with(at, touching, after, {}, least)
    return None if again is None else x + again
