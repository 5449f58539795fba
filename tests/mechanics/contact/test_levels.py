"""Event functions beside their formulas, and their rates beside differences along the motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import load_scene
from rb_sim.catalogue.geometry.corners_and_rims import ABSENT
from rb_sim.contact.events.next_event import look_ahead
from rb_sim.mechanics.contact import contact_bodies as kinds
from rb_sim.mechanics.contact import motion_kernels as _registers_its_kernels  # noqa: F401  # noqa: F401
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    AT_JAM,
    AT_SLIP,
    AT_SPIN,
    BILATERAL,
    CLOSED,
    COMPLIANT,
    EVENT_FUNCTION_KINDS,
    EVENT_FUNCTIONS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    GAP,
    GAP_BEFORE,
    GAP_RATE,
    GAP_RATE_BEFORE,
    LEAN_SIGN,
    NORMAL,
    NORMAL_FORCE,
    NORMAL_SIGN,
    PIVOT,
    RELATIVE_SPIN,
    ROLL,
    ROLL_DIRECTION,
    ROLL_RATE,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SLIP_RATE,
    SPIN,
    SPIN_SIGN,
    SPRING,
)
from rb_sim.mechanics.contact.event_functions import level_rates, lowest_level
from rb_sim.mechanics.system import rate_into
from rb_sim.mechanics.systems.many_bodies import MULTIPLIERS
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted
from tests.moving import unit

MU, ROLLING_ARM, SPINNING_ARM = 0.4, 0.01, 0.02
FREE = kinds.FREE
OF_CLOSED = {NONE: 1, SLIDING: 2, STUCK: 3}


def compiled_scene() -> Any:
    """An ellipsoid between a floor and a wall, both with all six lines."""
    solid = {"mass": 1.3, "inertia": [0.02, 0.03, 0.04]}
    ellipsoid = {"type": "ellipsoid", "semi_axes": [0.3, 0.2, 0.4]}
    law = {
        "type": "contact",
        "body": "b",
        "friction": {"type": "coulomb", "static": MU},
        "rolling_resistance": ROLLING_ARM,
        "spinning_resistance": SPINNING_ARM,
    }
    wall = {"type": "plane", "point": [-1.0, 0.0, 0.0], "normal": [0.8, 0.6, 0.0]}
    start = {
        "position": [0.1, 0.2, 0.6],
        "orientation": {"axis": [1.0, 2.0, 0.5], "angle": 0.7},
        "linear_velocity": [0.5, 0.2, -0.3],
        "angular_velocity": [1.0, -2.0, 0.7],
    }
    mapping = {
        "bodies": {"b": solid | start | {"shape": ellipsoid}},
        "constraints": {"floor": law, "wall": law | {"surface": wall}},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 1.0},
    }
    return compile_scene(load_scene(mapping))


def filled(system: Any, modes: tuple[float, float, float], seed: int) -> None:
    """Both contacts closed in these modes; all that event functions are made of at random."""
    rng, touch = np.random.default_rng(seed), system.touch
    system.vectors[MULTIPLIERS] = rng.normal(size=len(system.lines))
    for c in range(2):
        touch[c, CLOSED], touch[c, [SLIDE, ROLL, SPIN]] = 1.0, modes
        touch[c, NORMAL_FORCE], touch[c, PIVOT] = rng.uniform(1.0, 9.0), rng.uniform(0.1, 1.0)
        touch[c, LEAN_SIGN], touch[c, SPIN_SIGN] = 1.0, rng.choice([-1.0, 1.0])
        for at in (NORMAL, SLIP_DIRECTION, ROLL_DIRECTION):
            touch[c, at : at + 3] = unit(rng, 3)
        for at in (SLIP, RELATIVE_SPIN):
            touch[c, at : at + 3] = rng.normal(size=3)


def by_formula(system: Any, c: int) -> list[float]:
    """Event functions of a closed contact, from Coulomb's laws of N, force and torques."""
    touch, k = system.touch[c], int(system.first_row[c])
    force = system.mass * system.speed**2 / system.length
    x, N, n = system.vectors[MULTIPLIERS], abs(touch[NORMAL_FORCE]), touch[NORMAL : NORMAL + 3]
    slip, turn = touch[SLIP : SLIP + 3], touch[RELATIVE_SPIN : RELATIVE_SPIN + 3]
    out = [touch[NORMAL_FORCE] / force] + [FREE] * (EVENT_FUNCTION_KINDS - 1)
    if touch[BILATERAL]:
        out[0] = (
            touch[NORMAL_SIGN] * touch[NORMAL_FORCE] / force if touch[SLIDE] == SLIDING else FREE
        )
    if touch[SLIDE] == STUCK:
        out[AT_SLIP] = (MU * N - np.hypot(x[k + 1], x[k + 2])) / force
    if touch[SLIDE] == SLIDING:
        out[AT_SLIP] = 100.0 * slip @ touch[SLIP_DIRECTION : SLIP_DIRECTION + 3] / system.speed
        if not touch[COMPLIANT]:
            out[AT_JAM] = touch[PIVOT] - 1e-6
    most = 100.0 * system.length / system.speed
    for at, mode, bound, held, about in (
        (
            2,
            ROLL,
            ROLLING_ARM,
            np.hypot(x[k + 3], x[k + 4]),
            touch[ROLL_DIRECTION : ROLL_DIRECTION + 3],
        ),
        (AT_SPIN, SPIN, SPINNING_ARM, abs(x[k + 5]), touch[SPIN_SIGN] * n),
    ):
        way = turn - (turn @ n) * n if mode == ROLL else turn
        if touch[mode] == STUCK:
            out[at] = (bound * N - held) / (force * system.length)
        if touch[mode] == SLIDING:
            out[at] = most * float(way @ about)
    return out


