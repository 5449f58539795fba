# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws that every kind of the catalogue obeys, whatever its parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from tests.interpreted import interpreted
from tests.moving import difference, floats, flown, random_state, unit
from tests.one_body_scenes import EFFECTS, JOINTS, LOAD, WEIGHT, moved, ring, scene
from tests.runs import trajectory

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=8, deadline=None, derandomize=True)


# --- constraints: rows -------------------------------------------------------------------------


def example_rows(rng: np.random.Generator) -> dict[str, Any]:
    """One random row of every kind."""
    from rb_sim.catalogue.constraints import rows as r
    from rb_sim.catalogue.constraints.rolling import RollingRow
    from rb_sim.catalogue.constraints.rows import CurveRow
    from rb_sim.catalogue.curves import CircleCurve, LineCurve, spline_through
    from rb_sim.catalogue.geometry.smooth_surfaces import (
        EllipsoidSurface,
        RimSurface,
        SphereSurface,
    )
    from rb_sim.numerics.vectors import perpendicular

    def point() -> tuple[float, ...]:
        return floats(rng.normal(size=3))

    n = unit(rng)
    t1, t2 = (floats(t) for t in perpendicular(n))
    rows = {
        "point": r.PointRow(point(), point()),
        "seat": r.SeatRow(point(), point()),
        "slot": r.SlotRow(point(), point(), t1, t2),
        "plane": r.PlaneRow(point(), point(), n),
        "parallel": r.ParallelRow(unit(rng), t1, t2),
        "lock": r.LockRow(unit(rng, 4), point()),
        "distance": r.DistanceRow(point(), point(), 1.3),
        "velocity in body axes": r.VelocityRow(point(), point(), point(), 0.4, True),
        "velocity in world axes": r.VelocityRow(point(), point(), point(), 0.4, False),
        "line": CurveRow(point(), LineCurve(point(), n)),
        "circle": CurveRow(point(), CircleCurve(point(), t1, t2, 0.7)),
        "curve": CurveRow(point(), spline_through(np.array(ring()), True)),
    }
    surfaces = {
        "sphere": SphereSurface(point(), 0.3),
        "disk": RimSurface(point(), 0.3, unit(rng)),
        "ellipsoid": EllipsoidSurface(point(), (0.3, 0.2, 0.4)),
    }
    for name, surface in surfaces.items():
        rows[f"rolling {name}"] = RollingRow(surface, point(), n, t1, t2)
    return rows


def row_kinds() -> tuple[set[str], list[str]]:
    """Row classes of the catalogue, and the example rows by name."""
    from rb_sim.catalogue.constraints.rows import COUNT

    rows = example_rows(np.random.default_rng(0))
    missing = {kind.__name__ for kind in COUNT} - {type(row).__name__ for row in rows.values()}
    return missing, list(rows)


ROWS = (
    "point", "seat", "slot", "plane", "parallel", "lock", "distance", "velocity in body axes",
    "velocity in world axes", "line", "circle", "curve", "rolling sphere", "rolling disk",
    "rolling ellipsoid",
)  # fmt: skip


def test_every_row_kind_has_an_example() -> None:
    missing, names = interpreted(row_kinds)
    assert not missing
    assert names == list(ROWS)


def filled(row: Any, B: Any, A: Any) -> tuple[np.ndarray, ...]:
    """(J, g, bias, holonomic) of one row."""
    from rb_sim.catalogue.constraints import rows as r

    table = np.zeros((r.COUNT[type(row)], r.ROW_WIDTH))
    r.fill(row, 0.0, B, A, table, 0)
    return table[:, :12], table[:, r.ERROR], table[:, r.BIAS], table[:, r.HOLONOMIC]


def onto_curve(row: Any, B: Any) -> Any:
    """B moved so that its point lies on the curve and moves along it, as rows of curves assume."""
    from rb_sim.catalogue.constraints.rows import material_point
    from rb_sim.catalogue.curves import curve_nearest, curve_point

    c, slope, _ = (np.array(x) for x in curve_point(row.curve, 0.8))
    p, v, _ = (np.array(x) for x in material_point(B, row.r_B))
    B = B._replace(
        p_WC=floats(np.array(B.p_WC) + c - p), v_WC=floats(np.array(B.v_WC) + 0.9 * slope - v)
    )
    assert abs(curve_nearest(row.curve, floats(c)) - 0.8) < 1e-12
    return B


