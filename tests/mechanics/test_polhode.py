"""The way back to a polhode: energy and angular momentum of the start, from near by in one step.

Whole motions near the middle axis are in test_free_rotor and test_free_spin.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import load_scene
from rb_sim.catalogue.types import CHANGING
from rb_sim.mechanics.system import settle
from rb_sim.mechanics.systems.free import (
    LARGEST_TURN,
    FreeRotor,
    FreeSpin,
    on_polhode,
    settle_spins,
    start_rotor,
    start_spins,
    untouched,
)
from rb_sim.scene.compile import compile_scene
from tests.moving import floats
from tests.one_body_scenes import INERTIA, scene

SPIN = np.array([1.5, -2.0, 3.0])


def rotor(spin: Any, **body: Any) -> tuple[Any, np.ndarray]:
    """A free body and its coordinates, the spin in principal axes last."""
    compiled = compile_scene(load_scene(scene(None, {}, angular_velocity=list(spin), **body)))
    return compiled.system, np.array(compiled.y)


def invariants(system: Any, w: Any) -> tuple[float, float]:
    """Twice the energy and the square of the angular momentum."""
    moments = np.array(system.moments)
    return float(moments @ np.square(w)), float(np.square(moments) @ np.square(w))


def test_the_start_is_the_body_seen_along_its_principal_axes() -> None:
    system, y = rotor(SPIN)
    turn = Rotation.from_quat(system.q_BP).as_matrix()
    assert_allclose(turn @ np.diag(system.moments) @ turn.T, INERTIA, atol=1e-15)
    assert_allclose(y[10:13], turn.T @ SPIN, atol=1e-15)
    own = invariants(system, y[10:13])
    inertia = np.array(INERTIA)
    assert_allclose(own, (SPIN @ inertia @ SPIN, SPIN @ inertia @ inertia @ SPIN), rtol=1e-14)


def test_what_depends_on_the_start_comes_back_from_the_inputs_of_a_law() -> None:
    system, _ = rotor(SPIN)
    changing = CHANGING[FreeRotor]
    values = changing.values(system, 0.0, True)
    assert len(values) == changing.count
    assert changing.symbolic(system, values) == system
    spin = FreeSpin(0, system.q_BP, system.moments)
    own = spin._replace(weights=(1.0, 2.0, 3.0), contrast=(4.0, 5.0, 6.0), polhode=(7.0, 8.0))
    changing = CHANGING[FreeSpin]
    assert changing.values(own, 0.0, True) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
    assert changing.symbolic(spin, changing.values(own, 0.0, True)) == own


@pytest.mark.parametrize("axis", range(3))
def test_a_spin_near_its_polhode_is_put_back_whatever_axis_it_is_near(axis: int) -> None:
    """By Newton's step: an error of 1e-5 becomes one of its square, and then round-off."""
    spin = np.full(3, 0.2)
    spin[axis] = 3.0
    system, start = rotor(spin, inertia=[0.2, 0.3, 0.4])
    assert_allclose(sorted(system.moments), [0.2, 0.3, 0.4])
    y = start.copy()
    y[10:13] *= 1.0 + 1e-5 * np.array([1.0, -2.0, 1.5])
    back = np.array(settle(system, 0.0, floats(y)))[10:13]
    expected = invariants(system, start[10:13])
    assert_allclose(invariants(system, back), expected, rtol=1e-9)
    assert not np.allclose(invariants(system, y[10:13]), expected, rtol=1e-6)
    again = np.array(on_polhode(system, floats(back)))
    assert_allclose(invariants(system, again), expected, rtol=1e-15)
    assert_allclose(on_polhode(system, floats(again)), again, rtol=1e-15)


def test_the_step_is_the_shortest_in_the_metric_of_the_energy() -> None:
    """It has no part along the polhode, whose tangent is normal to both gradients there."""
    system, start = rotor(SPIN, inertia=[0.2, 0.3, 0.4])
    w = start[10:13] * (1.0 + 1e-6 * np.array([1.0, -2.0, 1.5]))
    moments = np.array(system.moments)
    tangent = np.cross(moments * w, moments**2 * w)
    step = np.array(on_polhode(system, floats(w))) - w
    along = (moments * step) @ tangent / np.linalg.norm(moments * step) / np.linalg.norm(tangent)
    assert abs(along) < 1e-8
    assert np.linalg.norm(step) > 1e-7


