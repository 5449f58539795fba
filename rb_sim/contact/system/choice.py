"""Which lines of joints in loops get a multiplier in the next step, as `engine.systems.choice` has
it for scenes without contacts."""

from __future__ import annotations

import numpy as np

from rb_sim.contact.system.bodies import (
    AMONG_LINES,
    AMONG_POSITIONS,
    CHANGING,
    DEPENDENT,
    HOLDS,
    line_of,
)
from rb_sim.contact.system.lines import write_joints
from rb_sim.contact.system.manifold import fill_symmetric
from rb_sim.engine.systems.choice import largest_pivots
from rb_sim.loops.compiled import part, pointer
from rb_sim.maths.jit import inline


@inline
def find_changing(system):
    """Number the lines that are chosen anew as those that hold; (how many, how many are chosen)."""
    count, rank = 0, 0
    for k in range(line_of(system, 0)):
        flags = system.lines[k, DEPENDENT]
        if flags & CHANGING != 0:
            system.lines[count, HOLDS] = k
            count += 1
            if flags & AMONG_LINES == 0:
                rank += 1
    return count, rank


@inline
def choose_lines(system, t, y):
    """Choose anew at (t, y), a state on the manifold, where a step begins."""
    count, rank = find_changing(system)
    if count == 0:
        return
    write_joints(system, t, y)
    fill_symmetric(system, count, False)
    room = np.empty(count * (count + rank + 2))
    matrix, chosen = pointer(room), part(pointer(room), count * count)
    for i in range(count):
        for j in range(count):
            matrix[i * count + j] = system.square[0, i, j]
    left, factors = part(chosen, count), part(chosen, 2 * count)
    least, _ = largest_pivots(count, rank, matrix, chosen, left, factors)
    if not least > 0.0:
        return
    for m in range(count):
        left_out = 0 if chosen[m] == 1.0 else AMONG_LINES + AMONG_POSITIONS
        system.lines[system.lines[m, HOLDS], DEPENDENT] = CHANGING + left_out
