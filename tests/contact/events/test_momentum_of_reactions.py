# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Event-driven methods report all that acts: impulses, reactions and effects are the momentum.

Newton's second law over a run, for every body: m (v(T) - v(0)) = integral of (F + effects) dt
+ impulses of its events, F all reactions BY constraints ON the body. The integral is that of
Gauss's rule between the events, at instants that the run itself knows nothing of.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.scene.schema import Scene
from tests.contact.scenes import acts_on, shipped_with_contacts

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
