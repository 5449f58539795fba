"""Time stepping for bodies in contact: impulses over a step, no events (Moreau 1988; Jean 1999).

Positions move half a step with the old velocities and half with the new; between, one problem of
complementarity with friction gives the impulses of all contacts and joints at once, by projected
Gauss-Seidel sweeps.  Impacts, stick and slip are spread over the step in which they happen: order
1, but any number of contacts and any length of step.  The gyroscopic torque is taken by the
implicit midpoint rule, springs and viscous friction implicitly, so that long steps stay bounded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rb_sim.catalogue.constraints.rows import RATE, put
from rb_sim.engine.methods.method import AT, DY, increment
from rb_sim.engine.methods.tuples import copy
from rb_sim.engine.systems.contact_bodies import (
    AROUND,
    BILATERAL,
    BOUND,
    CLOSED,
    COMPLIANT,
    DAMPING,
    DIRECT,
    GAP,
    GAP_BEFORE,
    GAP_RATE,
    KINETIC,
    NORMAL,
    POINT,
    RESTITUTION,
    ROLL,
    ROLLING_ARM,
    SLIDE,
    SLIDE_FROM,
    SLIDE_TO,
    SLIDING,
    SLIP,
    SPIN,
    SPINNING_ARM,
    STATIC,
    STEP_FROM,
    STEP_TO,
    STIFFNESS,
    STUCK,
    TRACTION,
    VISCOUS,
    VISCOUS_PER_NORMAL,
    WAS_CLOSED,
    WAS_STUCK,
    line_of,
)
from rb_sim.engine.systems.many_bodies import (
    BODY,
    INERTIA,
    INVERSE,
    LOAD,
    MASS,
    MULTIPLIERS,
    PARENT,
    PUSH,
    RIGHT,
    WIDTH,
    apply_effects,
    six,
    state_of,
    vec,
)
from rb_sim.engine.systems.multipliers import (
    add_multipliers,
    clear_loads,
    clear_push,
    fill_matrix,
    project_positions,
    row_times_push,
    row_velocity,
    settle_bodies,
    write_rows,
)
from rb_sim.maths.jit import inline, plain
from rb_sim.maths.vectors import (
    add,
    cross,
    dot,
    gyroscopic,
    norm,
    quaternion_product,
    quaternion_unit,
    scale,
    sub,
    symmetric_times,
    unrotate,
)

SWEEPS = 2000
SETTLED = 1e-13
"""Change of an impulse in one sweep, relative to the largest, at which the sweeps end."""
FLAT = 1e-12
"""Area of a pair of lines, relative to the square of the larger, below which they are one."""
NEAR = 1e-9
"""Gap, relative to the scene's length, at which a contact takes part whatever its speed."""
LEAVES = 1e-9
"""Speed, relative to the scene's, above which a contact has been left."""
APART = 1e-3
"""Gap at the end of a step, relative to the scene's length, above which a contact is open though it
has pushed: it turned away, and to close the gap again would be no small correction."""
SAME = 1e-6
"""Of a step, by which the end of one and the start of the next may differ by rounding."""
GYROSCOPIC_ROUNDS = 6
PUSH_ROUNDS, SHIFT_ROUNDS, OVERLAP = 4, 40, 1e-12
"""Rounds of moving bodies apart, and the overlap relative to the scene's length at which it is
done."""


class TimeStepping(NamedTuple):
    """Fixed step [s]."""

    step: float


@inline
def turned(q, w, h):
    """q after the turn w h, body axes, exactly."""
    angle = 0.5 * h * norm(w)
    s = 0.5 * h if angle < 1e-8 else 0.5 * h * math.sin(angle) / angle
    return quaternion_unit(quaternion_product(q, (s * w[0], s * w[1], s * w[2], math.cos(angle))))


@inline
def spin_after(inertia, inverse, w, torque, h):
    """Spin after h under a torque (body axes), by the implicit midpoint rule."""
    w1 = w
    for _ in range(GYROSCOPIC_ROUNDS):
        mean = scale(0.5, add(w, w1))
        w1 = add(w, scale(h, symmetric_times(inverse, sub(torque, gyroscopic(inertia, mean)))))
    change, most = sub(w1, w), norm(w) + h * norm(symmetric_times(inverse, torque))
    if not norm(w1) <= 2.0 * most:  # the rounds do not converge: too much turn in one step
        return add(w, scale(h, symmetric_times(inverse, torque)))
    return add(w, change)


