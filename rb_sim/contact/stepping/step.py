# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One step of bodies in contact: impulses over the step, no events (Moreau 1988; Jean 1999).

Bodies move half a step with their old velocities and half a step with the new ones. At the middle,
one friction problem determines the impulses of all contacts and joints together:

    J u+ >= -gap / h  along normals (rebound with e times the speed of approach in an impact),
    Coulomb's law between impulse and slip after it,

and the normal velocity of contacts that were closed becomes zero at the end of the step (bends, see
geometry).

Impacts, sticking and slip are spread over the step in which they happen: the method has order 1,
but allows any number of contacts and any step. Bodies that overlap at the end are separated. The
gyroscopic torque is integrated by the implicit midpoint rule; viscous friction and compliant
supports are implicit as well.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING, SOLVED, SOLVED_IN_CONTACT
from rb_sim.contact.few_contacts import are_few, solve_few
from rb_sim.contact.gauss_seidel import (
    ROUGH,
    factor_joints,
    fill_block,
    gauss_seidel,
    is_plain,
)
from rb_sim.contact.problem import (
    BOUND,
    CONTACT_ROWS,
    ENOUGH,
    FINE,
    LEAST,
    LIGHT_A,
    LIGHT_B,
    TURN_A,
    TURN_B,
    add_impulse,
    mean_rate,
    rate_of,
)
from rb_sim.contact.proximal_newton import LOOSE, proximal_newton, solve_exactly, sweep_near
from rb_sim.contact.stepping.constraint_rows import gather, gather_joints, graph_of, speed_at
from rb_sim.contact.stepping.geometry import has_turned, note_middle
from rb_sim.contact.stepping.scene_tables import ALONE, PERFECTLY_ROUGH
from rb_sim.contact.stepping.step_workspace import (
    ACTIVE,
    AIM,
    ALL_SWEEPS,
    ANCHOR,
    CLOSED,
    FEW_SWEEPS,
    FIRST_SWEEPS,
    FRESH,
    GAINED,
    GAVE,
    GYROSCOPIC_ROUNDS,
    IMPULSE,
    LENGTH,
    MOVES,
    NEXT,
    NORMAL,
    OFTEN,
    OPEN,
    OPEN_NOW,
    OPEN_OF_NOW,
    POINT,
    QUIET,
    RESIDUAL,
    ROLL,
    ROUGH_SLIPS,
    SELDOM,
    SEVERAL,
    SLIDE,
    SPIN,
    STAYS,
    STEPS,
    STRUCK,
    SWEEPS,
    SWEPT,
    TURNED,
    TWIST,
    UNSOLVED,
    WORK,
    WORST,
)
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    COMPLIANT,
    RESTITUTION,
    ROLLING_ARM,
    SPINNING_ARM,
    STATIC,
    keep,
)
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.systems.many_bodies import INERTIA, INVERSE, LOAD, MASS, six, state_of, vec
from rb_sim.mechanics.systems.many_bodies import WIDTH as STATE
from rb_sim.numerics.vectors import (
    add,
    dot,
    gyroscopic,
    norm,
    perpendicular,
    quaternion_product,
    quaternion_unit,
    scale,
    sub,
    symmetric_times,
)

# After the solution: bodies at rest, work, modes.


AT_BOUND = 0.9
"""Fraction of the largest friction at which a perfectly rough contact counts as slipping."""


def quieten(tables, workspace, n, h):
    """Set velocities to zero that are only rounding of their terms, so that bodies at rest do not
    creep."""
    b, u, sizes = tables.bodies, workspace.u, workspace.before
    for i in range(b.shape[0]):
        sizes[2 * i] = h * norm(vec(b, i, LOAD)) / b[i, MASS]
        gained = symmetric_times(six(b, i, INVERSE), vec(b, i, LOAD + 3))
        sizes[2 * i + 1] = h * norm(gained)
    for i in range(n):
        for k in range(CONTACT_ROWS * i, CONTACT_ROWS * i + 3):
            x, body, parent = abs(workspace.x[k]), workspace.ends[i, 0], workspace.ends[i, 1]
            sizes[2 * body] += x * workspace.rows[k, LIGHT_B]
            sizes[2 * body + 1] += x * norm(vec(workspace.rows, k, TURN_B))
            if parent >= 0:
                sizes[2 * parent] += x * workspace.rows[k, LIGHT_A]
                sizes[2 * parent + 1] += x * norm(vec(workspace.rows, k, TURN_A))
    for i in range(b.shape[0]):
        for part in range(2):
            v = vec(u, i, 3 * part)
            if norm(v) <= SOLVED * sizes[2 * i + part]:
                keep(u, i, 3 * part, (0.0, 0.0, 0.0))


