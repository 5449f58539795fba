# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every reference case that needs only the catalogue, at 1e-9 of the scale of each column.

Compared: position and velocity of C, attitude (q and -q are one), spin, reaction force and torque.
The scale of a column is its largest value; a column that vanishes identically is compared with the
natural scale of the case (weight, weight times length, ...).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SceneError
from rb_sim.simulation.trajectory import Trajectory
from tests.interpreted import trajectory
from tests.oracles.compare import (
    STATE,
    errors,
    reaction_of,
    scales,
    worst_quaternion,
    worst_vector,
)
from tests.oracles.to_scene import ball_on_support, double_pendulum, scene_of

pytestmark = pytest.mark.filterwarnings("error::rb_sim.AccuracyWarning")
"""What agrees with its reference is not told as lost."""

LIMIT = 1e-9
TIGHT = 1e-15
"""Tolerance of one step; the sum over thousands of steps stays below LIMIT."""

COMPILED = (
    "free_tumble_generic",
    "free_dzhanibekov_long",
    "free_separatrix",
    "inertia_ratio_1e6",
    "heavytop_bruls_cardona",
    "lagrange_steady_slow",
    "lagrange_cuspidal",
    "sleeping_top_below",
    "sleeping_top_above",
    "kovalevskaya",
    "asymmetric_heavy_top",
    "thin_rod_pendulum",
    "heavytop_spin_1e4",
    "lagrange_drift_1000s",
    "pendulum_3rad",
    "pendulum_3rad_unbalanced",
    "rotor_dynamic_imbalance",
    "gate_inclined_axis",
    "trans_circle",
    "trans_helix",
    "trans_cycloid",
    "trans_parabola",
    "sphere_FK_const",
    "disk_steady",
    "euler_disk_at_rest",
    "disk_wobble",
    "disk_falls_near_flat",
    "rattleback_kl_minus",
    "rattleback_kl_plus",
    "ball_eccentric",
    "cylinder_incline",
    "cylinder_unbalanced",
    "stiff_point_spring",
)
INTERPRETED = (
    "rotor_torque_driven",
    "sphere_FK_sine",
    "sphere_incline",
    "euler_disk_damped",
    "chaplygin_sleigh",
    "knife_edge_incline",
)
"""Short cases whose effects would each cost a compilation of their own."""
TWO_BODIES = {
    "double_spherical_pendulum": double_pendulum,
    "ball_on_block": ball_on_support,
    "ball_on_wedge": ball_on_support,
}
ELSEWHERE = (
    "stiff_spring_undamped",
    "stiff_spring_overdamped",
    "oversize_step",
    "oversize_step_stiff",
)


def options_of(case: dict[str, Any]) -> dict[str, float]:
    """Run from 0 to the last sample, at the times of the samples."""
    t = (case.get("samples") or case["samples_bodies"])["t"]
    return {"duration": t[-1], "rate": (len(t) - 1) / t[-1]}


def compiled_run(case: dict[str, Any], tolerance: float = TIGHT, **kinds: Any) -> Trajectory:
    options = options_of(case) | {"tolerance": tolerance} | kinds
    return Simulation(load_scene(scene_of(case) | {"simulation": options})).run(checks=False)


def run_of(name: str, case: dict[str, Any]) -> Trajectory:
    if name in COMPILED:
        return compiled_run(case)
    scene = load_scene(scene_of(case))
    block = trajectory(scene_of(case), tolerance=1e-14, **options_of(case))
    return Trajectory(block, Simulation(scene).layout)


def test_every_case_has_a_test(cases: dict[str, Any]) -> None:
    assert sorted(cases) == sorted((*COMPILED, *INTERPRETED, *TWO_BODIES, *ELSEWHERE))


@pytest.mark.parametrize("name", [*COMPILED, *INTERPRETED])
def test_case(name: str, cases: dict[str, Any]) -> None:
    case = cases[name]
    run = run_of(name, case)
    found = errors(case, run, reaction_of(case, run))
    assert max(found.values()) <= LIMIT, found
    assert run.residual.max() <= 1e-12
    for bearing, expected in case.get("bearing_reactions", {}).items():
        force = run.reaction[f"joint/{bearing}"].force
        assert worst_vector(force, expected) <= LIMIT * scales(case)["reaction_force"]
        assert not run.reaction[f"joint/{bearing}"].torque.any()


LONG = ("lagrange_drift_1000s", "trans_helix", "trans_parabola", "stiff_point_spring")
"""Many revolutions, or an orbit that multiplies rounding."""


@pytest.mark.parametrize("name", [*COMPILED, *INTERPRETED])
def test_case_by_its_series(name: str, cases: dict[str, Any]) -> None:
    """To 1e-11, a hundredth of LIMIT; near the top the pendulum multiplies rounding by 1e4."""
    case = cases[name]
    run = compiled_run(case, method="taylor")
    found = errors(case, run, reaction_of(case, run))
    assert max(found.values()) <= (LIMIT if name in LONG else 1e-11), found
    assert run.residual.max() <= 1e-12