@plain
def drift(system, y, h):
    """Move all bodies by h at their own velocities, in place."""
    for i in range(system.bodies.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        q = turned(B.q_WB, B.w_WB_B, h)
        for j in range(3):
            y[k + j] += h * B.v_WC[j]
        for j in range(4):
            y[k + 3 + j] = q[j]


@plain
def free_velocities(system, t, y, h):
    """y's velocities after h without any reaction, in place."""
    clear_loads(system)
    apply_effects(system.effects, t, system, y)
    for i in range(system.bodies.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        a = scale(1.0 / system.bodies[i, MASS], vec(system.bodies, i, LOAD))
        inertia, inverse = six(system.bodies, i, INERTIA), six(system.bodies, i, INVERSE)
        w = spin_after(inertia, inverse, B.w_WB_B, vec(system.bodies, i, LOAD + 3), h)
        for j in range(3):
            y[k + 7 + j] += h * a[j]
            y[k + 10 + j] = w[j]


@inline
def slip_traction(touch, c):
    """Size of the traction at contact c that does not wait for N."""
    n, direct = vec(touch, c, NORMAL), vec(touch, c, DIRECT)
    if touch[c, TRACTION] > 0.0:  # of a compliant contact it is there already, for the N it has
        return 0.0
    return norm(sub(direct, scale(dot(direct, n), n)))


@plain
def note_gaps(system, t, y):
    """Keep the gaps at the beginning of a step."""
    write_rows(system, t, y)
    for c in range(system.touch.shape[0]):
        system.touch[c, GAP_BEFORE] = system.touch[c, GAP]


@inline
def turned_away(touch, c, rate, h):
    """What contact c has come off its support by in half a step because its path, or the support,
    is curved [m]: it does so once more in the other half.  rate: of the gap, by then."""
    return max(touch[c, GAP_BEFORE] - touch[c, GAP] + 0.5 * h * rate, 0.0)


@plain
def recall_modes(system, t, h):
    """SLIDE as it was at t, from where the step starts: a sample within the step before may have
    been the last to write it."""
    touch = system.touch
    for c in range(touch.shape[0]):
        if t != touch[c, STEP_FROM]:
            follows = abs(t - touch[c, STEP_TO]) <= SAME * h
            touch[c, SLIDE_FROM] = touch[c, SLIDE_TO] if follows else touch[c, SLIDE]
            touch[c, STEP_FROM], touch[c, STEP_TO] = t, t
        touch[c, SLIDE] = touch[c, SLIDE_FROM]


@plain
def keep_modes(system, t, h):
    """Note SLIDE at t + h, the end of the step, for the next one."""
    touch = system.touch
    for c in range(touch.shape[0]):
        if t + h > touch[c, STEP_TO]:
            touch[c, STEP_TO], touch[c, SLIDE_TO] = t + h, touch[c, SLIDE]


@plain
def take_part(system, t, y, free, h):
    """Close, as if stuck, the contacts that the next half step h reaches at the free velocities or
    those of y; open the others."""
    touch = system.touch
    for c in range(touch.shape[0]):
        touch[c, WAS_STUCK] = touch[c, SLIDE]
        touch[c, CLOSED], touch[c, SLIDE] = 1.0, SLIDING
    write_rows(system, t, y)
    for c in range(touch.shape[0]):
        slip = norm(vec(touch, c, SLIP))
        direct = slip_traction(touch, c)
        touch[c, VISCOUS_PER_NORMAL] = touch[c, TRACTION] / slip if slip > 0.0 else 0.0
        touch[c, VISCOUS] = direct / slip if slip > 0.0 else 0.0
        k = line_of(system, c)
        gained = row_velocity(system, free, k) - row_velocity(system, y, k)
        rate = touch[c, GAP_RATE] + min(gained, 0.0)
        away = turned_away(touch, c, touch[c, GAP_RATE], 2.0 * h)
        reach = touch[c, GAP] + away + h * min(rate, 0.0)
        near = reach <= NEAR * system.length or touch[c, BILATERAL] == 1.0
        touch[c, CLOSED] = 1.0 if near else 0.0
        touch[c, BOUND] = touch[c, STATIC] if touch[c, WAS_STUCK] == STUCK else touch[c, KINETIC]
        touch[c, SLIDE] = STUCK
        touch[c, ROLL] = STUCK if touch[c, ROLLING_ARM] > 0.0 else 0.0
        touch[c, SPIN] = STUCK if touch[c, SPINNING_ARM] > 0.0 else 0.0


@plain
def write_sprung_lines(system, y):
    """Write the normal lines of closed contacts with a support that gives way, which have none."""
    touch, rows = system.touch, system.rows
    for c in range(touch.shape[0]):
        if touch[c, COMPLIANT] == 0.0 or touch[c, CLOSED] == 0.0:
            continue
        k = line_of(system, c)
        b, a = system.lines[k, BODY], system.lines[k, PARENT]
        B, A = state_of(y, b), state_of(y, a)
        n, p = vec(touch, c, NORMAL), vec(touch, c, POINT)
        turn_B = unrotate(B.q_WB, cross(sub(p, B.p_WC), n))
        turn_A = unrotate(A.q_WB, cross(n, sub(p, A.p_WC)))
        put(rows, k, n, turn_B, turn_A, 0.0, 0.0, 0.0, 0.0)
        rows[k, RATE] = row_velocity(system, y, k) - touch[c, GAP_RATE]


@inline
def missing(system, k, give):
    """b - J u - give x of line k."""
    x = system.vectors[MULTIPLIERS]
    s = system.vectors[RIGHT, k] - give * x[k]
    for j in range(system.lines.shape[0]):
        s -= system.square[0, k, j] * x[j]
    return s


@inline
def relaxed(system, k, give):
    """Impulse of line k that makes J u + give x = b, the others as they are."""
    diagonal = system.square[0, k, k] + give
    if diagonal <= 0.0:
        return 0.0
    return system.vectors[MULTIPLIERS, k] + missing(system, k, give) / diagonal


@inline
def bounded_pair(system, k, most, give):
    """Impulses of lines k and k + 1 that make J u + give x = b, or those of size `most` against
    what is left of J u; the change.

    Where the bound holds both take a step of one length, of the stiffer direction: steps of their
    own would turn the friction away from the slip.
    """
    x = system.vectors[MULTIPLIERS]
    a, b = x[k], x[k + 1]
    A, B = system.square[0, k, k] + give, system.square[0, k + 1, k + 1] + give
    C = system.square[0, k, k + 1]
    largest = 0.5 * (A + B) + math.sqrt(0.25 * (A - B) ** 2 + C * C)
    if largest <= 0.0:
        x[k], x[k + 1] = 0.0, 0.0
        return abs(a) + abs(b)
    s, r = missing(system, k, give), missing(system, k + 1, give)
    area = A * B - C * C
    if area > FLAT * largest * largest:
        x[k], x[k + 1] = a + (B * s - C * r) / area, b + (A * r - C * s) / area
    else:
        x[k], x[k + 1] = a + s / largest, b + r / largest
    if x[k] * x[k] + x[k + 1] * x[k + 1] > most * most:
        x[k], x[k + 1] = a + s / largest, b + r / largest
        size = (x[k] * x[k] + x[k + 1] * x[k + 1]) ** 0.5
        if size > most:
            x[k] *= most / size
            x[k + 1] *= most / size
    return abs(x[k] - a) + abs(x[k + 1] - b)


@plain
def sweep(system, h):
    """One projected Gauss-Seidel sweep over all lines; (largest change, largest impulse)."""
    x, touch = system.vectors[MULTIPLIERS], system.touch
    changed, largest = 0.0, 0.0
    for k in range(line_of(system, 0)):
        before = x[k]
        x[k] = relaxed(system, k, 0.0)
        changed = max(changed, abs(x[k] - before))
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] == 0.0:
            continue
        k = line_of(system, c)
        before, give = x[k], 0.0
        if touch[c, COMPLIANT] == 1.0:
            give = 1.0 / (h * (h * touch[c, STIFFNESS] + touch[c, DAMPING]))
        x[k] = relaxed(system, k, give)
        if touch[c, BILATERAL] == 0.0:
            x[k] = max(x[k], 0.0)
        changed = max(changed, abs(x[k] - before))
        push = abs(x[k])
        if touch[c, STATIC] > 0.0:
            most = touch[c, BOUND] * push if push > 0.0 else 0.0
            changed = max(changed, bounded_pair(system, k + 1, most, 0.0))
        else:
            viscous = touch[c, VISCOUS_PER_NORMAL] * push + h * touch[c, VISCOUS]
            if viscous > 0.0:
                changed = max(changed, bounded_pair(system, k + 1, 1e300, 1.0 / viscous))
        if touch[c, ROLL] != 0.0:
            most = touch[c, ROLLING_ARM] * push
            changed = max(changed, bounded_pair(system, k + 3, most, 0.0))
        if touch[c, SPIN] != 0.0:
            most = touch[c, SPINNING_ARM] * push
            before = x[k + 5]
            x[k + 5] = min(most, max(-most, relaxed(system, k + 5, 0.0)))
            changed = max(changed, abs(x[k + 5] - before))
    for k in range(system.lines.shape[0]):
        largest = max(largest, abs(x[k]))
    return changed, largest


@plain
def right_sides(system, y, start, h):
    """b - J u for every line, with restitution and the gap that is still to be closed.

    What the loads alone would give in two steps is no impact: a body at rest does not bounce.
    What has turned away comes back at twice the mean speed at which it did, or leaves.

    y: free velocities; start: velocities at the beginning of the step, same configuration.
    """
    touch = system.touch
    for k in range(system.lines.shape[0]):
        system.vectors[RIGHT, k] = system.rows[k, RATE] - row_velocity(system, y, k)
        system.vectors[MULTIPLIERS, k] = 0.0
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] == 0.0:
            continue
        k = line_of(system, c)
        before = row_velocity(system, start, k) - system.rows[k, RATE]
        now = row_velocity(system, y, k) - system.rows[k, RATE]
        if touch[c, COMPLIANT] == 1.0:
            stiff = h * touch[c, STIFFNESS] + touch[c, DAMPING]
            system.vectors[RIGHT, k] -= touch[c, STIFFNESS] * touch[c, GAP] / stiff
        elif touch[c, RESTITUTION] > 0.0 and before < 2.0 * (now - before) and before < 0.0:
            system.vectors[RIGHT, k] -= touch[c, RESTITUTION] * before
        elif touch[c, BILATERAL] == 0.0:
            away = turned_away(touch, c, before, h)
            system.vectors[RIGHT, k] -= (max(touch[c, GAP] - away, 0.0) + 4.0 * away) / h