def test_what_is_no_rounding_is_left_alone() -> None:
    """A component that would change by more than LARGEST_TURN; a spin of zero; any at rest."""
    system, start = rotor(SPIN)
    for stretch, changes in ((1.0 + 0.9 * LARGEST_TURN, True), (1.0 + 2.5 * LARGEST_TURN, False)):
        w = floats(stretch * start[10:13])
        assert (on_polhode(system, w) != w) == changes
    nowhere = (0.0, 0.0, 0.0)
    assert on_polhode(system, nowhere) == nowhere
    still, _ = rotor([0.0, 0.0, 0.0])
    assert on_polhode(still, (0.1, 0.2, 0.3)) == (0.1, 0.2, 0.3)


@pytest.mark.parametrize("size", [1e-140, 1e140])
def test_a_spin_whose_energy_is_beyond_doubles_has_no_polhode(size: float) -> None:
    system, start = rotor(SPIN)
    y = start.copy()
    y[10:13] *= size
    made = start_rotor(system, floats(y))
    assert made.weights == made.contrast == (0.0, 0.0, 0.0) and made.polhode == (0.0, 0.0)
    for small in (1e-100, 1e100):
        y[10:13] = small * start[10:13]
        assert start_rotor(system, floats(y)).polhode[0] == pytest.approx(1.0, abs=1e-15)


def test_of_three_equal_moments_every_spin_is_left_alone() -> None:
    system, start = rotor(SPIN, inertia=[0.3, 0.3, 0.3])
    w = floats(start[10:13] * (1.0 + 1e-9))
    assert on_polhode(system, w) == w


def many() -> Any:
    """Two bodies that nothing turns among others that joints hold and torques turn."""
    body = {"mass": 1.3, "inertia": INERTIA, "angular_velocity": SPIN.tolist()}
    names = ("hung", "free", "pulled", "puller", "damped", "dragged", "held", "holder")
    spring = {"type": "spring", "body": "pulled", "parent": "puller", "stiffness": 3.0}
    places = {name: {"position": [3.0 * i, 0.0, 0.0]} for i, name in enumerate(names)}
    mapping = {
        "bodies": {name: body | place for name, place in places.items()},
        "constraints": {
            "pivot": {"type": "fixed_point", "body": "hung"},
            "joint": {"type": "fixed_point", "body": "held", "parent": "holder"},
        },
        "effects": {
            "weight": {"type": "gravity"},
            "spring": spring,
            "damper": {"type": "angular_damping", "body": "damped", "coefficient": 0.1},
            "drag": {"type": "linear_drag", "body": "dragged", "coefficient": 0.1},
        },
        "simulation": {"project_initial": True},
    }
    return compile_scene(load_scene(mapping))


def test_the_spins_of_many_bodies_that_nothing_turns_are_kept() -> None:
    """As that of one alone, whose body axes they keep."""
    compiled = many()
    system, alone = compiled.system, rotor(SPIN)[0]
    assert untouched(system) == [spin.body for spin in system.spins] == [1, 5]
    y = compiled.y.copy()
    w = SPIN * (1.0 + 1e-5 * np.array([1.0, -2.0, 1.5]))
    for i in range(8):
        y[13 * i + 10 : 13 * i + 13] = w
    back = y.tolist()
    settle_spins(system, back)
    turn = Rotation.from_quat(alone.q_BP)
    kept = turn.apply(on_polhode(alone, floats(turn.inv().apply(w))))
    assert np.abs(kept - w).max() > 1e-6
    for i in range(8):
        own = back[13 * i + 10 : 13 * i + 13]
        assert_allclose(own, kept if i in (1, 5) else w, rtol=1e-14)
    for k in set(range(104)) - {13 * i + j for i in (1, 5) for j in (10, 11, 12)}:
        assert back[k] == y[k]
    assert start_spins(system, compiled.y).spins == system.spins
    faster = start_spins(system, y).spins[0]
    assert np.array(faster.weights) @ np.square(turn.inv().apply(w)) == pytest.approx(1.0)