@pytest.mark.parametrize("name", ["asymmetric_heavy_top", "ball_eccentric", "gate_inclined_axis"])
def test_body_origin_anywhere(name: str, cases: dict[str, Any]) -> None:
    """The same motion of C and the same reactions when the body origin is not C."""
    case = cases[name]
    scene = scene_of(case, origin=(0.3, -0.2, 0.1))
    options = options_of(case) | {"tolerance": TIGHT}
    run = Simulation(load_scene(scene | {"simulation": options})).run(checks=False)
    found = errors(case, run, reaction_of(case, run))
    assert max(found.values()) <= LIMIT, found


def stiff_scene(case: dict[str, Any], **options: Any) -> Any:
    """The scene of the stiff cases with the inertia that the loader refuses.

    (0.1, 0.1, 0.3) is the tensor of no mass distribution; the equations do not mind.
    """
    mapping = scene_of(case)
    with pytest.raises(SceneError, match="no principal moment above the sum of the others"):
        load_scene(mapping)
    given = tuple(tuple(map(float, row)) for row in mapping["bodies"]["body"].pop("inertia"))
    mapping["bodies"]["body"]["inertia"] = [0.1, 0.1, 0.1]
    scene = load_scene(mapping | {"simulation": options_of(case) | options})
    body = scene.bodies["body"].model_copy(update={"given_inertia": given})
    return scene.model_copy(update={"bodies": {"body": body}})


@pytest.mark.parametrize("name", ["stiff_spring_undamped", "stiff_spring_overdamped"])
def test_stiff_spring(name: str, cases: dict[str, Any]) -> None:
    case = cases[name]
    run = Simulation(stiff_scene(case, tolerance=TIGHT)).run(checks=False)
    found = errors(case, run, reaction_of(case, run))
    assert max(found.values()) <= LIMIT, found


@pytest.mark.parametrize("name", TWO_BODIES)
def test_two_bodies(name: str, cases: dict[str, Any]) -> None:
    case = cases[name]
    scene, expected = TWO_BODIES[name](case), case["samples_bodies"]
    layout = Simulation(load_scene(scene)).layout
    run = Trajectory(trajectory(scene, tolerance=1e-14, **options_of(case)), layout)
    for body in layout.bodies:
        for column, attribute in STATE.items():
            values, samples = getattr(run, attribute)[body], np.asarray(expected[body][column])
            worst = worst_quaternion if column.startswith("quat") else worst_vector
            size = np.linalg.norm(samples, axis=1).max() or 1.0
            assert worst(values, samples) <= LIMIT * size, (body, column)
        for column in (c for c in expected[body] if c.endswith("force")):
            reaction = "contact" if column == "contact_force" else column.removesuffix("_force")
            on = layout.reaction_bodies[layout.reactions.index(reaction)]
            samples = np.asarray(expected[body][column]) * (1.0 if on == body else -1.0)
            size = np.linalg.norm(samples, axis=1).max()
            assert worst_vector(run.reaction[reaction].force, samples) <= LIMIT * size, column


def test_oversize_output_step(cases: dict[str, Any]) -> None:
    """However seldom the caller looks, the steps follow the dynamics."""
    expected = cases["oversize_step"]["expected"]
    case = cases[expected["base_case"]]
    t = case["samples"]["t"]
    for interval in expected["requested_output_steps"]:
        options = {"duration": t[-1], "rate": 1.0 / interval, "tolerance": TIGHT}
        run = Simulation(load_scene(scene_of(case) | {"simulation": options})).run(checks=False)
        at = [int(np.abs(run.t - instant).argmin()) for instant in t]
        common = [k for k, i in enumerate(at) if abs(run.t[i] - t[k]) < 1e-12]
        assert len(common) >= 3
        picked = run.position["body"][[at[k] for k in common]]
        samples = np.array(case["samples"]["position"])[common]
        assert worst_vector(picked, samples) <= LIMIT


def test_oversize_output_step_of_a_stiff_spring(cases: dict[str, Any]) -> None:
    expected = cases["oversize_step_stiff"]["expected"]
    case = cases[expected["base_case"]]
    t = case["samples"]["t"]
    for interval in expected["requested_output_steps"]:
        options = {"rate": 1.0 / interval, "tolerance": TIGHT}
        run = Simulation(stiff_scene(case, **options)).run(checks=False)
        at = [int(np.abs(run.t - instant).argmin()) for instant in t]
        common = [k for k, i in enumerate(at) if abs(run.t[i] - t[k]) < 1e-12]
        assert len(common) >= 3
        picked = run.linear_velocity["body"]
        samples = np.array(case["samples"]["velocity_world"])[common]
        error = worst_vector(picked[[at[k] for k in common]], samples)
        assert error <= LIMIT * scales(case)["velocity_world"]