@plain
def read_modes(system, y):
    """Modes of the contacts from their impulses and the velocities y after them."""
    touch, x = system.touch, system.vectors[MULTIPLIERS]
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] == 0.0:
            touch[c, SLIDE] = touch[c, ROLL] = touch[c, SPIN] = 0.0
            continue
        k = line_of(system, c)
        leaving = row_velocity(system, y, k) - system.rows[k, RATE]
        held = touch[c, BILATERAL] == 1.0 or touch[c, COMPLIANT] == 1.0
        if x[k] == 0.0 or (leaving > LEAVES * system.speed and not held):
            touch[c, CLOSED] = touch[c, SLIDE] = touch[c, ROLL] = touch[c, SPIN] = 0.0
            continue
        touch[c, SLIDE] = SLIDING
        if touch[c, STATIC] > 0.0:
            slip = (x[k + 1] ** 2 + x[k + 2] ** 2) ** 0.5
            stuck = slip < touch[c, BOUND] * abs(x[k]) * (1.0 - 1e-9)
            touch[c, SLIDE] = STUCK if stuck else SLIDING
        if touch[c, ROLL] != 0.0:
            turn = (x[k + 3] ** 2 + x[k + 4] ** 2) ** 0.5
            stuck = turn < touch[c, ROLLING_ARM] * abs(x[k]) * (1.0 - 1e-9)
            touch[c, ROLL] = STUCK if stuck else SLIDING
        if touch[c, SPIN] != 0.0:
            stuck = abs(x[k + 5]) < touch[c, SPINNING_ARM] * abs(x[k]) * (1.0 - 1e-9)
            touch[c, SPIN] = STUCK if stuck else SLIDING


