"""What is left to do once the impulses are known: rest, work, modes."""

from __future__ import annotations

import math

from rb_sim.contact.solvers.gauss_seidel import ROUGH
from rb_sim.contact.solvers.graph import BOUND, LIGHT_A, LIGHT_B, LINES, TURN_A, TURN_B, rate_of
from rb_sim.contact.stepping.constraint_rows import six, speed_at
from rb_sim.contact.stepping.geometry import (
    AIM,
    ANCHOR,
    CLOSED,
    IMPULSE,
    MOVES,
    NORMAL,
    POINT,
    ROLL,
    SLIDE,
    SPIN,
    STAYS,
    TWIST,
    put,
    triple,
)
from rb_sim.contact.stepping.normal_change import has_turned, note_middle
from rb_sim.contact.stepping.scene_tables import (
    ALONE,
    BILATERAL,
    COMPLIANT,
    PERFECTLY_ROUGH,
    ROLLING,
    SPINNING,
    STATIC,
)
from rb_sim.contact.stepping.step_workspace import (
    LEAVES,
    NONE,
    ROUGH_SLIPS,
    SEVERAL,
    SLIDING,
    STILL,
    STRUCK,
    STUCK,
    TURNED,
)
from rb_sim.mechanics.systems.many_bodies import INVERSE, LOAD, MASS
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import add, dot, norm, perpendicular, scale, symmetric_times

AT_BOUND = 0.9
"""Share of the bound of friction from which on it is reached."""


@inline
def quieten(tables, workspace, n, h):
    """A velocity that is but the rounding of its terms is none."""
    b, u, sizes = tables.bodies, workspace.u, workspace.before
    for i in range(b.shape[0]):
        sizes[2 * i] = h * norm(triple(b, i, LOAD)) / b[i, MASS]
        gained = symmetric_times(six(b, i, INVERSE), triple(b, i, LOAD + 3))
        sizes[2 * i + 1] = h * norm(gained)
    for i in range(n):
        for k in range(LINES * i, LINES * i + 3):
            x, body, parent = abs(workspace.x[k]), workspace.ends[i, 0], workspace.ends[i, 1]
            sizes[2 * body] += x * workspace.rows[k, LIGHT_B]
            sizes[2 * body + 1] += x * norm(triple(workspace.rows, k, TURN_B))
            if parent >= 0:
                sizes[2 * parent] += x * workspace.rows[k, LIGHT_A]
                sizes[2 * parent + 1] += x * norm(triple(workspace.rows, k, TURN_A))
    for i in range(b.shape[0]):
        for part in range(2):
            v = triple(u, i, 3 * part)
            if norm(v) <= STILL * sizes[2 * i + part]:
                put(u, i, 3 * part, (0.0, 0.0, 0.0))


@inline
def work_done(workspace, n):
    """Work of the contacts on the bodies [J]: impulse times mean velocity, which with the loads'
    own is the change of kinetic energy exactly."""
    work = 0.0
    for i in range(n):
        b, a = workspace.ends[i, 0], workspace.ends[i, 1]
        for k in range(LINES * i, LINES * i + LINES):
            if workspace.x[k] != 0.0:
                mean = rate_of(workspace.rows, k, workspace.turning, b, a)
                mean += rate_of(workspace.rows, k, workspace.u, b, a)
                work += 0.5 * workspace.x[k] * mean
    return work


@inline
def gained_by(laws, workspace, n):
    """Energy that rigid contacts have given in the step [J], impulse times mean velocity over their
    supports'; by their laws they take some or none."""
    made = 0.0
    for i in range(n):
        c, b, a = workspace.active[i], workspace.ends[i, 0], workspace.ends[i, 1]
        if laws[c, COMPLIANT] == 1.0:
            continue
        moves = triple(workspace.spots, c, MOVES)
        for j in range(LINES):
            k = LINES * i + j
            if workspace.x[k] != 0.0:
                mean = rate_of(workspace.rows, k, workspace.turning, b, a) + rate_of(
                    workspace.rows, k, workspace.u, b, a
                )
                support = (
                    dot(triple(workspace.rows, k, 0), moves) if j < 3 else workspace.targets[k]
                )
                made += workspace.x[k] * (0.5 * mean - support)
    return made


