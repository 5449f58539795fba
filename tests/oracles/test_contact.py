# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every reference case with contact: trajectories and reactions at 1e-8, event times at 1e-9.

Forces jump at events, so a sample at the instant of one has no force of its own; such samples are
left out of the comparison of forces only.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.contact_runs import ContactRun, contact_run, interpreted_run
from tests.oracles.compare import STATE, scales, worst_quaternion, worst_vector
from tests.oracles.contact_scenes import contact_scene
from tests.oracles.to_scene import ball_on_support, scene_of

FILE = Path(__file__).parent / "cases_contact.json"
CASES: dict[str, Any] = {case["id"]: case for case in json.loads(FILE.read_text())["cases"]}

TRAJECTORY, EVENT_TIME = 1e-8, 1e-9
TIGHT = 1e-12
AFTER = 1e-6
"""The runs go on for this long [s], so that an event at the very end is among theirs."""

EVENTS = {
    "sphere_slip_to_roll": ("sticks", "t_rolling"),
    "sphere_slip_masse": ("sticks", "t_rolling"),
    "sphere_rolling_resistance": ("stops rolling", "t_stop"),
    "sphere_off_sphere_rolling": ("opens", "t_separation"),
    "sphere_off_sphere_sliding": ("opens", "t_separation"),
    "block_up_and_stick": ("sticks", "stop_time"),
    "block_up_and_return": ("reverses", "stop_time"),
    "block_down_and_stop": ("sticks", "stop_time"),
    "bouncing_ball_zeno": ("rests", "zeno_time"),
    "stick_slip_drive": ("slips", "first_slip"),
}
"""The event that ends the first phase, and the scalar that gives its time."""

MOTIONS = [name for name, case in CASES.items() if "samples" in case]


def column_errors(case: dict[str, Any], run: ContactRun) -> dict[str, float]:
    """Worst error of each column, relative to its scale; the run's last sample is one too many."""
    found, samples, r = {}, case["samples"], run.trajectory
    for column, name in STATE.items():
        worst = worst_quaternion if column.startswith("quat") else worst_vector
        found[column] = worst(getattr(r, name)["body"][:-1], samples[column])
    t = np.asarray(samples["t"])
    instants = np.array([e.t for e in run.events if e.t > 0.0] or [-1.0])
    smooth = np.abs(t[:, None] - instants).min(axis=1) > EVENT_TIME
    parts = [value for name, value in r.reaction.items() if "/" not in name]
    force = sum(part.force for part in parts)
    torque = r.reaction["floor"].torque
    if case["constraint"].get("tilt_locked"):  # about C, where the case counts it
        arm = r.reaction["floor"].anchor - r.position["body"]
        torque = sum(part.torque for part in parts) + np.cross(arm, r.reaction["floor"].force)
    force, torque = force[:-1], torque[:-1]
    found["reaction_force"] = worst_vector(
        force[smooth], np.array(samples["reaction_force"])[smooth]
    )
    found["reaction_torque"] = worst_vector(
        torque[smooth], np.array(samples["reaction_torque"])[smooth]
    )
    size = scales(case)
    return {column: error / size[column] for column, error in found.items()}


@pytest.mark.parametrize("name", MOTIONS)
def test_case(name: str) -> None:
    case = CASES[name]
    t = case["samples"]["t"]
    run = contact_run(contact_scene(case), [*t, t[-1] + AFTER], tolerance=TIGHT)
    found = column_errors(case, run)
    assert max(found.values()) <= TRAJECTORY, found
    assert run.trajectory.residual.max() <= 1e-12
    if name in EVENTS:
        kind, scalar = EVENTS[name]
        first = run.times(kind)[0]
        assert abs(first - case["scalars"][scalar]) <= EVENT_TIME, (first, case["scalars"])


def test_every_transition_of_stick_slip() -> None:
    case = CASES["stick_slip_drive"]
    run = contact_run(contact_scene(case), case["samples"]["t"], tolerance=TIGHT)
    s = case["scalars"]
    slips = [t for t in run.times("slips") if t > 0.0]
    sticks = [t for t in run.times("sticks") if t > 0.0]
    assert len(slips) >= 5
    for i, t in enumerate(slips):
        assert abs(t - s["first_slip"] - i * s["period"]) <= EVENT_TIME
    for slip, stick in zip(slips, sticks, strict=False):
        assert abs(stick - slip - s["slip_time"]) <= EVENT_TIME