def works(laws, workspace, n):
    """(work of the contacts on the bodies [J], energy gained in rigid contacts [J]).

    Impulse times mean velocity, which together with the work of the loads is exactly the change of
    kinetic energy; and impulse times mean velocity relative to the support, which by the laws of
    rigid contacts is not positive.
    """
    work, gained = 0.0, 0.0
    for i in range(n):
        c, b, a = workspace.active[i], workspace.ends[i, 0], workspace.ends[i, 1]
        moves = vec(workspace.spots, c, MOVES)
        for j in range(CONTACT_ROWS):
            k = CONTACT_ROWS * i + j
            if workspace.x[k] != 0.0:
                mean = mean_rate(workspace.rows, k, workspace.turning, workspace.u, b, a)
                work += workspace.x[k] * mean
                support = dot(vec(workspace.rows, k, 0), moves) if j < 3 else workspace.targets[k]
                if laws[c, COMPLIANT] == 0.0:
                    gained += workspace.x[k] * (mean - support)
    return work, gained


def is_paradox(blocks, rows, targets, bends, y, i, b, a, mu, slow):
    """Whether contact i slips and has Painleve's paradox: friction against its slip pulls the
    bodies together by more than the normal impulse separates them, so that there are several
    solutions or none. slow: slip that counts as zero."""
    k, w = CONTACT_ROWS * i, blocks
    s1 = speed_at(rows, k + 1, y, b, a) - targets[k + 1] - bends[i, 1]
    s2 = speed_at(rows, k + 2, y, b, a) - targets[k + 2] - bends[i, 2]
    slip = math.sqrt(s1 * s1 + s2 * s2)
    lifts = w[i, 0] * slip - mu * (w[i, 1] * s1 + w[i, 2] * s2)
    return slip > slow and lifts < 0.0


def keep_impulses(tables, memory, workspace, y, n, h):
    """Store impulses and modes of the active points, for the next step and for samples."""
    x, laws, turned, several, rough = workspace.x, tables.laws, 0.0, 0.0, 0.0
    active, ends, spots, rules = workspace.active, workspace.ends, workspace.spots, workspace.rules
    rows, blocks, targets, u = workspace.rows, workspace.blocks, workspace.targets, workspace.u
    slow = SOLVED * tables.scales[1]
    for i in range(n):
        c, k, b, a = active[i], CONTACT_ROWS * i, ends[i, 0], ends[i, 1]
        bears, mu = x[k] != 0.0, rules[i, BOUND]
        if laws[c, ALONE] != 0.0 and memory[c, CLOSED] != 0.0 and bears:
            turned = 1.0 if has_turned(memory, spots, y, c, b, h) else turned
        held = laws[c, BILATERAL] == 1.0 or laws[c, COMPLIANT] == 1.0
        moves = dot(vec(spots, c, NORMAL), vec(spots, c, MOVES))
        if memory[c, CLOSED] * memory[c, STAYS] != 0.0 and not held:  # its point has moved
            closing = (
                2.0 * moves - rate_of(rows, k, workspace.turning, b, a) - rate_of(rows, k, u, b, a)
            )
            workspace.notes[STRUCK] += 0.5 * x[k] * max(0.0, closing)
        bore = bears or memory[c, CLOSED] != 0.0  # the other solution may be closed
        slips = mu > 0.0 and memory[c, SLIDE] != STUCK
        if (
            slips
            and bore
            and is_paradox(blocks, rows, targets, workspace.bends, y, i, b, a, mu, slow)
        ):
            several = 1.0
        normal = vec(spots, c, NORMAL)
        keep(memory, c, ANCHOR, vec(spots, c, POINT))
        t1, t2 = perpendicular(normal)
        across = add(scale(x[k + 1], t1), scale(x[k + 2], t2))
        if laws[c, STATIC] >= PERFECTLY_ROUGH and norm(across) > AT_BOUND * ROUGH * abs(x[k]):
            rough = 1.0  # friction is at the solver's bound: more would lift the contact
        keep(memory, c, IMPULSE, add(scale(x[k], normal), across))
        keep(memory, c, AIM, scale(x[k] * rows[k, LIGHT_B], normal))
        turning = add(scale(x[k + 3], t1), scale(x[k + 4], t2))
        keep(memory, c, TWIST, add(turning, scale(x[k + 5], normal)))
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
        if laws[c, ROLLING_ARM] > 0.0:
            rolls = norm(turning) >= laws[c, ROLLING_ARM] * nearly
            memory[c, ROLL] = SLIDING if rolls else STUCK
        if laws[c, SPINNING_ARM] > 0.0:
            spins = abs(x[k + 5]) >= laws[c, SPINNING_ARM] * nearly
            memory[c, SPIN] = SLIDING if spins else STUCK
    workspace.notes[TURNED] += turned
    workspace.notes[SEVERAL] += several
    workspace.notes[ROUGH_SLIPS] += rough