MODES = [(STUCK, STUCK, STUCK), (SLIDING, SLIDING, SLIDING), (STUCK, SLIDING, STUCK),
         (SLIDING, STUCK, SLIDING), (NONE, NONE, NONE)]  # fmt: skip
SORTS = [{}, {BILATERAL: 1.0, NORMAL_SIGN: -1.0}, {COMPLIANT: 1.0}]


def levels(modes: tuple[float, float, float], sort: int, seed: int) -> tuple[Any, ...]:
    """(event functions, those by formula, the lowest, its code)."""
    system = compiled_scene().system
    filled(system, modes, seed)
    for column, value in SORTS[sort].items():
        system.touch[:, column] = value
    lowest, code = lowest_level(system)
    found = system.touch[:, EVENT_FUNCTIONS : EVENT_FUNCTIONS + EVENT_FUNCTION_KINDS].copy()
    return found, np.array([by_formula(system, c) for c in range(2)]), lowest, code


EVENTS = {
    STUCK: (kinds.SLIP_BEGINS, kinds.ROLL_BEGINS, kinds.SPIN_BEGINS),
    SLIDING: (kinds.SLIP_ENDS, kinds.ROLL_ENDS, kinds.SPIN_ENDS),
}


@pytest.mark.parametrize("sort", range(len(SORTS)), ids=["one side", "both sides", "soft"])
@pytest.mark.parametrize("modes", MODES, ids=str)
def test_event_functions_are_what_laws_leave_to_their_bounds(modes: Any, sort: int) -> None:
    """The lowest of both contacts is due first, under the name of its kind."""
    seen = set()
    for seed in range(8):
        found, expected, lowest, code = interpreted(levels, modes, sort, seed)
        assert_allclose(found, expected, rtol=1e-12)
        if expected.min() == FREE:
            assert code % kinds.EVENT_KINDS == kinds.LIES_FLAT  # there is nothing else
            continue
        c, i = np.unravel_index(
            np.argmin(np.append(expected, [[0.5] * EVENT_FUNCTION_KINDS], 0)), (3, 5)
        )
        names = (kinds.LIFT_OFF, *(EVENTS[m][j] for j, m in enumerate(modes) if m != NONE))
        places = (0, *(j + 1 for j, m in enumerate(modes) if m != NONE), AT_JAM)
        name = dict(zip(places, (*names, kinds.JAMS), strict=True))
        if c < 2:
            assert (lowest, code) == (found[c, i], kinds.EVENT_KINDS * c + name[int(i)])
            seen.add(c)
        else:
            assert (lowest, code % kinds.EVENT_KINDS) == (0.5, kinds.LIES_FLAT)
    assert modes == (NONE, NONE, NONE) or seen == {0, 1}