@pytest.mark.parametrize("name", ["block_threshold_stick", "block_threshold_slip"])
def test_threshold_is_sharp(name: str) -> None:
    """mu within 1e-9 of tan(alpha) on either side: sticks for ever without creep, or slides."""
    case = CASES[name]
    run = contact_run(contact_scene(case), [0.0, 100.0], tolerance=1e-10)
    moved = np.linalg.norm(np.diff(run.trajectory.position["body"], axis=0))
    if case["scalars"]["sticks"]:
        assert moved <= 1e-14
        assert run.trajectory.contact_state["floor"].tolist() == [2.0, 2.0]
    else:
        assert moved > 1.0


@pytest.mark.parametrize("name", ["impact_sphere_friction", "impact_sphere_stick"])
def test_oblique_impact(name: str) -> None:
    case = CASES[name]
    run = contact_run(contact_scene(case), [0.0], tolerance=1e-10)
    r, expected = run.trajectory, case["expected"]
    np.testing.assert_allclose(r.linear_velocity["body"][0], expected["velocity_after"], atol=1e-14)
    np.testing.assert_allclose(
        r.angular_velocity["body"][0], expected["omega_body_after"], atol=1e-12
    )
    (impact,) = (e for e in run.events if e.kind == "impact")
    np.testing.assert_allclose(impact.impulse, expected["impulse"], atol=1e-14)


def rocking_block(case: dict[str, Any]) -> dict[str, Any]:
    """The block tilted by tilt0 about its edge x = +half_width, at rest on it."""
    shape, tilt = case["body"]["shape"], case["expected"]["tilt0"]
    w, h = shape["half_width"], shape["half_height"]
    c, s = math.cos(tilt), math.sin(tilt)
    centre = [-(c * w - s * h), 0.0, s * w + c * h]
    body = {
        "mass": case["body"]["mass"],
        "inertia": case["body"]["inertia_com_body"],
        "shape": {"type": "box", "size": [2 * w, 2 * w, 2 * h]},
        "position": centre,
        "orientation": {"axis": [0.0, 1.0, 0.0], "angle": tilt},
    }
    return {
        "bodies": {"body": body},
        "constraints": {
            "floor": {"type": "contact", "body": "body", "friction": {"type": "rough"}}
        },
        "effects": {"weight": {"type": "gravity", "acceleration": case["gravity"]}},
    }


def test_rocking_block() -> None:
    """Housner: the block falls back, strikes flat and rocks on over the other edge."""
    case = CASES["rocking_block"]
    expected = case["expected"]
    before, after = expected["quarter_period"] - 1e-9, expected["quarter_period"] + 1e-9
    run = contact_run(rocking_block(case), [0.0, before, after, 0.9], tolerance=TIGHT)
    assert abs(run.times("impact")[0] - expected["quarter_period"]) <= EVENT_TIME
    spin = np.linalg.norm(run.trajectory.angular_velocity["body"], axis=1)
    assert abs(spin[1] - expected["omega_before"]) <= 1e-8
    assert abs(spin[2] - expected["omega_after"]) <= 1e-8
    q = run.trajectory.orientation["body"]
    tilt = 2.0 * np.arctan2(np.linalg.norm(q[:, :3], axis=1), np.abs(q[:, 3]))
    assert tilt[3] <= expected["next_max_tilt"] + 1e-9


def painleve_rod(row: dict[str, float]) -> dict[str, Any]:
    """A rod on its lower end, C on the +x side of it, the end sliding towards -x at 1 m/s."""
    theta, half = row["theta"], 0.5
    along = np.array([math.cos(theta), 0.0, math.sin(theta)])
    spin = np.array([0.0, -row["thetadot"], 0.0])
    velocity = np.array([-1.0, 0.0, 0.0]) + np.cross(spin, half * along)
    body = {
        "mass": 1.0,
        "inertia": [1.0 / 12.0] * 3,
        "position": (half * along).tolist(),
        "orientation": {"axis": [0.0, 1.0, 0.0], "angle": math.pi / 2 - theta},
        "linear_velocity": velocity.tolist(),
        "angular_velocity": spin.tolist(),
    }
    contact = {"type": "contact", "body": "rod", "points": [[0.0, 0.0, -half]]}
    friction = {"type": "coulomb", "static": row["mu"]}
    return {
        "bodies": {"rod": body},
        "constraints": {"floor": contact | {"friction": friction}},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    }