@plain
def deepest_overlap(system, t, y):
    """(least gap of the rigid contacts, which it is), lines and table written."""
    write_rows(system, t, y)
    deepest, found = 0.0, -1
    for c in range(system.touch.shape[0]):
        if system.touch[c, COMPLIANT] == 0.0 and system.touch[c, GAP] < deepest:
            deepest, found = system.touch[c, GAP], c
    return deepest, found


@plain
def push_out(system, t, y):
    """Move bodies until no rigid contact overlaps, in place; modes stay as they are.

    As little as can be, turning included; where a long step has gone too far for that to converge,
    they are shifted along the deepest contact's normal, one after the other.
    """
    touch = system.touch
    for _ in range(PUSH_ROUNDS):
        deepest, _ = deepest_overlap(system, t, y)
        if deepest >= -OVERLAP * system.length:
            return
        for c in range(touch.shape[0]):
            overlaps = touch[c, GAP] < 0.0 and touch[c, COMPLIANT] == 0.0
            touch[c, WAS_CLOSED] = touch[c, CLOSED]
            touch[c, CLOSED] = 1.0 if overlaps else 0.0
        project_positions(system, t, y)
        for c in range(touch.shape[0]):
            touch[c, CLOSED] = touch[c, WAS_CLOSED]
    for _ in range(SHIFT_ROUNDS):
        deepest, c = deepest_overlap(system, t, y)
        if deepest >= -OVERLAP * system.length:
            return
        k = line_of(system, c)
        b, a = system.lines[k, BODY], system.lines[k, PARENT]
        light_b = 1.0 / system.bodies[b, MASS]
        light_a = 1.0 / system.bodies[a, MASS] if a >= 0 else 0.0
        for j in range(3):
            shift = -deepest * touch[c, NORMAL + j] / (light_a + light_b)
            y[WIDTH * b + j] += light_b * shift
            if a >= 0:
                y[WIDTH * a + j] -= light_a * shift


