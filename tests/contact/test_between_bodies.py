# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contacts between two bodies that both move: momenta, power, reported reactions, dissipation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.balance import Balance, assert_balanced, balance_at, random_motion, two_bodies
from tests.interpreted import interpreted
from tests.moving import unit

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
    touch = system.touch
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
        y[13:16] -= system.touch[0, GAP] * system.touch[0, NORMAL : NORMAL + 3]
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
