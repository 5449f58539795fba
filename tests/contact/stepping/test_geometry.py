"""Where the tables of time stepping have points of contact, beside the laws of event-driven motion;
and what the tables say of a scene, beside the scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import load_scene
from rb_sim.contact.stepping import scene_tables as columns
from rb_sim.contact.stepping.geometry import GAP, MOVES, NORMAL, POINT, TURNS_AT, find_spots
from rb_sim.contact.stepping.scene_tables import BOX_BOX, FIRST, KIND, OTHER, tables_of
from rb_sim.contact.stepping.step_workspace import memory_of, workspace_for
from rb_sim.mechanics.contact import contact_table as events
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.scene.compile import compile_scene
from tests.contact.test_every_pair import (
    CANNOT,
    LISTED,
    SHAPES,
    SOLIDS,
    SUPPORTS,
    Meeting,
    scene_of,
)
from tests.interpreted import interpreted
from tests.moving import unit

MOTIONS: dict[str, dict[str, Any]] = {
    "turntable": {"type": "turntable", "rate": 1.3, "axis": [0.6, 0.0, 0.8], "point": [1, 2, 3]},
    "shaken": {
        "type": "shaken",
        "direction": [0.0, 0.6, 0.8],
        "amplitude": 0.3,
        "frequency": 0.4,
    },
}
PAIRS = [
    (shape, support)
    for shape in (*SHAPES, LISTED)
    for support in (*SUPPORTS, *SOLIDS)
    if (shape, support) not in CANNOT
]
WHEN, FAR = 0.7, 50.0


def compiled_pair(shape: str, support: str, motion: str) -> Any:
    mapping = scene_of(Meeting(shape, support))
    if motion:
        contact = mapping["constraints"]["between"]
        del contact["parent"]
        contact["motion"] = MOTIONS[motion]
    return compile_scene(load_scene(mapping))


def spots(shape: str, support: str, motion: str, seed: int) -> Any:
    """(spots, table of contacts, velocity of the body over its support at each P, the support's own
    spin there, kinds) at a random state."""
    compiled = compiled_pair(shape, support, motion)
    system, rng = compiled.system, np.random.default_rng(seed)
    tables, _ = tables_of(compiled, columns.Tractions())
    y = compiled.y.copy()
    for i in range(2):
        y[13 * i : 13 * i + 13] = *rng.normal(size=3), *unit(rng, 4), *rng.normal(size=6)
    y[13:16] += [0.5, 0.7, -0.4]
    workspace = workspace_for(2, len(tables.owners), 0)
    find_spots(
        tables,
        memory_of(len(tables.owners)),
        workspace.spots,
        workspace.polygons,
        WHEN,
        y,
        FAR,
        False,
    )
    system.touch[:, events.CLOSED] = 0.0
    contact_accelerations(system, WHEN, y)
    over = []
    for c, (b, a) in enumerate(tables.owners):
        p, rate = workspace.spots[c, POINT : POINT + 3], np.zeros(3)
        for i, sign in ((b, 1.0), (a, -1.0)):
            if i >= 0:
                w = Rotation.from_quat(y[13 * i + 3 : 13 * i + 7]).apply(
                    y[13 * i + 10 : 13 * i + 13]
                )
                rate += sign * (
                    y[13 * i + 7 : 13 * i + 10] + np.cross(w, p - y[13 * i : 13 * i + 3])
                )
        over.append(rate - workspace.spots[c, MOVES : MOVES + 3])
    kinds = np.zeros(len(tables.owners), int)
    for entry in tables.entries:
        kinds[entry[FIRST] :] = entry[KIND]
    return workspace.spots, system.touch.copy(), np.array(over), kinds


@pytest.mark.parametrize("motion", ["", *MOTIONS])
@pytest.mark.parametrize(("shape", "support"), PAIRS)
def test_points_are_those_of_event_driven_motion(shape: str, support: str, motion: str) -> None:
    """Gap, normal and place of each; what the body slips there over a support that moves."""
    if motion and support in SOLIDS:
        return  # of a body, which moves itself
    for seed in range(3):
        found, table, over, kinds = interpreted(spots, shape, support, motion, seed)
        for c, kind in enumerate(kinds):
            if kind in (OTHER, BOX_BOX):  # found by the same functions; by edges and faces
                continue
            here, there = found[c], table[c]
            assert_allclose(here[GAP], there[events.GAP], atol=1e-13)
            for at, column in ((NORMAL, events.NORMAL), (POINT, events.POINT)):
                expected = there[column : column + 3]
                assert_allclose(here[at : at + 3], expected, atol=1e-13)
            n = here[NORMAL : NORMAL + 3]
            slip = over[c] - (over[c] @ n) * n
            assert_allclose(slip, there[events.SLIP : events.SLIP + 3], atol=1e-12)
            if motion == "turntable":
                spin = 1.3 * np.array([0.6, 0.0, 0.8])
                assert_allclose(here[TURNS_AT : TURNS_AT + 3], spin)
            else:
                assert not here[TURNS_AT : TURNS_AT + 3].any()


def test_the_tables_know_most_pairs() -> None:
    """Else nothing above would have been compared."""
    kinds = {int(k) for shape, support in PAIRS for k in interpreted(kinds_of, shape, support)}
    assert kinds == set(range(OTHER + 1))


def kinds_of(shape: str, support: str) -> list[int]:
    return (
        tables_of(compiled_pair(shape, support, ""), columns.Tractions())[0]
        .entries[:, KIND]
        .tolist()
    )


LAWS_GIVEN: dict[str, dict[str, Any]] = {
    "coulomb": {
        "friction": {"type": "coulomb", "static": 0.5, "kinetic": 0.3},
        "restitution": 0.6,
        "rolling_resistance": 0.01,
        "spinning_resistance": 0.02,
    },
    "viscous": {"friction": {"type": "viscous", "coefficient": 0.7}},
    "per normal": {"friction": {"type": "viscous", "coefficient": 0.8, "per_normal": True}},
    "regularised": {"friction": {"type": "regularised", "coefficient": 0.4, "speed": 0.1}},
    "soft": {"compliance": {"stiffness": 1e4, "damping": 3.0}},
}
LAWS_TOLD: dict[str, dict[int, float]] = {
    "coulomb": {
        columns.STATIC: 0.5,
        columns.KINETIC: 0.3,
        columns.RESTITUTION: 0.6,
        columns.ROLLING: 0.01,
        columns.SPINNING: 0.02,
    },
    "viscous": {columns.TRACTION: 1.0},
    "per normal": {columns.TRACTION: 1.0},
    "regularised": {columns.TRACTION: 1.0},
    "soft": {columns.COMPLIANT: 1.0, columns.STIFFNESS: 1e4, columns.DAMPING: 3.0},
}


def table_of(law: str, shape: dict[str, Any]) -> tuple[Any, ...]:
    """(laws, owners, entries, gravity) of a pinned body, and one on it, under two kinds of
    weight."""
    bodies = {
        "a": {"mass": 2.0, "inertia": [0.1, 0.2, 0.3]},
        "b": {"mass": 1.0, "shape": shape, "position": [0.0, 0.0, 2.0]},
    }
    contact = {"type": "contact", "body": "b", "parent": "a", "surface": {"type": "plane"}}
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    wind = {"type": "gravity", "acceleration": [0.5, 0.25, 0.0], "bodies": ["b"]}
    mapping = {
        "bodies": bodies,
        "constraints": {"c": contact | LAWS_GIVEN[law]},
        "effects": {"weight": weight, "wind": wind},
        "simulation": {"duration": 1.0, "project_initial": True},
    }
    tables, _ = tables_of(compile_scene(load_scene(mapping)), columns.Tractions())
    return tables.laws, tables.owners, tables.entries, tables.gravity


@pytest.mark.parametrize("law", LAWS_GIVEN)
def test_laws_are_those_of_the_scene(law: str) -> None:
    """A box has several points, which share them; a ball has one."""
    for shape, points in (
        ({"type": "sphere", "radius": 0.2}, 1),
        ({"type": "box", "size": [1, 1, 1]}, 8),
    ):
        laws, owners, entries, gravity = interpreted(table_of, law, shape)
        told = LAWS_TOLD[law] | {columns.ALONE: float(points == 1)}
        expected = np.zeros(columns.LAWS)
        expected[list(told)] = list(told.values())
        assert laws.shape == (points, columns.LAWS)
        assert_allclose(laws, np.tile(expected, (points, 1)))
        assert owners.tolist() == [[1, 0]] * points
        assert entries[:, [columns.BODY, columns.PARENT]].tolist() == [[1, 0]] * points
        assert entries[:, FIRST].tolist() == list(range(points))
        assert gravity.tolist() == [[0.0, 0.0, -9.81], [0.5, 0.25, -9.81]]
