# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Energy: what the contacts and the loads from outside have done is what it has changed by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.scene.schema import Scene
from tests.contact.scenes import acts_on, ball, box, scene, shipped, shipped_with_contacts, touch
from tests.contact_runs import contact_run
from tests.properties.test_newton_euler import CLOSE, defects

TOLERANCE = 1e-10
"""Of every step, relative to the coordinates: what energy the steps of these short runs gain or
lose is well below that part of the energy."""

SPANS = {
    "ball_on_block": 0.5, "bouncing_ball": 1.0, "colliding_spheres": 0.6, "incline_block": 0.2,
    "rattleback": 0.2, "rocking_block": 0.55, "sphere_in_cylinder": 0.5, "sphere_off_sphere": 1.5,
    "thrown_ball": 0.5, "tippe_top": 0.1, "turntable": 0.5,
}  # fmt: skip
"""[s], with the first events of each."""


@pytest.mark.parametrize("name", SPANS)
def test_shipped_scene_balances(name: str) -> None:
    """Energy minus work of contacts changes by the work of the loads that have no potential: in
    `ball_on_block` that of a constant push on a block which does not turn.  The turntable's is all
    work of the contact."""
    found = contact_run(shipped(name), np.linspace(0.0, SPANS[name], 5), tolerance=TOLERANCE)
    r = found.trajectory
    change = r.energy - r.contact_work
    if name == "ball_on_block":
        change = change - 5.0 * r.position["block"][:, 0]
    assert np.abs(change - change[0]).max() <= TOLERANCE * np.abs(r.energy).max()
    if name == "turntable":
        assert_allclose(r.contact_work, r.energy - r.energy[0], atol=TOLERANCE)
        assert np.abs(r.contact_work).max() > 1e-3


# A ball thrown onto a plane of a body that moves as well, with every law of friction.


COULOMB = {"friction": {"type": "coulomb", "static": 0.5, "kinetic": 0.3}}
ROUNDED = {"friction": {"type": "regularised", "coefficient": 0.4, "speed": 0.5}}
RESISTS = {"rolling_resistance": 0.01, "spinning_resistance": 0.02}
SOFT = {"compliance": {"stiffness": 3e3, "damping": 20.0}}
LAWS: dict[str, Any] = {
    "smooth": {},
    "coulomb": COULOMB,
    "coulomb that resists turning": COULOMB | RESISTS,
    "viscous": {"friction": {"type": "viscous", "coefficient": 0.7}},
    "viscous per normal": {"friction": {"type": "viscous", "coefficient": 0.7, "per_normal": True}},
    "regularised": ROUNDED,
    "soft": SOFT,
    "soft, coulomb that resists turning": SOFT | COULOMB | RESISTS,
    "soft, regularised that resists turning": SOFT | ROUNDED | RESISTS,
}
NORMAL = np.array([0.48, -0.6, 0.64])
ALONG = np.array([0.8, 0.64, 0.0]) / np.hypot(0.8, 0.64)


def thrown(law: dict[str, Any], **simulation: Any) -> dict[str, Any]:
    """Nothing acts on the two from outside; a spring draws them together."""
    foot = np.array([0.1, -0.2, 0.3])
    plate = box([0.3, 0.4, 0.5], [0, 0, 0], angular_velocity=[0.3, -0.2, 0.4])
    stone = ball(
        foot + 0.31 * NORMAL,
        0.3,
        linear_velocity=3.0 * ALONG - 0.2 * NORMAL,
        angular_velocity=[0.5, 1.0, -2.0],
        center_of_mass=[0.02, 0.01, -0.03],
        inertia=[0.03, 0.035, 0.04],
    )
    plane = {"type": "plane", "point": foot.tolist(), "normal": NORMAL.tolist()}
    contact = touch("stone", parent="plate", surface=plane, restitution=0.3)
    if "compliance" in law:
        del contact["restitution"]
    draws = {"type": "spring", "body": "stone", "parent": "plate", "stiffness": 60.0}
    bodies = {"plate": plate | {"mass": 2.5}, "stone": stone}
    mapping = scene(bodies, contact | law, gravity=False, draws=draws)
    return mapping | {"simulation": {"duration": 0.4, "rate": 50.0} | simulation}


@pytest.mark.parametrize("law", LAWS)
def test_two_bodies_balance_whatever_the_law(law: str) -> None:
    """Momenta stay, energy changes by the work of the contact, which takes some, and each body
    moves by the forces and torques that are reported."""
    mapping = thrown(LAWS[law])
    run = Simulation(load_scene(mapping)).run(checks=False)
    for momentum in (run.momentum, run.angular_momentum):
        assert_allclose(momentum, np.tile(momentum[0], (len(run.t), 1)), atol=1e-9)
    change = run.energy - run.contact_work
    assert_allclose(change, change[0], atol=1e-8)
    assert run.energy[-1] < run.energy[0] - 1e-3
    seen = [defects(mapping, t) for t in (0.04, 0.15, 0.3)]
    assert any(seen)
    assert max(max(found) for found in seen if found) <= CLOSE