@inline
def is_paradox(blocks, rows, targets, bends, y, i, b, a, mu, slow):
    """Whether contact i slips and has Painleve's paradox: friction against the slip that it had
    pulls its bodies together by more than the impulse along its normal drives them apart, so that
    several impulses fit, or none.  slow: slip that is none."""
    k, w = LINES * i, blocks
    s1 = speed_at(rows, k + 1, y, b, a) - targets[k + 1] - bends[i, 1]
    s2 = speed_at(rows, k + 2, y, b, a) - targets[k + 2] - bends[i, 2]
    slip = math.sqrt(s1 * s1 + s2 * s2)
    lifts = w[i, 0] * slip - mu * (w[i, 1] * s1 + w[i, 2] * s2)
    return slip > slow and lifts < 0.0


@inline
def slips_though_rough(laws, x, k, c):
    """Whether friction of a perfectly rough contact is at the bound that solvers set it: it would
    lift the contact as it stops the slip, and does no more than what keeps it down, so that the
    contact slips as with a very large coefficient."""
    across = math.sqrt(x[k + 1] * x[k + 1] + x[k + 2] * x[k + 2])
    return laws[c, STATIC] >= PERFECTLY_ROUGH and across > AT_BOUND * ROUGH * abs(x[k])


@inline
def keep_impulses(tables, memory, workspace, y, n, h):
    """Impulses and modes of the points that took part, for the next step and for reports."""
    x, laws, turned, several, rough = workspace.x, tables.laws, 0.0, 0.0, 0.0
    active, ends, spots, rules = workspace.active, workspace.ends, workspace.spots, workspace.rules
    rows, blocks, targets, u = workspace.rows, workspace.blocks, workspace.targets, workspace.u
    slow = LEAVES * tables.scales[1]
    for i in range(n):
        c, k, b, a = active[i], LINES * i, ends[i, 0], ends[i, 1]
        bears, mu = x[k] != 0.0, rules[i, BOUND]
        if laws[c, ALONE] != 0.0 and memory[c, CLOSED] != 0.0 and bears:
            turned = 1.0 if has_turned(memory, spots, y, c, b, h) else turned
        held = laws[c, BILATERAL] == 1.0 or laws[c, COMPLIANT] == 1.0
        moves = dot(triple(spots, c, NORMAL), triple(spots, c, MOVES))
        if memory[c, CLOSED] * memory[c, STAYS] != 0.0 and not held:  # its point has moved on
            closing = (
                2.0 * moves - rate_of(rows, k, workspace.turning, b, a) - rate_of(rows, k, u, b, a)
            )
            workspace.notes[STRUCK] += 0.5 * x[k] * max(0.0, closing)
        bore = bears or memory[c, CLOSED] != 0.0  # it may have gone where it could as well push
        slips = mu > 0.0 and memory[c, SLIDE] != STUCK
        if (
            slips
            and bore
            and is_paradox(blocks, rows, targets, workspace.bends, y, i, b, a, mu, slow)
        ):
            several = 1.0
        if slips_though_rough(laws, x, k, c):
            rough = 1.0
        normal = triple(spots, c, NORMAL)
        put(memory, c, ANCHOR, triple(spots, c, POINT))
        t1, t2 = perpendicular(normal)
        across = add(scale(x[k + 1], t1), scale(x[k + 2], t2))
        put(memory, c, IMPULSE, add(scale(x[k], normal), across))
        put(memory, c, AIM, scale(x[k] * rows[k, LIGHT_B], normal))
        turning = add(scale(x[k + 3], t1), scale(x[k + 4], t2))
        put(memory, c, TWIST, add(turning, scale(x[k + 5], normal)))
        leaving = rate_of(rows, k, u, b, a) - moves + workspace.bends[i, 0]
        note_middle(memory, spots, rows, u, c, k, t1, t2, b, a)
        memory[c, STAYS] = 1.0 if abs(leaving) <= slow else 0.0
        left = leaving > slow and not held
        memory[c, CLOSED] = 0.0 if x[k] == 0.0 or left else 1.0
        memory[c, SLIDE] = memory[c, ROLL] = memory[c, SPIN] = NONE
        if memory[c, CLOSED] == 0.0:
            continue
        nearly = abs(x[k]) * (1.0 - 1e-9)
        most = mu * nearly
        slides = norm(across) >= most or mu <= 0.0
        memory[c, SLIDE] = SLIDING if slides else STUCK
        if laws[c, ROLLING] > 0.0:
            rolls = norm(turning) >= laws[c, ROLLING] * nearly
            memory[c, ROLL] = SLIDING if rolls else STUCK
        if laws[c, SPINNING] > 0.0:
            spins = abs(x[k + 5]) >= laws[c, SPINNING] * nearly
            memory[c, SPIN] = SLIDING if spins else STUCK
    workspace.notes[TURNED] += turned
    workspace.notes[SEVERAL] += several
    workspace.notes[ROUGH_SLIPS] += rough