def row_defects(name: str, seed: int) -> tuple[float, float, float]:
    """(J u - dg/dt, bias - d(J u)/dt at constant u, size of the rows)."""
    from rb_sim.catalogue.constraints.rows import CurveRow
    from rb_sim.catalogue.spec import WORLD

    rng = np.random.default_rng(seed)
    row = example_rows(rng)[name]
    B, A = random_state(rng), random_state(rng)
    if isinstance(row, CurveRow):
        B, A = onto_curve(row, B), WORLD
    u = np.array(B.v_WC + B.w_WB_B + A.v_WC + A.w_WB_B)
    J, _, bias, holonomic = filled(row, B, A)
    rate = difference(lambda t: filled(row, flown(B, t), flown(A, t))[1])
    if not isinstance(row, CurveRow):
        turned = difference(lambda t: filled(row, flown(B, t), flown(A, t))[0] @ u)
    else:
        turned = along_curve(row, B, u)
    size = 1.0 + float(np.abs(J).max()) * float(u @ u)
    first = np.abs(holonomic * (J @ u - rate)).max()
    return float(first), float(np.abs(bias - turned).max()), size


def along_curve(row: Any, B: Any, u: np.ndarray) -> np.ndarray:
    """e . (c - s'^2 c'') with both terms by differences: what J du/dt has to cancel."""
    from rb_sim.catalogue.constraints.rows import material_point
    from rb_sim.catalogue.curves import curve_nearest, curve_point

    J = filled(row, B, B)[0]
    p, v, _ = material_point(B, row.r_B)
    s = curve_nearest(row.curve, p)
    slope = np.array(curve_point(row.curve, s)[1])
    speed = float(np.array(v) @ slope / (slope @ slope))
    centripetal = difference(lambda t: material_point(flown(B, t), row.r_B)[1])
    bend = difference(lambda t: curve_point(row.curve, s + speed * t)[1]) * speed
    return J[:, :3] @ (centripetal - bend)


@pytest.mark.parametrize("name", ROWS)
@FEW
@given(SEEDS)
def test_rows_agree_with_differences(name: str, seed: int) -> None:
    """J u is the rate of g, and the bias that of J u at constant velocities."""
    first, second, size = interpreted(row_defects, name, seed)
    assert first <= 1e-8 * size
    assert second <= 1e-8 * size


# --- effects -----------------------------------------------------------------------------------


def example_effects(rng: np.random.Generator) -> list[Any]:
    """One random row of every conservative effect."""
    from rb_sim.catalogue.effects.gravity import GravityRow
    from rb_sim.catalogue.effects.spring import BushingRow, SpringRow
    from rb_sim.catalogue.effects.torsion import TorsionSpringRow

    def point() -> tuple[float, ...]:
        return floats(rng.normal(size=3))

    return [
        GravityRow(point()),
        SpringRow(point(), point(), 3.0, 0.4),
        BushingRow(point(), point(), 3.0),
        TorsionSpringRow(unit(rng), 0.7, 0.3, unit(rng, 4)),
    ]


def potential_defect(row: Any, body: Any, B: Any, A: Any) -> float:
    """|dU/dt + power| / (1 + |power|) of one effect, at constant velocities of both bodies."""
    from rb_sim.catalogue.spec import potential, wrench

    f, k = (np.array(x) for x in wrench(row, 0.0, body, B, A))
    arm = np.array(B.p_WC) - np.array(A.p_WC)
    moment = Rotation.from_quat(B.q_WB).apply(k) + np.cross(arm, f)
    power = f @ B.v_WC + k @ B.w_WB_B
    power -= f @ A.v_WC + moment @ Rotation.from_quat(A.q_WB).apply(A.w_WB_B)
    rate = difference(lambda t: potential(row, 0.0, body, flown(B, t), flown(A, t)))
    return abs(float(rate) + power) / (1.0 + abs(power))


