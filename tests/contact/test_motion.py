"""Which motion a scene has: smooth without contacts, cut at events or stepped with them."""

from __future__ import annotations

from typing import Any

import pytest

from rb_sim.contact.choose_motion import motion_of
from rb_sim.contact.events.event_motion import ContactMotion
from rb_sim.contact.stepping.stepping_motion import SteppedContacts
from rb_sim.motion.traced import TracedMotion
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import ball, scene, touch

STEPS = {"method": "time_stepping", "step": 0.01}
EVENTS = {"method": "dopri853", "tolerance": 1e-6}


@pytest.mark.parametrize(
    ("constraints", "method", "kind"),
    [
        ({}, EVENTS, TracedMotion),
        ({"floor": touch()}, EVENTS, ContactMotion),
        ({"floor": touch()}, STEPS, SteppedContacts),
    ],
)
def test_the_motion_of_a_scene(constraints: Any, method: dict[str, Any], kind: type) -> None:
    mapping = scene({"body": ball([0, 0, 1])}, constraints)
    loaded = scene_from_mapping(mapping | {"simulation": {"duration": 1.0} | method})
    compiled = compile_scene(loaded)
    assert type(motion_of(compiled, compile_method(loaded.simulation, 1.0))) is kind