@pytest.mark.parametrize("law", LAWS)
def test_time_stepping_moves_them_as_events_do(law: str) -> None:
    """To first order of the step, at a few mm/s of 3 m/s; their momentum stays."""
    exact = Simulation(load_scene(thrown(LAWS[law]))).run(checks=False)
    steps = {"method": "time_stepping", "step": 2.5e-4}
    run = Simulation(load_scene(thrown(LAWS[law], **steps))).run(checks=False)
    for body in ("plate", "stone"):
        assert_allclose(run.position[body][-1], exact.position[body][-1], atol=1e-4)
        assert_allclose(run.linear_velocity[body][-1], exact.linear_velocity[body][-1], atol=2e-3)
        spins = run.angular_velocity[body][-1], exact.angular_velocity[body][-1]
        assert_allclose(*spins, atol=5e-3)
    assert np.ptp(run.momentum, axis=0).max() < 1e-12
    assert np.ptp(run.angular_momentum, axis=0).max() < 2e-5
    assert np.ptp(run.energy - run.contact_work) < 2e-5


# Event-driven methods report all that acts: impulses, reactions and effects are the momentum.
#
# Newton's second law over a run, for every body: m (v(T) - v(0)) = integral of (F + effects) dt
# + impulses of its events, F all reactions BY constraints ON the body. The integral is that of
# Gauss's rule between the events, at instants that the run itself knows nothing of.


DURATION, PIECES, POINTS = 0.7, 100, 10
NODES, WEIGHTS = np.polynomial.legendre.leggauss(POINTS)
GRADES = 0.3 ** np.arange(1.0, 28.0)
METHODS: dict[str, tuple[dict[str, Any], float]] = {
    "dopri853": ({"tolerance": 1e-10}, 1e-9),
    "rk4": ({"step": 5e-4}, 1e-6),
}
"""Options, and the error that is left to the method, of fourth order the one."""
JAMMED = 1e-4
"""Left to steps of fixed length before a jam, where a force grows sevenfold in a millisecond."""


def pieces(duration: float, events: list[Any]) -> np.ndarray:
    """Ends of pieces between which reactions are smooth; finer towards a jam, before which a
    reaction grows beyond all bounds."""
    long = duration / PIECES
    inside = [e for e in events if 0.0 < e.t < duration]
    graded = [e.t - long * GRADES for e in inside if e.kind == "jams"]
    even = np.linspace(0.0, duration, PIECES + 1)
    cuts = np.unique(np.concatenate([even, [e.t for e in inside], *graded]))
    return cuts[np.diff(cuts, prepend=-1.0) > 1e-14]


def momentum_error(scene: Scene, duration: float = DURATION) -> float:
    """Largest difference over the bodies of m dv and what was reported, over m g T + m |v|."""
    events = Simulation(scene, announce=None).run(checks=False).events
    cuts = pieces(duration, events)
    start, width = cuts[:-1], np.diff(cuts)
    at = (start[:, None] + 0.5 * width[:, None] * (1.0 + NODES)).ravel()
    t = np.unique([0.0, *at, duration])
    run = Simulation(scene, announce=None).run(at=t, checks=False)
    rows, weights = np.searchsorted(t, at), (0.5 * width[:, None] * WEIGHTS).ravel()
    worst = 0.0
    for name, body in scene.bodies.items():
        gained = np.zeros(3)
        for key, constraint in scene.constraints.items():
            sign = acts_on(constraint, name)
            gained += sign * weights @ run.reaction[key].force[rows]
            for event in run.events:
                if event.contact.split("/")[0] == key:
                    gained += sign * np.array(event.impulse)
        for key, effect in scene.effects.items():
            if force := run.effect.get(key, run.effect.get(f"{key}/{name}")):
                gained += acts_on(effect, name) * weights @ force.force[rows]
        v = run.linear_velocity[name]
        error = np.abs(body.mass * (v[-1] - v[0]) - gained).max()
        fastest = np.linalg.norm(v, axis=1).max()
        worst = max(worst, error / (body.mass * (9.81 * duration + fastest)))
    return worst


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", shipped_with_contacts())
def test_of_shipped_scenes(name: str, method: str) -> None:
    options, bound = METHODS[method]
    scene = load_scene(name, method=method, duration=DURATION, rate=2.0 / DURATION, **options)
    if name == "painleve_rod" and method == "rk4":
        bound = JAMMED
    assert momentum_error(scene) < bound