def potential_defects(seed: int) -> tuple[list[str], list[float]]:
    """For each conservative kind |dU/dt + power| / (1 + |power|); kinds without an example."""
    from rb_sim.catalogue.spec import WORLD, Inertial, potential

    rng = np.random.default_rng(seed)
    body = Inertial(1.7, (0.2, 0.3, 0.4, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    rows, defects = example_effects(rng), []
    for row in rows:
        B, A = random_state(rng), random_state(rng)
        defects.append(potential_defect(row, body, B, WORLD if row is rows[0] else A))
    missing = {kind.__name__ for kind in potential.kernels} - {type(r).__name__ for r in rows}
    return sorted(missing), defects


@FEW
@given(SEEDS)
def test_potential_is_that_of_the_force(seed: int) -> None:
    """dU/dt = -(power of the effect on body and parent) for any motion of the two."""
    missing, defects = interpreted(potential_defects, seed)
    assert not missing
    assert max(defects) <= 1e-8


def effect_kinds() -> set[str]:
    """Rows of effects that no example scene makes."""
    from rb_sim import load_scene
    from rb_sim.catalogue.spec import wrench
    from rb_sim.scene.compile import compile_scene

    made = {"CommandRow", "SegmentRow"}  # the latter is what a table over time is when traced
    for effect in EFFECTS.values():
        system = compile_scene(load_scene(scene(None, {"e": effect}))).system
        made |= {type(row).__name__ for row in system.effects}
    return {kind.__name__ for kind in wrench.kernels} - made


def test_every_effect_kind_has_an_example() -> None:
    assert interpreted(effect_kinds) == set()


# --- runs --------------------------------------------------------------------------------------


def worked(run: Any) -> np.ndarray:
    """Integral of the power over time, from the samples."""
    return make_interp_spline(run.t, run.power, k=7).antiderivative()(run.t)


@pytest.mark.parametrize("name", EFFECTS)
def test_energy_changes_by_the_work_done(name: str) -> None:
    """Of every effect on a free body and on one with a fixed point."""
    for joint in (None, {"type": "fixed_point", "point_B": [0.1, -0.2, 0.3]}):
        mapping = scene(joint, {"weight": WEIGHT, "effect": EFFECTS[name]})
        edges = EFFECTS[name].get("times", [])
        for start, end in zip([0.0, *edges], [*edges, 0.4], strict=True):
            run = window(mapping, start, end)
            assert_allclose(run.energy - run.energy[0], worked(run), rtol=0.0, atol=1e-9)


def window(mapping: Any, start: float, end: float) -> Any:
    """Samples of a run strictly inside (start, end), where all laws are smooth."""
    return _window(mapping, start, end)


def _window(mapping: Any, start: float, end: float) -> Any:
    from rb_sim import Simulation, load_scene

    simulation = Simulation(load_scene(mapping))
    inset = 1e-6 * (end - start)
    simulation.advance(start + inset)
    return simulation.run(end - start - 2.0 * inset, 60.0 / (end - start), checks=False).block


@pytest.mark.parametrize("name", JOINTS)
def test_ideal_reactions_do_no_work(name: str) -> None:
    """Their power is zero at every sample, and the energy changes by the work of the load."""
    mapping = JOINTS[name] | {"effects": {"weight": WEIGHT, "load": LOAD}}
    run = trajectory(mapping, rate=150.0)
    assert_allclose(run.energy - run.energy[0], worked(run), rtol=0.0, atol=1e-9)
    for i in range(min(1, run.reaction_force.shape[1])):
        force, torque, at = (x[:, i] for x in (run.reaction_force, run.reaction_torque, run.anchor))
        spin = Rotation.from_quat(run.orientation[:, 0]).apply(run.angular_velocity[:, 0])
        velocity = run.linear_velocity[:, 0] + np.cross(spin, at - run.position[:, 0])
        power = np.sum(force * velocity + torque * spin, axis=1)
        assert np.abs(power).max() <= 1e-11 * (1.0 + np.abs(force).max())


@pytest.mark.parametrize("name", JOINTS)
def test_turned_and_shifted_world(name: str) -> None:
    """Turning and shifting the world turns and shifts the motion and the reactions."""
    turn, shift = Rotation.from_rotvec([0.7, -1.1, 0.5]), np.array([2.0, -1.0, 0.5])
    here = trajectory(JOINTS[name])
    there = trajectory(moved(JOINTS[name], turn, shift))
    vectors = ("linear_velocity", "reaction_force", "reaction_torque")
    for field in ("position", "anchor", *vectors):
        a, b = getattr(here, field), getattr(there, field)
        expected = turn.apply(a.reshape(-1, 3)).reshape(a.shape) if a.size else a
        expected = expected + (0.0 if field in vectors else shift)
        assert_allclose(b, expected, rtol=0.0, atol=1e-10 * (1.0 + np.abs(a).max(initial=0.0)))
    assert_allclose(there.angular_velocity, here.angular_velocity, rtol=0.0, atol=1e-10)
    assert_allclose(there.kinetic_energy, here.kinetic_energy, rtol=1e-10)


SPLIT = {
    "dopri853, adaptive": {"tolerance": 1e-9},
    "dopri853": {"method": "dopri853", "step": 0.003, "tolerance": None},
    "rk4": {"method": "rk4", "step": 0.003, "tolerance": None},
    "gauss6": {"method": "gauss6", "step": 0.003, "tolerance": None},
    "euler": {"method": "euler", "step": 0.003, "tolerance": None},
}


def split_states(mapping: Any, coordinates: str, pieces: tuple[float, ...]) -> list[Any]:
    """State and reactions at the end of a run made in these pieces."""
    from rb_sim import Simulation, load_scene

    simulation = Simulation(load_scene(mapping), coordinates=coordinates)
    for piece in pieces:
        simulation.advance(piece)
    last = simulation.sample().block
    names = ("position", "orientation", "linear_velocity", "angular_velocity", "reaction_force")
    return [simulation.time, *(getattr(last, name).tolist() for name in names)]


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize("method", SPLIT)
def test_run_split_in_two_is_the_run_in_one(method: str, coordinates: str) -> None:
    """Bit for bit, with the cut off the grid of steps."""
    mapping = JOINTS["fixed_point"]
    mapping = mapping | {"simulation": mapping["simulation"] | SPLIT[method]}
    whole = split_states(mapping, coordinates, (0.25,))
    cut = split_states(mapping, coordinates, (0.125, 0.125))
    assert cut == whole
