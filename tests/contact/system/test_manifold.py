"""The way back to the manifold on the lines that hold is that on all lines, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.contact.system.manifold import bring_to_manifold
from rb_sim.contact.system.terms import STUCK
from rb_sim.contact.system.touch import CLOSED, SLIDE
from rb_sim.engine.systems.multipliers import settle_bodies
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene
from tests.interpreted import interpreted


def both_ways(name: str, closed: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y off the manifold, and brought back with these contacts closed: on the lines that hold, and
    on all."""
    system = compile_scene(load_scene(name)).system
    y = np.array(compile_scene(load_scene(name)).y)
    rng = np.random.default_rng(len(closed))
    off = y + 1e-4 * rng.normal(size=len(y))
    for c in closed:
        system.touch[c, CLOSED], system.touch[c, SLIDE] = 1.0, STUCK
    system.rows[:], system.pushes[:] = 0.0, 0.0
    return off, bring_to_manifold(system, 0.1, off.copy()), settle_bodies(system, 0.1, off.copy())


@pytest.mark.parametrize(
    ("name", "closed"),
    [("dropped_box", ()), ("dropped_box", (2,)), ("dropped_box", (0, 5)), ("ball_on_block", (0,)),
     ("ball_on_block", ())],
)  # fmt: skip
def test_open_contacts_make_no_difference(name: str, closed: tuple[int, ...]) -> None:
    off, here, everywhere = interpreted(both_ways, name, closed)
    assert here.tobytes() == everywhere.tobytes()
    assert np.abs(here - off).max() > 1e-6
