"""What loops call of bodies in contact by address: compiled once for all scenes."""

from __future__ import annotations

from rb_sim.contact.system.accelerations import accelerations_in, unconstrained_here
from rb_sim.contact.system.manifold import bring_to_manifold
from rb_sim.contact.system.rates import contact_rate
from rb_sim.loops.tables import held
from rb_sim.maths.jit import by_address


@by_address
def free(t, y, p, out):
    """Lines, and accelerations from loads and given contact forces alone, into the tables."""
    unconstrained_here(held(p), t, y)


@by_address
def accelerate(t, y, p, out):
    """Multipliers and accelerations into the tables, everywhere where out[0] is not 0; rank and
    lines that hold into out."""
    rank, holding = accelerations_in(held(p), t, y, out[0] != 0.0)
    out[0], out[1] = float(rank), float(holding)


@by_address
def bring_back(t, y, p, out):
    """y back on the manifold, in place."""
    bring_to_manifold(held(p), t, y)


@by_address
def rate_of_change(t, y, p, out):
    """dy/dt into out."""
    contact_rate(held(p), t, y, out)
