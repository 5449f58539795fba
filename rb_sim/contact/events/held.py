"""The lines that hold at rest, and whether they have one set of reactions."""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.delassus import fill_delassus
from rb_sim.contact.system.bodies import SHARES, line_of
from rb_sim.contact.system.terms import STUCK
from rb_sim.contact.system.touch import CLOSED, COMPLIANT, ROLL, SLIDE, SPIN
from rb_sim.loops.compiled import part, pointer
from rb_sim.maths.jit import inline
from rb_sim.maths.least_squares import triangular
from rb_sim.maths.rank import JUDGED_BY_CONTACT

FEW = 20
"""Lines up to which pivots tell that they do not depend on each other."""


@inline
def find_held(system, room):
    """Lines of the joints and of what rests, in their order, into `room.used`; returns how many."""
    touch, n = system.touch, line_of(system, 0)
    for k in range(n):
        room.used[k] = k
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] == 0.0:
            continue
        k = line_of(system, c)
        holds = (
            touch[c, COMPLIANT] == 0.0,
            touch[c, SLIDE] == STUCK,
            touch[c, SLIDE] == STUCK,
            touch[c, ROLL] == STUCK,
            touch[c, ROLL] == STUCK,
            touch[c, SPIN] == STUCK,
        )
        for j in range(6):
            if holds[j]:
                room.used[n] = k + j
                n += 1
    return n


@inline
def may_share(system, room):
    """False where what holds has one set of reactions for certain; no self-stress is kept then.

    The smallest pivot of n columns is at most 2^n sqrt(n) times the smallest singular value (Golub
    and Van Loan, Matrix Computations, 5.5.7).
    """
    for k in range(system.vectors.shape[1]):
        system.vectors[SHARES, k] = 0.0
    n = find_held(system, room)
    if n == line_of(system, 0):
        return False
    if n > FEW:
        return True
    A, work = np.empty((n, n)), np.zeros(2 * n)
    fill_delassus(system, room.J, room.W, room.used, n, A)
    R = pointer(A)
    rank = triangular(R, n, pointer(work), part(pointer(work), n))
    smallest = abs(R[n * n - 1]) if rank == n else 0.0
    return not smallest > JUDGED_BY_CONTACT * n * 2.0**n * abs(R[0])
