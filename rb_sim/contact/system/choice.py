"""Which lines of joints in loops get a multiplier in the next step, as `engine.systems.choice` has
it for scenes without contacts; and the rank of all lines in it."""

from __future__ import annotations

import numpy as np

from rb_sim.contact.system.accelerations import moving
from rb_sim.contact.system.bodies import (
    AMONG_LINES,
    AMONG_POSITIONS,
    CHANGING,
    DEPENDENT,
    HOLDS,
    MOST_RANK,
    NUDGE,
    REDUNDANT,
    line_of,
)
from rb_sim.contact.system.lines import write_joints
from rb_sim.contact.system.manifold import fill_symmetric
from rb_sim.engine.system import settle
from rb_sim.engine.systems.choice import largest_pivots
from rb_sim.engine.systems.multibody import put_rates
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


@inline
def free_rank(system):
    """Let each state have the rank that it is found to have."""
    system.lines[0, MOST_RANK] = system.lines.shape[0]


@inline
def choose_rank(system, t, y):
    """Choose the rank that all stages of the next step have at most: that at (t, y), a state on the
    manifold, where it lasts.

    More contacts than are needed to hold a body, as four wheels do, have lines that depend on each
    other on the manifold alone: at the stages they contradict each other, by little, and each would
    push with a force that is the larger the less that is.  A rank that is less at one instant only,
    as of a mechanism that passes a singular position, is none to keep: it is more a moment later.
    """
    free_rank(system)
    if system.lines[0, REDUNDANT] == 0:
        return
    kept = system.touch.copy()
    rank, holding = moving(system, t, y, False)
    if rank < holding:
        nudge, later = NUDGE * system.length / system.speed, np.zeros_like(y)
        put_rates(system, y, later)
        for i in range(y.shape[0]):
            later[i] = y[i] + nudge * later[i]
        settle(system, t + nudge, later)
        soon, _ = moving(system, t + nudge, later, False)
        if soon == rank:
            system.lines[0, MOST_RANK] = int(rank)
    for c in range(kept.shape[0]):
        for j in range(kept.shape[1]):
            system.touch[c, j] = kept[c, j]
