# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One step of bodies in contact: impulses over the step, no events (Moreau 1988; Jean 1999).

Bodies move half a step at their old velocities and half at their new ones.  Between, where they
are then, one friction problem gives the impulses of all contacts and joints at once:

    J u+ >= -gap / h  along normals (e times the speed of approach back where it is an impact),
    Coulomb's law between impulse and slip after it,

where what touches already has the velocity that is none at the end of the step (see `bends`).

Impacts, stick and slip are spread over the step in which they happen: order 1, but any number of
contacts and any length of step.  What overlaps at the end is pushed apart.  The gyroscopic torque
is taken by the implicit midpoint rule; viscous friction and compliant supports implicitly.
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

# What is left to do once the impulses are known: rest, work, modes.


AT_BOUND = 0.9
"""Share of the bound of friction from which on it is reached."""


def quieten(tables, workspace, n, h):
    """A velocity that is but the rounding of its terms is none."""
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
            if norm(v) <= SOLVED * sizes[2 * i + part]:  # what rests does not creep
                keep(u, i, 3 * part, (0.0, 0.0, 0.0))


def work_done(workspace, n):
    """Work of the contacts on the bodies [J]: impulse times mean velocity, which with the loads'
    own is the change of kinetic energy exactly."""
    before, after, work = workspace.turning, workspace.u, 0.0
    for k in range(CONTACT_ROWS * n):
        if workspace.x[k] != 0.0:
            b, a = workspace.ends[k // CONTACT_ROWS, 0], workspace.ends[k // CONTACT_ROWS, 1]
            work += workspace.x[k] * mean_rate(workspace.rows, k, before, after, b, a)
    return work


def gained_by(laws, workspace, n):
    """Energy that rigid contacts have given in the step [J], impulse times mean velocity over their
    supports'; by their laws they take some or none."""
    made = 0.0
    for i in range(n):
        c, b, a = workspace.active[i], workspace.ends[i, 0], workspace.ends[i, 1]
        if laws[c, COMPLIANT] == 1.0:
            continue
        moves = vec(workspace.spots, c, MOVES)
        for j in range(CONTACT_ROWS):
            k = CONTACT_ROWS * i + j
            if workspace.x[k] != 0.0:
                mean = mean_rate(workspace.rows, k, workspace.turning, workspace.u, b, a)
                support = dot(vec(workspace.rows, k, 0), moves) if j < 3 else workspace.targets[k]
                made += workspace.x[k] * (mean - support)
    return made


def is_paradox(blocks, rows, targets, bends, y, i, b, a, mu, slow):
    """Whether contact i slips and has Painleve's paradox: friction against the slip that it had
    pulls its bodies together by more than the impulse along its normal drives them apart, so that
    several impulses fit, or none.  slow: slip that is none."""
    k, w = CONTACT_ROWS * i, blocks
    s1 = speed_at(rows, k + 1, y, b, a) - targets[k + 1] - bends[i, 1]
    s2 = speed_at(rows, k + 2, y, b, a) - targets[k + 2] - bends[i, 2]
    slip = math.sqrt(s1 * s1 + s2 * s2)
    lifts = w[i, 0] * slip - mu * (w[i, 1] * s1 + w[i, 2] * s2)
    return slip > slow and lifts < 0.0


def slips_though_rough(laws, x, k, c):
    """Whether friction of a perfectly rough contact is at the bound that solvers set it: it would
    lift the contact as it stops the slip, and does no more than what keeps it down, so that the
    contact slips as with a very large coefficient."""
    across = math.sqrt(x[k + 1] * x[k + 1] + x[k + 2] * x[k + 2])
    return laws[c, STATIC] >= PERFECTLY_ROUGH and across > AT_BOUND * ROUGH * abs(x[k])


def keep_impulses(tables, memory, workspace, y, n, h):
    """Impulses and modes of the points that took part, for the next step and for reports."""
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
        normal = vec(spots, c, NORMAL)
        keep(memory, c, ANCHOR, vec(spots, c, POINT))
        t1, t2 = perpendicular(normal)
        across = add(scale(x[k + 1], t1), scale(x[k + 2], t2))
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


# Rebounds that would create energy.
#
# Newton's restitution along the normal and Coulomb's friction across it may together give more
# energy than the impact has taken (Kane and Levinson 1985): friction works on the mean of the slips
# before and after, which point in different directions.  There Poisson's law holds, as in
# `impacts`: the normal impulse is at least 1 + e times what it is without a rebound; and none
# rebounds if that gives energy too.  Energy is that of the whole impact of a body: of several
# corners that strike at once some may gain what others lose.


GAINS = 1e-5
"""Work of an impact, relative to impulse times speed of rebound, above which the impact creates
energy; solvers leave up to 1e-6, where the corners of a box press against each other by
friction."""


def support_speed(workspace, i, c):
    """Speed along the normal of contact i, point c, at which its surfaces stay together."""
    return dot(vec(workspace.spots, c, NORMAL), vec(workspace.spots, c, MOVES))


def rebound_of(workspace, i, c):
    """Speed with which contact i, point c, rebounds: Newton's, or what Poisson's law has given."""
    k, speed = CONTACT_ROWS * i, workspace.targets[CONTACT_ROWS * i]
    if workspace.rules[i, LEAST] > 0.0:
        b, a = workspace.ends[i, 0], workspace.ends[i, 1]
        speed = rate_of(workspace.rows, k, workspace.u, b, a)
    return speed - support_speed(workspace, i, c)


def bounces(tables, c):
    """True of a point that rebounds, if it is struck."""
    return tables.laws[c, RESTITUTION] > 0.0 and tables.laws[c, COMPLIANT] == 0.0


def made_in(workspace, y, i, c):
    """(energy that friction makes at contact i, which is point c [J], that which its normal
    impulse makes [J], what its rebound takes [J]) in an impact; zeros where it does not rebound.
    y: before it."""
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


def creates(across, along, taken):
    """Whether friction makes energy that the normal impulse does not take."""
    return across > 0.0 and across + along > GAINS * taken


def add_to(total, body, made, taken):
    """Add the energies of one point to those of a body; -1: the surroundings."""
    if body >= 0:
        total[body, 0] += made
        total[body, 1] += taken


def gains(total, workspace, i):
    """Whether the impact of a body of contact i creates energy, over all points that it has."""
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
    """Take away the rebounds that create energy; how many there are.  restitution: e of those that
    have been Newton's, else 0, (n,)."""
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
        if bounces(tables, c) and creates(across, along, taken) and gains(total, workspace, i):
            if workspace.rules[i, LEAST] > 0.0:
                workspace.rules[i, LEAST] = 0.0
            else:
                restitution[i] = tables.laws[c, RESTITUTION]
                workspace.targets[k] = support_speed(workspace, i, c)
            count += 1
    return count


def fastest_of(tables, y):
    """Speed [m/s] that no surface exceeds, or the scene's if that is more."""
    fastest = tables.scales[1]
    for i in range(tables.bodies.shape[0]):
        B = state_of(y, i)
        fastest = max(fastest, norm(B.v_WC) + tables.scales[0] * norm(B.w_WB_B))
    return fastest


def after_turn(q, w, h):
    """q after the turn w h, body axes, exactly."""
    angle = 0.5 * h * norm(w)
    s = 0.5 * h if angle < 1e-8 else 0.5 * h * math.sin(angle) / angle
    if s * norm(w) == 0.0:
        return q
    return quaternion_unit(quaternion_product(q, (s * w[0], s * w[1], s * w[2], math.cos(angle))))


def spin_after(inertia, inverse, w, h):
    """Spin after h without torque (body axes), by the implicit midpoint rule; as it was where its
    rounds do not converge: too much turn in one step."""
    w1 = w
    if w[0] == 0.0 and w[1] == 0.0 and w[2] == 0.0:  # as of all that rests in a heap
        return w
    for _ in range(GYROSCOPIC_ROUNDS):
        mean = scale(0.5, add(w, w1))
        w1 = sub(w, scale(h, symmetric_times(inverse, gyroscopic(inertia, mean))))
    left = dot(w, symmetric_times(inertia, w)) - dot(w1, symmetric_times(inertia, w1))
    if not abs(left) <= 1e-6 * dot(w, symmetric_times(inertia, w)):
        return w
    return w1


def move(y, i, d, turn, h):
    """Move body i by h d, and turn it by h times `turn` (body axes)."""
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


def load_gravity(tables):
    """Loads of uniform gravity alone."""
    b = tables.bodies
    for i in range(b.shape[0]):
        for j in range(3):
            b[i, LOAD + j] = b[i, MASS] * tables.gravity[i, j]
            b[i, LOAD + 3 + j] = 0.0


def free_velocities(tables, workspace, y, h):
    """Velocities with the loads of h, without any reaction, into workspace.u, as in the middle of a
    step: half of the gyroscopic torque acts before constraints do, and half after."""
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


def is_quiet(tables, y):
    """Whether all bodies are slow."""
    for i in range(tables.bodies.shape[0]):
        B = state_of(y, i)
        speed = norm(B.v_WC) + tables.scales[0] * norm(B.w_WB_B)
        if speed > QUIET * tables.scales[1]:
            return False
    return True


def solve_impulses(tables, workspace, graph, x, y):
    """Impulses of all contacts and joints; (change of the last sweep, sweeps made).

    Shares that the laws leave open are the least ones, but in heaps; where the impulses of the step
    before hold as they are, they are so already.
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
    """As `solve_impulses`, with any shares, after some sweeps and their last change.

    A heap that rests is solved to the last digits by many sweeps and Newton's method, after which
    some steps go without, more where they did not get there.  One that moves gets few sweeps and,
    where they do not do, Newton's method as far as the step needs it.
    """
    u, joints, length, notes = workspace.u, workspace.joint_x, tables.scales[0], workspace.notes
    if not rest > COMPUTED_ROUNDING:
        return rest, made
    if notes[FRESH] == 1.0 or (is_quiet(tables, y) and notes[STEPS] >= notes[NEXT]):
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
        else:  # as near as Newton's method would have to come
            rest = 0.0
        notes[GAVE] = max(notes[GAVE], given)
        rest = given if given > LOOSE else rest
    elif rest > ENOUGH:
        sweeps = SWEEPS - FEW_SWEEPS
        rest, more = gauss_seidel(graph, u, x, joints, length, ENOUGH, sweeps)
        made += more
    return rest, made


def solve_without_gain(tables, workspace, graph, x, y):
    """As `solve_impulses`, with rebounds that create no energy."""
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
    notes[WORK], notes[ACTIVE] = work_done(workspace, n), n
    notes[GAINED] = gained_by(tables.laws, workspace, n)
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
