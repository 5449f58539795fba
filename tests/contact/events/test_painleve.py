# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A rod that slides on its end into Painleve's paradox: where it jams, and what is left."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.contact.events.instant import Instant, bring_back, leap
from rb_sim.mechanics.contact.contact_bodies import GAP, GAP_RATE
from tests.contact.scenes import G, ball, scene, touch
from tests.contact_runs import contact_run

ROD = Path(__file__).resolve().parents[3] / "config" / "painleve_rod.yaml"
MU, HALF, INERTIA = 1.6, 0.5, 1.0 / 12.0


def test_rod_jams_where_the_normal_force_would_be_infinite() -> None:
    """1 + 3 cos^2 a - 3 mu sin a cos a = 0; the impact goes through the end and stops it."""
    mapping = yaml.safe_load(ROD.read_text(encoding="utf-8"))
    first = contact_run(mapping, [0.0, 0.02], tolerance=1e-12)
    (jam,) = first.times("jams")
    run = contact_run(mapping, [jam - 1e-9, jam + 1e-9, 1.0], tolerance=1e-12).trajectory
    p, v = run.position["rod"], run.linear_velocity["rod"]
    w = run.angular_velocity["rod"][:, 1]
    lean = np.arcsin(p[:2, 2] / HALF)
    tangent = (3.0 * MU - math.sqrt(9.0 * MU**2 - 16.0)) / 2.0
    # the force grows without bound there; the event lies 1e-6 of the pivot before
    assert abs(lean[0] - math.atan(tangent)) < 2e-6
    ends = v[:2] + np.stack([-w[:2] * p[:2, 2], 0.0 * w[:2], w[:2] * HALF * np.cos(lean)], axis=1)
    assert ends[0, 0] < -1.0 and abs(ends[0, 2]) < 1e-6
    assert abs(ends[1, 0]) < 1e-6 and 0.0 <= ends[1, 2] < 1e-6 * abs(v[0, 0])
    arm = HALF * np.cos(lean[0]), HALF * np.sin(lean[0])
    about_end = [INERTIA * w[i] + arm[1] * v[i, 0] - arm[0] * v[i, 2] for i in (0, 1)]
    assert abs(about_end[1] - about_end[0]) < 1e-6
    assert np.isfinite(p).all()
    kinds = [event.kind for event in first.events]
    assert kinds == ["closes", "slips", "jams", "opens"]


@pytest.mark.parametrize(
    "method",
    [
        {"method": "rk4", "step": 1e-3},
        {"method": "dopri853", "step": 2e-3},
        {"method": "dopri853", "tolerance": 1e-3},
        {"method": "gauss6", "step": 1e-3},
    ],
)
def test_no_step_passes_the_instant_unseen(method: dict[str, Any]) -> None:
    """Beyond it the force pulls, and would be taken for a lift-off."""
    mapping = yaml.safe_load(ROD.read_text(encoding="utf-8"))
    exact = contact_run(mapping, [0.0, 0.01], tolerance=1e-12).times("jams")
    found = contact_run(mapping, [0.0, 0.01], **({"tolerance": None} | method))
    assert [event.kind for event in found.events] == ["closes", "slips", "jams", "opens"]
    assert abs(found.times("jams")[0] - exact[0]) < 1e-5