# Rebounds that would increase the energy.
#
# Newton's restitution and Coulomb's friction together may increase the energy (Kane and Levinson
# 1985), since friction works on the mean of the slips before and after the impact, which may have
# different directions. Then Poisson's law is used, as in `impacts`: the normal impulse is at least
# 1 + e times that without a rebound; and no rebound if that increases the energy as well. The
# energy is that of the whole impact of a body: if several corners hit together, some may gain what
# others lose.


GAINS = 1e-5
"""Work of an impact, relative to impulse times speed of rebound, above which it increases the
energy; solvers leave up to 1e-6 if friction presses the corners of a box against each other."""


def support_speed(workspace, i, c):
    """Normal speed of the support of contact i, point c."""
    return dot(vec(workspace.spots, c, NORMAL), vec(workspace.spots, c, MOVES))


def rebound_of(workspace, i, c):
    """Speed of rebound of contact i, point c, by Newton's or Poisson's law."""
    k, speed = CONTACT_ROWS * i, workspace.targets[CONTACT_ROWS * i]
    if workspace.rules[i, LEAST] > 0.0:
        b, a = workspace.ends[i, 0], workspace.ends[i, 1]
        speed = rate_of(workspace.rows, k, workspace.u, b, a)
    return speed - support_speed(workspace, i, c)


def bounces(tables, c):
    """Whether point c rebounds in an impact."""
    return tables.laws[c, RESTITUTION] > 0.0 and tables.laws[c, COMPLIANT] == 0.0


def made_in(workspace, y, i, c):
    """(work of friction at contact i, point c, work of its normal impulse, impulse times speed of
    rebound) in an impact [J]; zeros without a rebound. y: state before it."""
    b, a, k, across = workspace.ends[i, 0], workspace.ends[i, 1], CONTACT_ROWS * i, 0.0
    rebound = rebound_of(workspace, i, c)
    if not rebound > 0.0 or not workspace.x[k] > 0.0:
        return 0.0, 0.0, 0.0
    for j in range(1, CONTACT_ROWS):
        if workspace.x[k + j] != 0.0:
            mean = speed_at(workspace.rows, k + j, y, b, a) + rate_of(
                workspace.rows, k + j, workspace.u, b, a
            )
            across += workspace.x[k + j] * (0.5 * mean - workspace.targets[k + j])
    mean = speed_at(workspace.rows, k, y, b, a) + rate_of(workspace.rows, k, workspace.u, b, a)
    along = workspace.x[k] * (0.5 * mean - support_speed(workspace, i, c))
    return across, along, workspace.x[k] * rebound


def add_to(total, body, made, taken):
    """Add the energies of one point to those of a body; -1: the world."""
    if body >= 0:
        total[body, 0] += made
        total[body, 1] += taken


def gains(total, workspace, i):
    """Whether the impact of a body of contact i, over all its points, increases the energy."""
    b, a = workspace.ends[i, 0], workspace.ends[i, 1]
    return total[b, 0] > GAINS * total[b, 1] or (a >= 0 and total[a, 0] > GAINS * total[a, 1])


def some_rebound(tables, workspace, n):
    """Whether any contact rebounds in this step."""
    for i in range(n):
        c = workspace.active[i]
        if bounces(tables, c) and rebound_of(workspace, i, c) > 0.0:
            return True
    return False


def take_gains(tables, workspace, y, n, restitution):
    """Remove the rebounds that increase the energy; returns their number. restitution: becomes e
    for those by Newton's law, else 0, (n,)."""
    count, total = 0, np.zeros((tables.bodies.shape[0], 2))
    for i in range(n):
        if bounces(tables, workspace.active[i]):
            across, along, taken = made_in(workspace, y, i, workspace.active[i])
            add_to(total, workspace.ends[i, 0], across + along, taken)
            add_to(total, workspace.ends[i, 1], across + along, taken)
    for i in range(n):
        c, k = workspace.active[i], CONTACT_ROWS * i
        restitution[i] = 0.0
        across, along, taken = made_in(workspace, y, i, c)
        # friction does work, and more than the normal impulse dissipates
        creates = across > 0.0 and across + along > GAINS * taken
        if bounces(tables, c) and creates and gains(total, workspace, i):
            if workspace.rules[i, LEAST] > 0.0:
                workspace.rules[i, LEAST] = 0.0
            else:
                restitution[i] = tables.laws[c, RESTITUTION]
                workspace.targets[k] = support_speed(workspace, i, c)
            count += 1
    return count


