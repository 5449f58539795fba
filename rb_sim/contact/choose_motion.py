# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which motion a compiled scene has: smooth, cut at events, or stepped."""

from __future__ import annotations

from typing import Any

from rb_sim.base.errors import SceneError
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.methods import TimeStepping
from rb_sim.motion.motion import Motion
from rb_sim.motion.traced import TracedMotion


def motion_of(compiled: Compiled, method: Any) -> Motion:
    """The Motion of a compiled scene: with events only where there are contacts."""
    if not compiled.layout.contacts:
        return TracedMotion(compiled, method)
    # what scenes without contacts need not wait for
    if isinstance(method, TimeStepping):
        from rb_sim.contact.stepping.stepping_motion import SteppedContacts

        return SteppedContacts(compiled, method)
    if compiled.between is not None:
        scene = compiled.between.scene
        group = next(iter(compiled.between.groups))
        name = scene.simulation.method
        asked = f"got {name!r}; must be time_stepping, "
        compared = "cannot be compared with other methods: time_stepping is "
        raise SceneError(
            f"{compared if name == 'time_stepping' else asked}the only one for a contact `between` "
            f"bodies (constraints.{group}); for others list each pair as a contact with body and "
            "parent",
            key="simulation.method",
            file=scene.file,
        )
    from rb_sim.contact.events.event_motion import ContactMotion

    return ContactMotion(compiled, method)