def test_a_ball_jams_though_no_step_comes_down_to_the_vanishing_pivot() -> None:
    """The force of a ball with its centre beside its middle turns the slip: the pivot vanishes as
    the root of the time left, which the clock cannot tell at 1e-6 of it (a random scene; it was
    refused as a singularity)."""
    inertia = [[8.17, 0.972, 0.591], [0.972, 12.2, 2.21], [0.591, 2.21, 10.3]]
    thrown = ball(
        [0.0376, 0.0621, 0.362], 0.163,
        inertia=[[1e-3 * x for x in row] for row in inertia],
        center_of_mass=[0.0416, 0.0266, 0.0389],
        orientation={"axis": [-0.968, 0.238, -0.0757], "angle": 2.14},
        linear_velocity=[0.253, -0.595, -0.861], angular_velocity=[-0.346, -2.88, -7.45],
    )  # fmt: skip
    thrown |= {"mass": 3.0, "shape": thrown["shape"] | {"center_B": [0.00349, 0.0339, -0.00925]}}
    shaken = {"type": "shaken", "direction": [1, 0, 0], "amplitude": 0.0287}
    belt = touch(mu=0.945, restitution=0.514, motion=shaken | {"frequency": 7.96, "phase": 1.78})
    mapping = scene(thrown, belt)
    (jam,) = contact_run(mapping, [0.0, 0.4915]).times("jams")
    run = contact_run(mapping, [0.0, jam - 1e-12, jam + 1e-12, 0.5])
    (impulse,) = [np.array(e.impulse) for e in run.events if e.kind == "jams"]
    r = run.trajectory
    turn = Rotation.from_quat(r.orientation["body"][2]).as_matrix()
    to_C = turn @ thrown["center_of_mass"]
    to_P = turn @ thrown["shape"]["center_B"] - [0.0, 0.0, 0.163]
    dv, dw = (x["body"][2] - x["body"][1] for x in (r.linear_velocity, r.angular_velocity))
    about_P = turn @ thrown["inertia"] @ dw + np.cross(to_C - to_P, impulse)
    # within 1e-12 s of it the growing force gives some 1e-6 N s besides, 1e-4 of it
    assert np.abs(3.0 * dv - impulse).max() < 1e-3 * np.linalg.norm(impulse)
    assert np.abs(about_P).max() < 1e-3 * np.linalg.norm(thrown["inertia"] @ dw)
    belt_speed = [0.0287 * 2.0 * np.pi * 7.96 * np.cos(2.0 * np.pi * 7.96 * jam + 1.78), 0.0, 0.0]
    at_P = np.cross(turn @ r.angular_velocity["body"][2], to_P - to_C)
    slip = r.linear_velocity["body"][2] + at_P - belt_speed
    assert np.hypot(*slip[:2]) < 1e-9 and slip[2] >= 0.0
    assert impulse[2] > 0.0 and np.hypot(*impulse[:2]) <= 0.945 * impulse[2] * (1.0 + 1e-6)
    assert run.balance() < 1e-9


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_poissons_e_gives_back_its_share_of_the_compression(restitution: float) -> None:
    """Per unit of normal impulse the slip falls by FRICTION ALONG - COUPLED and ends; stuck, the
    contact rises by NORMAL - COUPLED^2 / ALONG until it is back at rest; e times the impulse of
    both is given back, stuck as well."""
    mapping = yaml.safe_load(ROD.read_text(encoding="utf-8"))
    mapping["constraints"]["floor"]["restitution"] = restitution
    (jam,) = contact_run(mapping, [0.0, 0.02], tolerance=1e-12).times("jams")
    found = contact_run(mapping, [jam - 1e-9, jam + 1e-9], tolerance=1e-12)
    run, (impulse,) = found.trajectory, [e.impulse for e in found.events if e.kind == "jams"]
    p, v, w = run.position["rod"], run.linear_velocity["rod"], run.angular_velocity["rod"]
    height, ahead = p[0, 2], math.sqrt(HALF**2 - p[0, 2] ** 2)
    normal, along = 1.0 + ahead**2 / INERTIA, 1.0 + height**2 / INERTIA
    coupled, slip = ahead * height / INERTIA, abs(v[0, 0] - w[0, 1] * height)
    slipping = slip / (MU * along - coupled)
    rise = normal - coupled**2 / along
    stuck = slipping * (MU * coupled - normal) / rise
    np.testing.assert_allclose(impulse[2], (1.0 + restitution) * (slipping + stuck), rtol=1e-5)
    rises = v[1, 2] + w[1, 1] * ahead
    np.testing.assert_allclose(rises, restitution * (slipping + stuck) * rise, atol=1e-5)
    np.testing.assert_allclose(v[1, 0] - w[1, 1] * height, 0.0, atol=1e-6)


# A step of impulses books the work of every contact force.


ROLLING: dict[str, Any] = {
    "mass": 1.0,
    "shape": {"type": "disk", "radius": 0.1, "axis_B": [0, 0, 1]},
    "orientation": {"axis": [0, 1, 0], "angle": 1.2},
    "position": [0, 0, 0.1 * math.sin(1.2)],
    "linear_velocity": [0, 2.0, 0],
    "angular_velocity": [0, 0, -20.0],
}
STICKY: dict[str, Any] = {"friction": {"type": "coulomb", "static": 0.9, "kinetic": 0.5}}


def one_leap(body: dict, contact: dict, length: float) -> tuple[Any, list[float]]:
    """Velocities after a leap of this length [s], by how much they differ from those of the motion,
    and the gap, its rate and the slip of the contact after it."""
    motion: Any = Simulation(load_scene(scene(body, contact)))._motion
    start = np.array(motion.compiled.y)
    instant = Instant(motion.laws, motion._call, 0.0, start)
    assert leap(instant, length) is not None
    bring_back(instant)
    left = [*instant.system.contact_table[0, [GAP, GAP_RATE]].tolist(), instant.slip_speed(0)]
    motion.run_to(np.array([length]))
    return instant.y[7:13], [float(np.abs(instant.y - motion._grid.y)[7:13].max()), *left]