@pytest.mark.parametrize("row", CASES["painleve_rod"]["expected"]["table"], ids=str)
def test_painleve(row: dict[str, Any]) -> None:
    """Where Coulomb's law has one answer it is found; where none, an impact; where two, a note."""
    run = contact_run(painleve_rod(row), [0.0, 1e-3], tolerance=1e-12)
    force = run.trajectory.reaction["floor"].force[0]
    kinds = [event.kind for event in run.events]
    verdict = row["classification"]
    if verdict == "sliding, unique":
        assert abs(force[2] / row["normal_force_if_sliding"] - 1.0) <= 1e-12
        assert abs(force[0] - row["mu"] * force[2]) <= 1e-12 * force[2]
    elif verdict.startswith("inconsistent"):
        assert kinds[0] == "jams"
        velocity = run.trajectory.linear_velocity["rod"][0]
        kinetic = 0.5 * velocity @ velocity
        kinetic += 0.5 / 12.0 * np.sum(run.trajectory.angular_velocity["rod"][0] ** 2)
        assert kinetic < 0.5  # of the sliding rod: an impact takes energy, never gives any
    else:
        assert ("ambiguous" in kinds) == verdict.startswith("indeterminate")
        assert not force.any()
    assert np.isfinite(run.trajectory.block.position).all()


SMOOTH_SHAPES = ("disk_wobble", "rattleback_kl_minus", "ball_eccentric", "cylinder_unbalanced")
"""Cases of the joint `rolling` that a perfectly rough contact must give as well."""


@pytest.mark.parametrize("name", SMOOTH_SHAPES)
def test_rough_contact_rolls(name: str, cases: dict[str, Any]) -> None:
    """A rough unilateral contact of rim, ellipsoid, ball, line: as long as it pushes, rolling."""
    case = cases[name]
    scene, spec = scene_of(case), case["constraint"]
    surface = {"type": "plane", "normal": spec["normal"], "point": spec["point"]}
    contact = {"type": "contact", "body": "body", "friction": {"type": "rough"}}
    scene["constraints"] = {"floor": contact | {"surface": surface}}
    t = [x for x in case["samples"]["t"] if x <= SPAN.get(name, math.inf)]
    case = case | {"samples": {k: v[: len(t)] for k, v in case["samples"].items()}}
    run = contact_run(scene, [*t, t[-1] + AFTER], tolerance=TIGHT)
    assert [e.kind for e in run.events if e.t > 0.0] == []
    found = column_errors(case, run)
    if name == "cylinder_unbalanced":  # its two ends share the force; the total is what counts
        found.pop("reaction_torque")
    assert max(found.values()) <= TRAJECTORY, found


SPAN = {"rattleback_kl_minus": 1.0, "ball_eccentric": 2.0}
"""[s] of the long ones: enough to tell, and interpreted in seconds."""


@pytest.mark.parametrize("name", ["ball_on_block", "ball_on_wedge"])
def test_contact_between_bodies(name: str, cases: dict[str, Any]) -> None:
    """A rough contact on a support that yields: as the joint, with equal and opposite forces."""
    case = cases[name]
    scene = ball_on_support(case)
    joint = scene["constraints"]["contact"]
    scene["constraints"]["contact"] = {
        "type": "contact",
        "body": "ball",
        "parent": "block",
        "surface": {"type": "plane", "normal": joint["normal_A"]},
        "friction": {"type": "rough"},
    }
    samples = case["samples_bodies"]
    run = contact_run(scene, samples["t"], tolerance=TIGHT)
    for body in ("block", "ball"):
        for column, field in (("position", "position"), ("velocity_world", "linear_velocity")):
            measured = getattr(run.trajectory, field)[body]
            assert worst_vector(measured, samples[body][column]) <= 1e-9
    force = run.trajectory.reaction["contact"].force
    assert worst_vector(force, samples["ball"]["contact_force"]) <= 1e-9


def test_interpreted_as_compiled() -> None:
    """The sources give as plain Python what the compiled kernels give."""
    case = CASES["sphere_slip_to_roll"]
    t = case["samples"]["t"]
    run = interpreted_run(contact_scene(case), [*t, t[-1] + AFTER], tolerance=TIGHT)
    assert max(column_errors(case, run).values()) <= TRAJECTORY
    assert abs(run.times("sticks")[0] - case["scalars"]["t_rolling"]) <= EVENT_TIME