def fastest_of(tables, y):
    """Upper bound of the speed of all surfaces [m/s]."""
    fastest = 0.0
    for i in range(tables.bodies.shape[0]):
        B = state_of(y, i)
        fastest = max(fastest, norm(B.v_WC) + tables.scales[0] * norm(B.w_WB_B))
    return fastest


def after_turn(q, w, h):
    """q after the rotation w h, body axes."""
    angle = 0.5 * h * norm(w)
    s = 0.5 * h if angle < 1e-8 else 0.5 * h * math.sin(angle) / angle
    if s * norm(w) == 0.0:
        return q
    return quaternion_unit(quaternion_product(q, (s * w[0], s * w[1], s * w[2], math.cos(angle))))


def spin_after(inertia, inverse, w, h):
    """Angular velocity after h without torque (body axes), by the implicit midpoint rule; unchanged
    if the iteration does not converge (too much rotation in one step)."""
    w1 = w
    if w[0] == 0.0 and w[1] == 0.0 and w[2] == 0.0:
        return w
    for _ in range(GYROSCOPIC_ROUNDS):
        mean = scale(0.5, add(w, w1))
        w1 = sub(w, scale(h, symmetric_times(inverse, gyroscopic(inertia, mean))))
    left = dot(w, symmetric_times(inertia, w)) - dot(w1, symmetric_times(inertia, w1))
    if not abs(left) <= 1e-6 * dot(w, symmetric_times(inertia, w)):
        return w
    return w1


def move(y, i, d, turn, h):
    """Move body i by h d and rotate it by h times `turn` (body axes)."""
    k = STATE * i
    q = after_turn((y[k + 3], y[k + 4], y[k + 5], y[k + 6]), turn, h)
    for j in range(3):
        y[k + j] += h * d[j]
    for j in range(4):
        y[k + 3 + j] = q[j]


def drift(tables, y, h):
    """Move all bodies by h at their own velocities, in place."""
    for i in range(tables.bodies.shape[0]):
        k = STATE * i
        move(y, i, (y[k + 7], y[k + 8], y[k + 9]), (y[k + 10], y[k + 11], y[k + 12]), h)


def free_velocities(tables, workspace, y, h):
    """Write the velocities at the middle of a step without reactions to workspace.u: with all loads
    over h, and half of the gyroscopic torque; the other half acts after the reactions."""
    b, u = tables.bodies, workspace.u
    for i in range(b.shape[0]):
        k = STATE * i
        w = (y[k + 10], y[k + 11], y[k + 12])
        inverse = six(b, i, INVERSE)
        w = spin_after(six(b, i, INERTIA), inverse, w, 0.5 * h)
        gained = symmetric_times(inverse, vec(b, i, LOAD + 3))
        for j in range(3):
            workspace.turning[i, j], workspace.turning[i, 3 + j] = y[k + 7 + j], w[j]
            u[i, j] = y[k + 7 + j] + h * b[i, LOAD + j] / b[i, MASS]
            u[i, 3 + j] = w[j] + h * gained[j]


def solve_impulses(tables, workspace, graph, x, y):
    """Solve for the impulses of all contacts and joints; returns (residual, number of sweeps).

    Impulses that are not unique are the least ones, except in heaps.
    """
    u, joints, length, notes = workspace.u, workspace.joint_x, tables.scales[0], workspace.notes
    notes[OPEN_NOW] = 0.0
    rest, made = gauss_seidel(graph, u, x, joints, length, COMPUTED_ROUNDING, FEW_SWEEPS)
    if not are_few(graph):
        return of_heap(tables, workspace, graph, x, y, rest, made)
    if made > 1 and (rest > ENOUGH or graph.ends.shape[0] > 1):
        slow = SOLVED * tables.scales[1]
        given, figure, of = solve_few(graph, u, x, joints, slow, length, notes[OPEN] == 0.0)
        notes[GAVE], notes[OPEN_NOW] = max(notes[GAVE], given), figure
        rest = given if given > FINE else 0.0
        if figure > 0.0:
            notes[OPEN_OF_NOW] = workspace.active[of]
    return rest, made