def flat_and_open() -> tuple[Any, ...]:
    """(level and code of a rim that lies flat; levels of contacts that are open: of one above its
    support, one that is not there, a soft one that touches, with a firm and with a weak spring)."""
    system = compiled_scene().system
    filled(system, (STUCK, STUCK, STUCK), 0)
    system.touch[1, LEAN_SIGN] = 0.2
    system.touch[:, NORMAL_FORCE] = 1e3
    flat = lowest_level(system)
    system.touch[:, CLOSED], system.touch[:, LEAN_SIGN] = 0.0, 1.0
    force = system.mass * system.speed**2 / system.length
    found = []
    for gap, soft, spring, sense in (
        (0.3, 0.0, 0.0, 1.0), (0.3, 0.0, 0.0, ABSENT), (-0.1, 1.0, 1e9, 1.0),
        (-0.1, 1.0, 1e-3 * force, 1.0), (0.2, 1.0, -force, 1.0), (-0.1, 0.0, 0.0, 1.0),
    ):  # fmt: skip
        system.touch[0, [GAP, COMPLIANT, SPRING, LEAN_SIGN]] = gap, soft, spring, sense
        system.touch[1, GAP] = 1e9
        lowest, code = lowest_level(system)
        found.append(
            (system.touch[0, EVENT_FUNCTIONS] * system.length, lowest * system.length, code)
        )
    return flat, found, system.length


def test_what_is_open_is_as_far_as_its_gap() -> None:
    """A soft contact that a damper holds off, or whose spring hardly pushes, is open although it
    overlaps: by its push then, in natural units."""
    (lowest, code), found, length = interpreted(flat_and_open)
    assert (lowest, code) == (pytest.approx(-0.3), kinds.EVENT_KINDS + kinds.LIES_FLAT)
    at = [level for level, _, _ in found]
    assert at == pytest.approx([0.3, FREE * length, -0.1, -1e-3 * length, 0.2, -0.1])
    assert [code for _, _, code in found] == [0, kinds.EVENT_KINDS, 0, 0, 0, 0]


def rates(modes: tuple[float, float, float], closed: tuple[float, float]) -> tuple[Any, ...]:
    """(rates, differences of event functions, slip and rolling along the motion, kept rates of slip
    and rolling, whether the table is otherwise as it was)."""
    compiled = compiled_scene()
    system, y, h = compiled.system, np.array(compiled.y), 1e-5
    touch, slope = system.touch, np.zeros(len(compiled.y))
    touch[:, CLOSED], touch[:, [SLIDE, ROLL, SPIN]] = closed, modes
    rng = np.random.default_rng(1)
    for c in range(2):
        for at in (SLIP_DIRECTION, ROLL_DIRECTION):
            touch[c, at : at + 3] = unit(rng, 3)
        touch[c, SPIN_SIGN] = -1.0
    rate_into(system, 0.0, y, slope)

    def seen(t: float) -> np.ndarray:
        contact_accelerations(system, t, y + t * slope)
        lowest_level(system)
        n, turn = touch[:, NORMAL : NORMAL + 3], touch[:, RELATIVE_SPIN : RELATIVE_SPIN + 3]
        rolls = turn - np.sum(turn * n, axis=1)[:, None] * n
        return np.hstack(
            [
                touch[:, EVENT_FUNCTIONS : EVENT_FUNCTIONS + EVENT_FUNCTION_KINDS],
                touch[:, SLIP : SLIP + 3],
                rolls,
            ]
        )

    differences = (seen(h) - seen(-h)) / (2.0 * h)
    seen(0.0)
    before = touch.copy()
    found = level_rates(system, 0.0, y)
    kept = np.hstack([touch[:, SLIP_RATE : SLIP_RATE + 3], touch[:, ROLL_RATE : ROLL_RATE + 3]])
    for at in (SLIP_RATE, ROLL_RATE):
        before[:, at : at + 3] = touch[:, at : at + 3]
    return found, differences, kept, np.array_equal(before, touch)


@pytest.mark.parametrize("closed", [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.0, 0.0)], ids=str)
@pytest.mark.parametrize("modes", MODES[:-1], ids=str)
def test_rates_are_those_along_the_motion(modes: Any, closed: Any) -> None:
    found, differences, kept, untouched = interpreted(rates, modes, closed)
    size = np.abs(differences).max()
    assert_allclose(found, differences[:, :EVENT_FUNCTION_KINDS], atol=2e-5 * size)
    assert untouched
    if any(closed):  # else nobody asks for them
        assert_allclose(
            kept, differences[:, EVENT_FUNCTION_KINDS:], atol=2e-5 * np.abs(differences).max()
        )


