# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rounds of impacts of balls at the floor, by Newton's rule and the balance of their energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.problem.impacts import NOTHING, STRUCK
from tests.contact.scenes import ball, scene, touch
from tests.interpreted import interpreted

E, SLIP = 0.6, 0.7
COULOMB, ROUGH = {"mu": 0.05}, {"friction": {"type": "rough"}}


def struck(
    speeds: list[float], law: dict[str, Any], alone: bool = False, plastic: int = -1,
    together: int = -1, in_rounds: tuple[int, int, int] | None = None, closed: float = 0.0,
) -> dict[str, Any]:  # fmt: skip
    """What one strike, or rounds of them, make of balls at the floor that come down at these speeds
    and slip along y."""
    from rb_sim import load_scene
    from rb_sim.contact.events.instant import Instant, Tasks
    from rb_sim.contact.problem import impacts
    from rb_sim.mechanics.contact.contact_bodies import CLOSED
    from rb_sim.scene.compile import compile_scene

    names = ("body", "other", "third")[: len(speeds)]
    bodies = {name: ball([k, 0.0, 0.1], mass=1.0 + k) for k, name in enumerate(names)}
    floors = {name: touch(name, restitution=E, **law) for name in names}
    compiled = compile_scene(load_scene(scene(bodies, floors)))
    y = np.array(compiled.y, dtype=float)
    for k, speed in enumerate(speeds):
        y[13 * k + 8 : 13 * k + 10] = SLIP, -speed
    at = Instant(compiled.contact_laws, Tasks(compiled.system), 0.0, y)
    workspace, count = at.workspace, len(speeds)
    at.system.touch[:, CLOSED] = closed
    for table, c in ((workspace.plastic, plastic), (workspace.together, together)):
        table[:] = 0
        if c >= 0:
            table[c] = 1
    if in_rounds is None:
        status, n = impacts.strike(at.system, workspace, 0.5, y, alone), 0
    else:
        status, n = impacts.strike_in_rounds(at.system, workspace, 0.5, y, *in_rounds)
    return {
        "status": int(status), "round": int(n), "rebounding": workspace.rebounding.tolist(),
        "rises": [float(y[13 * k + 9]) for k in range(count)],
        "slips": [float(y[13 * k + 8]) for k in range(count)],
        "work": float(y[13 * count]), "notes": workspace.notes[: workspace.written[0]].tolist(),
        "undetermined": workspace.undetermined.tolist(),
    }  # fmt: skip


def lost(before: list[float], after: list[float]) -> float:
    return sum(
        0.5 * (1.0 + k) * (v * v - w * w)
        for k, (v, w) in enumerate(zip(after, before, strict=True))
    )


def test_all_that_come_down_rebound_by_e_and_contacts_do_the_work() -> None:
    found = interpreted(struck, [2.0, 0.5, 0.0], {})
    assert found["status"] == STRUCK and found["rebounding"] == [1, 1, 0]
    assert_allclose(found["rises"], [2.0 * E, 0.5 * E, 0.0], atol=1e-12)
    assert_allclose(found["slips"], SLIP)
    assert_allclose(found["work"], lost([2.0, 0.5, 0.0], found["rises"]), rtol=1e-12)
    assert found["undetermined"][1] == 0.0 and found["notes"] == []


def test_one_at_a_time_the_fastest_strikes() -> None:
    found = interpreted(struck, [0.5, 2.0, 1.0], {}, True)
    assert_allclose(found["rises"], [-0.5, 2.0 * E, -1.0], atol=1e-12)
    assert found["rebounding"] == [0, 1, 0]


def test_nothing_strikes_that_stays_or_leaves() -> None:
    found = interpreted(struck, [0.0, -1.0], {})
    assert found["status"] == NOTHING and found["rises"] == [0.0, 1.0] and found["work"] == 0.0
    assert interpreted(struck, [0.0, 1e-11], COULOMB)["status"] == NOTHING


def test_what_is_rough_stops_its_slip_once_it_strikes() -> None:
    """To 5/7 of it: the ball rolls then. So does what has just come to be closed, without a push;
    what obeys Coulomb slips on."""
    found = interpreted(struck, [2.0, 1.0], ROUGH)
    assert_allclose(found["rises"], [2.0 * E, E], atol=1e-12)
    assert_allclose(found["slips"], [5.0 / 7.0 * SLIP] * 2, rtol=1e-12)
    lies = interpreted(struck, [0.0, 0.0], ROUGH, False, -1, -1, None, 1.0)
    assert lies["status"] == STRUCK and lies["rises"] == pytest.approx([0.0, 0.0])
    assert_allclose(lies["slips"], [5.0 / 7.0 * SLIP] * 2, rtol=1e-12)
    assert interpreted(struck, [0.0, 0.0], COULOMB, False, -1, -1, None, 1.0)["status"] == NOTHING
    assert interpreted(struck, [-1.0, -1.0], ROUGH, False, -1, -1, None, 1.0)["status"] == NOTHING
    rubs = interpreted(struck, [2.0, 1.0], COULOMB)
    assert_allclose(rubs["slips"], SLIP - 0.05 * (1.0 + E) * np.array([2.0, 1.0]), rtol=1e-12)


@pytest.mark.parametrize(
    ("single", "rounds", "struck_first"), [(0, 1, [0, 1, 2]), (9, 3, [1, 2, 0])]
)
def test_rounds_go_on_until_nothing_approaches(
    single: int, rounds: int, struck_first: list[int]
) -> None:
    """All at once, or one after the other, the fastest first; each is noted with its impulse."""
    speeds = [0.5, 2.0, 1.0]
    found = interpreted(struck, speeds, {}, False, -1, -1, (0, 50, single))
    assert (found["status"], found["round"]) == (NOTHING, rounds)
    assert_allclose(found["rises"], E * np.array(speeds), atol=1e-12)
    contacts = [int(note[1]) for note in found["notes"]]
    assert contacts == struck_first and all(
        note[0] == 0.5 and note[2] == 0 for note in found["notes"]
    )
    impulses = [note[5] for note in found["notes"]]
    assert_allclose(impulses, [(1.0 + E) * (1.0 + c) * speeds[c] for c in contacts], rtol=1e-12)
    cut = interpreted(struck, speeds, {}, False, -1, -1, (0, 2, 9))
    assert (cut["round"], len(cut["notes"])) == (2, 2)
    late = interpreted(struck, speeds, {}, False, -1, -1, (3, 50, 2))  # beyond them all is plastic
    assert_allclose(late["rises"], 0.0, atol=1e-12)
    late = interpreted(struck, speeds, {}, False, -1, -1, (1, 50, 1))
    assert_allclose(late["rises"], 0.0, atol=1e-12)