def of_heap(tables, workspace, graph, x, y, rest, made):
    """As `solve_impulses`, for a heap; rest, made: residual and number of sweeps so far.

    A heap at rest is solved to rounding by many sweeps and Newton's method, not in every step. A
    moving heap gets few sweeps and, if these do not suffice, Newton's method to the step's
    tolerance.
    """
    u, joints, length, notes = workspace.u, workspace.joint_x, tables.scales[0], workspace.notes
    if not rest > COMPUTED_ROUNDING:
        return rest, made
    quiet = fastest_of(tables, y) <= QUIET * tables.scales[1]
    if notes[FRESH] == 1.0 or (quiet and notes[STEPS] >= notes[NEXT]):
        sweeps = FIRST_SWEEPS if notes[FRESH] == 1.0 else SWEEPS
        n = graph.ends.shape[0]
        rest, more = solve_exactly(
            graph, tables.bodies, u, x, joints, length, COMPUTED_ROUNDING, sweeps
        )
        made += more
        often = OFTEN if not rest > COMPUTED_ROUNDING else SELDOM
        notes[NEXT] = notes[STEPS] + often * n * n
    if rest > ENOUGH and is_plain(graph):
        given, more = sweep_near(graph, u, x, FINE)
        made += more
        if given > FINE:
            rest, given, more = proximal_newton(graph, tables.bodies, u, x, FINE)
            made += more
        else:  # within the tolerance of Newton's method
            rest = 0.0
        notes[GAVE] = max(notes[GAVE], given)
        rest = given if given > LOOSE else rest
    elif rest > ENOUGH:
        sweeps = SWEEPS - FEW_SWEEPS
        rest, more = gauss_seidel(graph, u, x, joints, length, ENOUGH, sweeps)
        made += more
    return rest, made


def solve_without_gain(tables, workspace, graph, x, y):
    """As `solve_impulses`, with rebounds that do not increase the energy."""
    rest, made = solve_impulses(tables, workspace, graph, x, y)
    n = graph.ends.shape[0]
    if not some_rebound(tables, workspace, n):
        return rest, made
    restitution = np.empty(n)
    if take_gains(tables, workspace, y, n, restitution) == 0:
        return rest, made
    rest, more = solve_impulses(tables, workspace, graph, x, y)
    for i in range(n):
        if restitution[i] > 0.0:
            workspace.rules[i, LEAST] = (1.0 + restitution[i]) * x[CONTACT_ROWS * i]
    rest, again = solve_impulses(tables, workspace, graph, x, y)
    made += more + again
    if take_gains(tables, workspace, y, n, restitution) > 0:
        rest, more = solve_impulses(tables, workspace, graph, x, y)
        made += more
    return rest, made


def solve_step(tables, memory, workspace, y, h):
    """New velocities of all bodies, from the spots at the middle of the step; y in place."""
    free_velocities(tables, workspace, y, h)
    for c in range(workspace.x.shape[0]):
        workspace.x[c] = 0.0
    n = gather(tables, memory, workspace, y, h)
    gather_joints(tables, workspace, h)
    graph, u = graph_of(tables, workspace, n), workspace.u
    for i in range(n):
        fill_block(graph, i)
        for k in range(CONTACT_ROWS * i, CONTACT_ROWS * i + CONTACT_ROWS):
            if workspace.x[k] != 0.0:
                add_impulse(
                    workspace.rows, k, u, workspace.ends[i, 0], workspace.ends[i, 1], workspace.x[k]
                )
    for k in range(tables.joints.shape[0]):
        add_impulse(
            workspace.joint_rows,
            k,
            u,
            tables.joints[k, 0],
            tables.joints[k, 1],
            workspace.joint_x[k],
        )
    if workspace.joint_factor.shape[0] > 0:
        factor_joints(graph, u.shape[0])
    x = workspace.x[: CONTACT_ROWS * n]
    rest, made = solve_without_gain(tables, workspace, graph, x, y)
    quieten(tables, workspace, n, h)
    notes = workspace.notes
    notes[WORK], notes[GAINED] = works(tables.laws, workspace, n)
    notes[ACTIVE] = n
    notes[RESIDUAL], notes[SWEPT] = rest, made
    notes[STEPS], notes[ALL_SWEEPS] = notes[STEPS] + 1.0, notes[ALL_SWEEPS] + made
    notes[WORST] = max(notes[WORST], rest)
    notes[UNSOLVED] += 1.0 if rest > SOLVED_IN_CONTACT else 0.0
    notes[LENGTH], notes[FRESH] = h, 0.0
    keep_impulses(tables, memory, workspace, y, n, h)
    for i in range(u.shape[0]):
        b = tables.bodies
        w = spin_after(six(b, i, INERTIA), six(b, i, INVERSE), vec(u, i, 3), 0.5 * h)
        for j in range(3):
            y[STATE * i + 7 + j], y[STATE * i + 10 + j] = u[i, j], w[j]
