"""Free symmetric body: regular precession (LL 33), and steady spin about a principal axis.

With moments I1 = I2 and I3 about the axis e: R(t) = turn(L / I1 t) R(0) turn(e w3 (1 - I3/I1) t),
L the fixed angular momentum.  Under gravity alone C moves on its parabola.
"""

from __future__ import annotations

from typing import Any

from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import (
    Array,
    Long,
    about,
    long,
    np,
    product,
    turned,
    unit,
    unturned,
)
from rb_sim.accuracy.closed_forms.parabola import only_gravity, parabola
from rb_sim.engine.systems.free_rotor import FreeRotor


def symmetric_rotor(system: Any, y: Any) -> Exact | None:
    """The exact motion of a free body with two equal moments or in steady spin, or None."""
    if not isinstance(system, FreeRotor) or not only_gravity(system.effects):
        return None
    if any(abs(product_of) > 0.0 for product_of in system.body.inertia[3:]):
        return None
    moments, w = long(system.body.inertia[:3]), long(y[10:13])
    axis = symmetry_axis(moments, w)
    if axis is None:
        return None
    across = moments[(axis + 1) % 3] if (w != 0).sum() > 1 else moments[axis]
    q0 = unit(long(y[3:7]))
    momentum = turned(q0, moments * w)
    own = w[axis] * (1 - moments[axis] / across)

    def coordinates(times: Array) -> Array:
        t = long(times)
        size = np.sqrt((momentum * momentum).sum())
        direction = momentum / size if size > 0 else long([0, 0, 1])
        spin = about(np.eye(3, dtype=Long)[axis], own * t)
        q = unit(product(product(about(direction, size / across * t), q0), spin))
        p, v = parabola(system.effects, y[0:3], y[7:10], t)
        return np.concatenate([p, q, v, unturned(q, momentum) / moments], axis=1).astype(float)

    return Exact("free symmetric body, regular precession; LL 33", coordinates)


def symmetry_axis(moments: Array, w: Array) -> int | None:
    """Body axis about which the body is symmetric or steadily spins; None if there is none."""
    for k in range(3):
        steady = w[(k + 1) % 3] == 0 and w[(k + 2) % 3] == 0
        if steady or moments[(k + 1) % 3] == moments[(k + 2) % 3]:
            return k
    return None
