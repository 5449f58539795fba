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
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.scene.listing import find_scene
from rb_sim.scene.schema import Scene
from rb_sim.scene.yaml_reader import parse
from tests.balance import Balance, assert_balanced, balance_at, random_motion, two_bodies
from tests.contact.scenes import acts_on, shipped_with_contacts
from tests.contact_runs import contact_run
from tests.interpreted import interpreted
from tests.moving import unit

TOLERANCE = 1e-10
"""Of every step, relative to the coordinates: what energy the steps of these short runs gain or
lose is well below that part of the energy."""

SPANS = {
    "ball_on_block": 0.5, "bouncing_ball": 1.0, "colliding_spheres": 0.6, "incline_block": 0.2,
    "rattleback": 0.2, "rocking_block": 0.55, "sphere_in_cylinder": 0.5, "sphere_off_sphere": 1.5,
    "thrown_ball": 0.5, "tippe_top": 0.1, "turntable": 0.5,
}  # fmt: skip
"""[s], with the first events of each."""


def shipped(name: str) -> Any:
    """The mapping of a shipped scene."""
    path = find_scene(name)
    return parse(path.read_text(), path.name)


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


def test_stick_slip_balances() -> None:
    """The drive does k v t dx, by Gauss's rule over the first slip; else nothing moves."""
    slip, stick = 0.981, 0.981 + 0.364065
    x, w = np.polynomial.legendre.leggauss(24)
    t = 0.5 * (slip + stick) + 0.5 * (stick - slip) * x
    found = contact_run(shipped("stick_slip"), [0.0, *t, 1.4], tolerance=TOLERANCE)
    r = found.trajectory
    drive = 5.0 * t * r.linear_velocity["block"][1:-1, 0]
    work = 0.5 * (stick - slip) * float(w @ drive)
    change = r.energy[-1] - r.contact_work[-1] - r.energy[0]
    assert work > 0.1
    assert abs(change - work) <= 1e-9


# Contacts between two bodies that both move: momenta, power, reported reactions, dissipation.


SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=5, deadline=None, derandomize=True)

BALL = {"type": "sphere", "radius": 0.3, "center_B": [0.02, 0.01, 0.03]}
BOX = {"type": "box", "size": [0.3, 0.4, 0.5]}
PLANE = {"type": "plane", "point": [0.1, -0.2, 0.3], "normal": [0.48, -0.6, 0.64]}
COULOMB = {"friction": {"type": "coulomb", "static": 0.5, "kinetic": 0.3}}
RESISTS = {"rolling_resistance": 0.01, "spinning_resistance": 0.02}
SOFT = {"compliance": {"stiffness": 1e-9, "damping": 3.0}}
"""Hardly stores anything: what it does is what its damper loses."""
LAWS: dict[str, Any] = {
    "smooth": {},
    "coulomb": COULOMB,
    "coulomb that resists turning": COULOMB | RESISTS,
    "viscous": {"friction": {"type": "viscous", "coefficient": 0.7}},
    "viscous per normal": {"friction": {"type": "viscous", "coefficient": 0.7, "per_normal": True}},
    "regularised": {"friction": {"type": "regularised", "coefficient": 0.4, "speed": 0.1}},
    "soft": SOFT,
    "soft, coulomb": SOFT | COULOMB,
    "soft, coulomb that resists turning": SOFT | COULOMB | RESISTS,
    "soft, regularised that resists turning": SOFT
    | RESISTS
    | {"friction": {"type": "regularised", "coefficient": 0.4, "speed": 0.1}},
}
MODES = {"slides": (1.0, 1.0, 1.0), "sticks": (2.0, 2.0, 2.0), "rolls, spins": (2.0, 2.0, 1.0)}
"""SLIDE, ROLL, SPIN of what is in contact."""


def contact_balance(law: str, modes: tuple[float, ...], seed: int) -> tuple[Balance, float]:
    """The Balance of a contact in these modes, and its normal force."""
    from rb_sim import load_scene
    from rb_sim.contact.events.search import begin_step
    from rb_sim.mechanics.contact.contact_bodies import CLOSED, NORMAL_FORCE, ROLL, SLIDE, SPIN
    from rb_sim.scene.compile import compile_scene

    contact = {"type": "contact", "surface": PLANE} | LAWS[law]
    mapping = two_bodies(contact, a={"shape": BOX}, body={"shape": BALL, "position": [2, 2, 2.0]})
    compiled = compile_scene(load_scene(mapping))
    system, rng = compiled.system, np.random.default_rng(seed)
    touch = system.contact_table
    touch[:, CLOSED] = 1.0
    touch[:, [SLIDE, ROLL, SPIN]] = modes
    for column, arm in ((ROLL, "rolling_resistance"), (SPIN, "spinning_resistance")):
        if arm not in contact:
            touch[:, column] = 0.0
    y = random_motion(system, together(system, compiled.y, rng), rng, False)
    begin_step(system, 0.0, y, np.zeros_like(y))
    found = balance_at(compiled, y)
    return found, float(touch[0, NORMAL_FORCE])


def together(system: Any, y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random places and attitudes of the two, the body shifted until it touches."""
    from rb_sim.mechanics.contact.accelerations import contact_accelerations
    from rb_sim.mechanics.contact.contact_bodies import GAP, NORMAL

    y = y.copy()
    for i in range(2):
        y[13 * i : 13 * i + 3], y[13 * i + 3 : 13 * i + 7] = rng.normal(size=3), unit(rng, 4)
    y[13:16] += [2.0, 1.5, -1.0]
    for _ in range(30):
        contact_accelerations(system, 0.0, y)
        y[13:16] -= system.contact_table[0, GAP] * system.contact_table[0, NORMAL : NORMAL + 3]
    return y


def possible(law: str, mode: str) -> bool:
    """Only a law with a corner sticks; only what resists turning rolls."""
    if mode == "slides":
        return True
    return "coulomb" in law and ("turning" in law or mode == "sticks")


@pytest.mark.parametrize(
    ("law", "mode"), [(law, mode) for law in LAWS for mode in MODES if possible(law, mode)]
)
@FEW
@given(SEEDS)
def test_contact_balances_whatever_the_law(law: str, mode: str, seed: int) -> None:
    """Of a ball on a plane: momenta stay, dE/dt is the power reported, each body moves by what is
    reported, and what pushes takes energy. Of all other pairs test_every_pair asks the same."""
    found, normal = interpreted(contact_balance, law, MODES[mode], seed)
    assert_balanced(found)
    assert found.unexplained <= 1e-11 * found.size
    rubs = normal > 0.0 and law != "smooth"
    if rubs and mode == "slides":
        assert found.energy_rate < 0.0
    if mode == "sticks" and "soft" not in law:
        assert abs(found.power) <= 1e-11 * found.size


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
    events = Simulation(scene, announce=None).run(watched=False).events
    cuts = pieces(duration, events)
    start, width = cuts[:-1], np.diff(cuts)
    at = (start[:, None] + 0.5 * width[:, None] * (1.0 + NODES)).ravel()
    t = np.unique([0.0, *at, duration])
    run = Simulation(scene, announce=None).run(at=t, watched=False)
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