def ahead(faint: float, closed: float = 1.0) -> tuple[Any, ...]:
    """(the table before and after look_ahead, the rates, what slip and turning are taken for none).
    Contact 0 slides, rolls and spins on; slip and rolling of contact 1 are below what is none, and
    its spin has turned round."""
    system = compiled_scene().system
    filled(system, (SLIDING, SLIDING, SLIDING), 3)
    touch = system.touch
    system = system._replace(still=1e-6)
    touch[:, CLOSED] = closed
    touch[1, SLIP : SLIP + 3] *= faint
    touch[1, RELATIVE_SPIN : RELATIVE_SPIN + 3] = touch[1, NORMAL : NORMAL + 3] * 2.0
    touch[0, SPIN_SIGN], touch[1, SPIN_SIGN] = 1.0, -1.0
    touch[0, RELATIVE_SPIN : RELATIVE_SPIN + 3] += (
        1.0 - touch[0, RELATIVE_SPIN : RELATIVE_SPIN + 3] @ touch[0, NORMAL : NORMAL + 3]
    ) * (touch[0, NORMAL : NORMAL + 3])
    rng = np.random.default_rng(4)
    for at in (GAP, GAP_RATE, *range(SLIP_RATE, SLIP_RATE + 3), *range(ROLL_RATE, ROLL_RATE + 3)):
        touch[:, at] = rng.normal(size=2)
    lowest_level(system)
    before, slopes = touch.copy(), rng.normal(size=(2, EVENT_FUNCTION_KINDS))
    look_ahead(system, slopes)
    return before, touch.copy(), slopes, system.speed, system.length


def test_directions_are_kept_where_a_motion_is_none() -> None:
    before, after, slopes, speed, length = interpreted(ahead, 1e-9)
    n = before[:, NORMAL : NORMAL + 3]
    slip, turn = before[:, SLIP : SLIP + 3], before[:, RELATIVE_SPIN : RELATIVE_SPIN + 3]
    roll = turn - np.sum(turn * n, axis=1)[:, None] * n
    assert_allclose(
        after[0, SLIP_DIRECTION : SLIP_DIRECTION + 3], slip[0] / np.linalg.norm(slip[0])
    )
    assert_allclose(
        after[0, ROLL_DIRECTION : ROLL_DIRECTION + 3], roll[0] / np.linalg.norm(roll[0])
    )
    for at in (SLIP_DIRECTION, ROLL_DIRECTION):
        assert np.array_equal(after[1, at : at + 3], before[1, at : at + 3])
    assert after[:, SPIN_SIGN].tolist() == [1.0, 1.0]
    for c in range(2):  # along the directions from here on
        forward, about = (
            after[c, SLIP_DIRECTION : SLIP_DIRECTION + 3],
            after[c, ROLL_DIRECTION : ROLL_DIRECTION + 3],
        )
        unit_of = 100.0 / speed
        levels_of = [
            before[c, NORMAL_FORCE],
            unit_of * slip[c] @ forward,
            unit_of * length * roll[c] @ about,
        ]
        found = after[c, EVENT_FUNCTIONS_BEFORE : EVENT_FUNCTIONS_BEFORE + EVENT_FUNCTION_KINDS]
        assert_allclose(found[1:3], levels_of[1:])
        assert (
            found[0] == before[c, EVENT_FUNCTIONS]
            and found[AT_JAM] == before[c, EVENT_FUNCTIONS + AT_JAM]
        )
        rate = after[c, EVENT_RATES_BEFORE : EVENT_RATES_BEFORE + EVENT_FUNCTION_KINDS]
        assert_allclose(rate[1], unit_of * before[c, SLIP_RATE : SLIP_RATE + 3] @ forward)
        assert_allclose(rate[2], unit_of * length * before[c, ROLL_RATE : ROLL_RATE + 3] @ about)
        turned = 1.0 if c == 0 else -1.0
        assert found[AT_SPIN] == turned * before[c, EVENT_FUNCTIONS + AT_SPIN] > 0.0
        assert rate[AT_SPIN] == turned * slopes[c, AT_SPIN]
        assert rate[0] == slopes[c, 0] and rate[AT_JAM] == slopes[c, AT_JAM]
        assert after[c, GAP_BEFORE] == before[c, GAP]
        assert after[c, GAP_RATE_BEFORE] == before[c, GAP_RATE]


def test_what_is_open_has_its_gap_alone_to_look_at() -> None:
    """Also where modes are left from when it was closed."""
    before, after, slopes, _, _ = interpreted(ahead, 1e-9, 0.0)
    levels_of = before[:, EVENT_FUNCTIONS : EVENT_FUNCTIONS + EVENT_FUNCTION_KINDS]
    assert np.array_equal(
        after[:, EVENT_FUNCTIONS_BEFORE : EVENT_FUNCTIONS_BEFORE + EVENT_FUNCTION_KINDS], levels_of
    )
    assert np.array_equal(
        after[:, EVENT_RATES_BEFORE : EVENT_RATES_BEFORE + EVENT_FUNCTION_KINDS], slopes
    )
