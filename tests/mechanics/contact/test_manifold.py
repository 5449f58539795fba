"""The way back to the manifold on the lines that hold is that on all lines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.constraints.rows import ERROR, HOLONOMIC, RATE
from rb_sim.integrate.attempt import LOST
from rb_sim.mechanics.contact import motion_kernels
from rb_sim.mechanics.contact.contact_bodies import CLOSED, SLIDE
from rb_sim.mechanics.contact.contact_kinematics import STUCK
from rb_sim.mechanics.contact.motion_kernels import (
    HoldingLines,
    bring_to_manifold,
    error_of_holding,
)
from rb_sim.mechanics.systems.elimination import dense_matrix, hasten
from rb_sim.mechanics.systems.many_bodies import LOAD, MULTIPLIERS
from rb_sim.mechanics.systems.multibody import (
    add_multipliers,
    clear_push,
    move_by_push,
    row_velocity,
    write_rows,
)
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene
from tests.interpreted import interpreted


def on_all_lines(system: Any, t: float, y: np.ndarray) -> np.ndarray:
    """y brought back to the manifold of all lines, by the pseudo-inverse of their matrix."""
    lines, rows = range(len(system.lines)), system.rows

    def push(right: list[float], of: list[int]) -> None:
        inverse = np.linalg.pinv(dense_matrix(system, of), rcond=1e-11, hermitian=True)
        system.vectors[MULTIPLIERS] = 0.0
        system.vectors[MULTIPLIERS, of] = inverse @ right
        clear_push(system)
        add_multipliers(system)

    clear_push(system)
    move_by_push(system, y)
    for _ in range(5):
        write_rows(system, t, y)
        held = [k for k in lines if rows[k, HOLONOMIC]]
        push([-rows[k, ERROR] for k in held], held)
        move_by_push(system, y)
    write_rows(system, t, y)
    push([rows[k, RATE] - row_velocity(system, y, k) for k in lines], [*lines])
    hasten(system, y)
    return y


def both_ways(name: str, closed: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y off the manifold, and brought back with these contacts closed: on the lines that hold, and
    on all, open ones, which are zero, with them."""
    system = compile_scene(load_scene(name)).system
    y = np.array(compile_scene(load_scene(name)).y)
    rng = np.random.default_rng(len(closed))
    off = y + 1e-4 * rng.normal(size=len(y))
    for c in closed:
        system.touch[c, CLOSED], system.touch[c, SLIDE] = 1.0, STUCK
    system.rows[:], system.pushes[:] = 0.0, 0.0
    system.bodies[:, LOAD : LOAD + 6] = 7.0  # of no account here
    return off, bring_to_manifold(system, 0.1, off.copy()), on_all_lines(system, 0.1, off.copy())


@pytest.mark.parametrize(
    ("name", "closed"),
    [("dropped_box", ()), ("dropped_box", (2,)), ("dropped_box", (0, 5)), ("ball_on_block", (0,)),
     ("ball_on_block", ())],
)  # fmt: skip
def test_open_contacts_make_no_difference(name: str, closed: tuple[int, ...]) -> None:
    off, here, everywhere = interpreted(both_ways, name, closed)
    np.testing.assert_allclose(here, everywhere, rtol=0.0, atol=1e-13)
    assert np.abs(here - off).max() > 1e-6


def errors_of_a_joint(tilt: float, shift: float) -> tuple[float, float, int]:
    """(the error of the positions, the scene's length, how many lines hold) of a ball whose axis
    stays upright and whose centre stays where it is, tilted and shifted; its contact is open."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.2}, "position": [0.0, 0.0, 3.0]}
    constraints = {
        "upright": {"type": "parallel", "body": "ball", "axis_B": [0.0, 0.0, 1.0]},
        "centre": {"type": "fixed_point", "body": "ball", "point_B": [0.0, 0.0, 0.0]},
        "floor": {"type": "contact", "body": "ball"},
    }
    mapping = {"bodies": {"ball": ball}, "constraints": constraints, "effects": {}}
    compiled = compile_scene(load_scene(mapping | {"simulation": {"duration": 1.0}}))
    system, y = compiled.system, np.array(compiled.y)
    system.touch[:, CLOSED] = 0.0
    y[0] += shift
    y[3:7] = Rotation.from_rotvec([tilt, 0.0, 0.0]).as_quat()
    worst, holding = error_of_holding(HoldingLines(system), 0.0, y)
    return float(worst), system.length, holding


@pytest.mark.parametrize(("tilt", "shift"), [(1e-3, 0.0), (0.0, 2e-3), (1e-3, 1e-4), (1e-4, 1.0)])
def test_errors_of_angles_count_at_the_scenes_length(tilt: float, shift: float) -> None:
    """The axis leaves the directions that it is normal to by the sine of the tilt."""
    worst, length, holding = interpreted(errors_of_a_joint, tilt, shift)
    assert abs(length - 1.0) > 0.5  # else nobody would see it
    assert worst == pytest.approx(max(shift, length * np.sin(tilt)), rel=1e-12)
    assert holding == 5


def brought_back(error: float) -> tuple[bool, float]:
    """(whether y is lost where so much is left of the errors of positions [m], scene's length)."""
    compiled = compile_scene(load_scene("dropped_box"))
    system, y = compiled.system, np.array(compiled.y)
    kept, motion_kernels.bring_positions = motion_kernels.bring_positions, lambda *_: error
    try:
        return bool(np.isnan(bring_to_manifold(system, 0.0, y)[0])), system.length
    finally:
        motion_kernels.bring_positions = kept


def test_a_manifold_out_of_reach_is_told_by_the_scenes_length() -> None:
    _, length = interpreted(brought_back, 0.0)
    assert abs(length - 1.0) > 0.2
    found = [interpreted(brought_back, share * LOST * length)[0] for share in (0.0, 0.99, 1.01)]
    assert found == [False, False, True]
    assert interpreted(brought_back, float("nan"))[0]
