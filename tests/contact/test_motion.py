# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which motion a scene has: smooth without contacts, cut at events or stepped with them."""

from __future__ import annotations

from typing import Any

import pytest

from rb_sim.contact.choose_motion import motion_of
from rb_sim.contact.events.event_motion import ContactMotion
from rb_sim.contact.stepping.stepping_motion import SteppedContacts
from rb_sim.motion.traced import TracedMotion
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.compile_contacts import grouped_contacts
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.place import InitialPlace
from tests.contact.scenes import ball, box, scene, touch

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


def test_points_are_named_after_their_contact_and_numbered_where_there_are_several() -> None:
    """Those of one kind one after the other, in the order in which the kinds come first."""
    bodies = {"b": box([0.2, 0.2, 0.2], [0, 0, 1]), "s": ball([1, 0, 1]), "t": ball([2, 0, 1])}
    floors = {"one": touch("s"), "many": touch("b"), "rubs": touch("t", mu=0.5), "two": touch("t")}
    given = scene_from_mapping(scene(bodies, floors))
    found = grouped_contacts(given, InitialPlace(given))
    names = [name for _, _, _, name in found]
    corners = [f"many/{k}" for k in range(1, 9)]
    assert names == ["one", "two", *corners, "rubs"]
    assert [owner for owner, _, _, _ in found] == ["one", "two", *["many"] * 8, "rubs"]
    assert all(spec is given.constraints[owner] for owner, spec, _, _ in found)