@plain
def pay_for_lift(system, y, before):
    """Take what the loads lose where bodies were pushed out from their kinetic energy: else every
    long step on a curved surface would add some.  before: y as it was."""
    for i in range(system.bodies.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        lifted = 0.0
        for j in range(3):
            lifted -= system.bodies[i, LOAD + j] * (y[k + j] - before[k + j])
        if not lifted > 0.0:
            continue
        spin = symmetric_times(six(system.bodies, i, INERTIA), B.w_WB_B)
        kinetic = 0.5 * (system.bodies[i, MASS] * dot(B.v_WC, B.v_WC) + dot(B.w_WB_B, spin))
        slower = math.sqrt(1.0 - lifted / kinetic) if kinetic > lifted else 0.0
        for j in range(7, WIDTH):
            y[k + j] *= slower


@plain
def let_go(system, t, y):
    """Open what has pushed but is apart by the end of the step; of a rim that is no longer flat,
    all but its low point, which no small correction would bring back."""
    touch = system.touch
    write_rows(system, t, y)
    for c in range(touch.shape[0]):
        held = touch[c, BILATERAL] == 1.0 or touch[c, COMPLIANT] == 1.0
        apart = APART if touch[c, AROUND] == 0.0 else NEAR
        if touch[c, GAP] > apart * system.length and not held:
            touch[c, CLOSED] = touch[c, SLIDE] = touch[c, ROLL] = touch[c, SPIN] = 0.0


@plain
def impulses(system, h):
    """Solve for the impulses of all lines."""
    fill_matrix(system, False)
    for _ in range(SWEEPS):
        changed, largest = sweep(system, h)
        if changed <= SETTLED * largest:
            break


@plain
def work_of_drive(system, t, y):
    """Work of the supports that move as prescribed in bringing the velocities to theirs at t [J].

    The impulses were taken with those at the middle of the step; y is changed in place.
    """
    moves = False
    for k in range(line_of(system, 0), system.lines.shape[0]):
        moves = moves or system.rows[k, RATE] != 0.0
    done = 0.0
    if moves:
        settle_bodies(system, t, y)
        for k in range(line_of(system, 0), system.lines.shape[0]):
            done += system.vectors[MULTIPLIERS, k] * system.rows[k, RATE]
    return done


@increment.register(TimeStepping)
def time_stepping_increment(method, system, t, y, h, work):
    at, free, dy = work[AT], work[0], work[DY]
    copy(at, y)
    recall_modes(system, t, h)
    note_gaps(system, t, at)
    drift(system, at, 0.5 * h)
    copy(free, at)
    free_velocities(system, t + 0.5 * h, free, h)
    take_part(system, t + 0.5 * h, at, free, 0.5 * h)
    write_rows(system, t + 0.5 * h, at)
    write_sprung_lines(system, at)
    right_sides(system, free, at, h)
    impulses(system, h)
    clear_push(system)
    add_multipliers(system)
    gained = 0.0
    for k in range(system.lines.shape[0]):
        mean = 0.5 * (row_velocity(system, at, k) + row_velocity(system, free, k))
        mean += 0.5 * row_times_push(system, k)
        gained += system.vectors[MULTIPLIERS, k] * mean
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            free[WIDTH * i + 7 + j] += system.bodies[i, PUSH + j]
    read_modes(system, free)
    drift(system, free, 0.5 * h)
    copy(dy, free)
    push_out(system, t + h, free)
    pay_for_lift(system, free, dy)
    let_go(system, t + h, free)
    keep_modes(system, t, h)
    gained += work_of_drive(system, t + h, free)
    for i in range(y.shape[0]):
        dy[i] = free[i] - y[i]
    dy[WIDTH * system.bodies.shape[0]] = gained
    return dy