def test_a_leap_keeps_what_rolls_on_its_way() -> None:
    """The point of contact of a leaning disk runs on: what keeps it from slipping there is an
    impulse of first order, and the rim neither sinks in nor leaves."""
    rim = touch(**STICKY, lies_flat=False)
    (error, *left), (half, *_) = (one_leap(ROLLING, rim, h)[1] for h in (1e-4, 5e-5))
    assert np.abs(left).max() < 1e-14
    assert error < 1e-4 and half < 0.3 * error


def test_a_leap_holds_what_rests_on_a_support_that_gives_way() -> None:
    """Friction at rest takes the whole load along the slope, more than kinetic friction would."""
    normal = np.array([math.sin(0.6), 0, math.cos(0.6)])
    middle = (0.1 - G * normal[2] / 3e3) * normal
    surface = {"type": "plane", "normal": normal.tolist()}
    law = STICKY | {"compliance": {"stiffness": 3e3}, "surface": surface}
    block = {"mass": 1.0, "inertia": [1e6] * 3, "position": middle.tolist()}
    contact = touch(**law, points=[(-0.1 * normal).tolist()])
    velocities, _ = one_leap(block, contact, 1e-3)
    assert np.abs(velocities).max() < 1e-8


# Where a law of friction has no motion the run ends in one line, and nothing slips or sinks.


ROUGH = {"type": "rough"}


def hopping_hoop(rate: float, **more: Any) -> Any:
    """A ball with its weight near the surface that rolls: at this rate it would have to be pulled
    down to go on (Littlewood's hoop)."""
    heavy = ball([0, 0, 0.1], inertia=[6e-4] * 3, center_of_mass=[0, 0, 0.08])
    moving = {"angular_velocity": [0, rate, 0], "linear_velocity": [0.1 * rate, 0, 0]}
    return scene(heavy | moving, touch(friction=ROUGH, rolling_resistance=1e-3, **more))


@pytest.mark.parametrize("rate", [9.0, 12.0])
def test_what_is_perfectly_rough_does_not_slip_after_bounces(rate: float) -> None:
    """It leaves and is pressed back at once: bounces, after which it slid on without friction."""
    with pytest.raises(RbSimError, match="perfectly rough contact floor would have to pull"):
        contact_run(hopping_hoop(rate, restitution=0.24), np.linspace(0.0, 0.3, 4))


def test_nothing_ends_a_slip_at_once_on_a_support_that_gives_way() -> None:
    thrown = ball([0, 0, 0.11], linear_velocity=[1, 0, 0])
    soft = touch(friction=ROUGH, compliance={"stiffness": 1e4, "damping": 0.0})
    with pytest.raises(RbSimError, match="perfectly rough contact floor slips on a compliant"):
        contact_run(scene(thrown, soft), np.linspace(0.0, 0.1, 3))


def test_a_rough_ball_that_lies_on_such_a_support_rolls() -> None:
    rolling = ball([0, 0, 0.1 - 9.81e-4], linear_velocity=[1, 0, 0])
    rolling["angular_velocity"] = [0, 10, 0]
    soft = touch(friction=ROUGH, compliance={"stiffness": 1e4, "damping": 0.0})
    r = contact_run(scene(rolling, soft), np.linspace(0.0, 0.1, 3)).trajectory
    assert np.abs(r.linear_velocity["body"][:, 0] - 1.0).max() < 1e-9
    assert (r.contact_state["floor"] == 2.0).all()


@pytest.mark.parametrize("per_normal", [False, True])
@pytest.mark.parametrize(
    "support",
    [{}, {"compliance": {"stiffness": 1e4, "damping": 20.0}}],
    ids=["rigid", "compliant"],
)
def test_a_drag_that_lifts_its_body_off_is_refused(
    per_normal: bool, support: dict[str, Any]
) -> None:
    """The drag at a point ahead of the centre of mass turns it up; without it, it falls back. The
    damper of a compliant support presses it back at once: it opened and closed a million times."""
    sledge = {"mass": 1.0, "inertia": [2e-3] * 3, "position": [0, 0, 0.1]}
    drag = {"type": "viscous", "coefficient": 0.2 if per_normal else 2.0, "per_normal": per_normal}
    points = touch(points=[[0.1, 0, -0.1]], friction=drag, **support)
    mapping = scene(sledge | {"linear_velocity": [-2, 0, 0]}, points)
    if per_normal:
        contact_run(mapping, np.linspace(0.0, 0.05, 3))
        return
    with pytest.raises(RbSimError, match="viscous contact floor can neither stay closed nor open"):
        contact_run(mapping, np.linspace(0.0, 0.05, 3))
