"""What accelerations leave in the table of contacts, beside dense matrices of the same lines."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import load_scene
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.mechanics.contact.contact_bodies import (
    CLOSED,
    NORMAL_FORCE,
    PIVOT,
    ROLL,
    SLIDE,
    SLIP_DIRECTION,
    SPIN,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.systems.many_bodies import MULTIPLIERS
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted

SUPPORTS = ("world", "free body", "pinned body")
MASSES, MOMENTS = (1.3, 2.1), ((0.02, 0.03, 0.04), (0.3, 0.2, 0.4))
SOLIDS = tuple(zip(MASSES, MOMENTS, strict=True))
MU = 0.4


def scene(support: str) -> dict[str, Any]:
    """An ellipsoid that slides on a plane, which is the world's or that of a body `a`."""
    plane = {"type": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    shape = {"type": "ellipsoid", "semi_axes": [0.3, 0.2, 0.4]}
    turned = {"axis": [1.0, 2.0, 0.5], "angle": 0.7}
    bodies = {
        "b": {
            "mass": MASSES[0],
            "inertia": list(MOMENTS[0]),
            "shape": shape,
            "position": [0.3, 0.1, 0.5],
            "orientation": turned,
            "linear_velocity": [0.5, 0.2, 0.0],
        },
        "a": {"mass": MASSES[1], "inertia": list(MOMENTS[1]), "position": [0.0, 0.0, -0.2]},
    }
    friction = {"type": "coulomb", "static": MU}
    contact = {"type": "contact", "body": "b", "surface": plane, "friction": friction}
    constraints: dict[str, Any] = {"c": contact}
    if support != "world":
        contact["parent"] = "a"
    if support == "pinned body":
        constraints = {"pin": {"type": "fixed_point", "body": "a", "point_B": [0.1, 0.2, -0.3]}}
        constraints["c"] = contact
    return {"bodies": bodies, "constraints": constraints, "simulation": {"duration": 1.0}}


def tables(support: str, slide: float) -> tuple[Any, ...]:
    """(lines, pushes, multipliers, row of the table of contacts, its first line, bodies of
    each line) of the contact, closed, with a slip in a slanted direction."""
    compiled = compile_scene(load_scene(scene(support)))
    system, y = compiled.system, np.array(compiled.y)
    system.touch[:, CLOSED] = 1.0
    system.touch[0, [SLIDE, ROLL, SPIN]] = slide, 0.0, 0.0
    system.touch[0, SLIP_DIRECTION : SLIP_DIRECTION + 3] = 0.6, 0.8, 0.0
    contact_accelerations(system, 0.0, y)
    first = int(system.first_row[len(system.constraints)])
    multipliers = system.vectors[MULTIPLIERS].copy()
    ends = np.asarray(system.lines)[:, :2]
    return (
        system.rows[:, :12].copy(),
        system.pushes.copy(),
        multipliers,
        system.touch[0].copy(),
        first,
        ends,
    )


def spread(rows: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Lines of two bodies as lines of all coordinates, (n, 12)."""
    dense = np.zeros((len(rows), 12))
    for row, (body, parent), out in zip(rows, ends, dense, strict=True):
        out[6 * body : 6 * body + 6] += row[:6]
        if parent >= 0:
            out[6 * parent : 6 * parent + 6] += row[6:]
    return dense


@pytest.mark.parametrize("support", SUPPORTS)
def test_pivot_of_a_contact_that_slides(support: str) -> None:
    """The rise of its points from each other per push, with friction over without, where joints
    hold what they hold."""
    rows, pushes, multipliers, touch, first, ends = interpreted(tables, support, SLIDING)
    J, W = spread(rows, ends), spread(pushes, ends)
    inverse = np.diag(np.concatenate([[1 / m] * 3 + [1 / i for i in I_B] for m, I_B in SOLIDS]))
    held = J[:first]
    if first:
        inverse = inverse - inverse @ held.T @ np.linalg.solve(
            held @ inverse @ held.T, held @ inverse
        )
    effective, ideal = J[first] @ inverse @ W[first], J[first] @ inverse @ J[first]
    assert abs(effective / ideal - 1.0) > 0.05
    assert_allclose(touch[PIVOT], effective / ideal, rtol=1e-12)
    assert touch[NORMAL_FORCE] == multipliers[first]


@pytest.mark.parametrize("support", SUPPORTS)
def test_what_sticks_has_no_pivot_to_look_at(support: str) -> None:
    *_, multipliers, touch, first, _ = interpreted(tables, support, STUCK)
    assert touch[PIVOT] == 1.0
    assert touch[NORMAL_FORCE] == multipliers[first]
