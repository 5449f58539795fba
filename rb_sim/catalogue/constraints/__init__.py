# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Registry of the constraint kinds: the name in a scene file and its spec."""

from __future__ import annotations

from rb_sim.catalogue.constraints.joints import FixedPoint, Free, Translation, Weld
from rb_sim.catalogue.constraints.rolling import Rolling
from rb_sim.catalogue.constraints.simple import (
    Distance,
    FixedAxis,
    Parallel,
    Plane,
    String,
    Velocity,
)
from rb_sim.catalogue.contact import Contact
from rb_sim.catalogue.spec import Spec

SPECS: dict[str, type[Spec]] = {
    "free": Free,
    "fixed_point": FixedPoint,
    "fixed_axis": FixedAxis,
    "translation": Translation,
    "rolling": Rolling,
    "distance": Distance,
    "plane": Plane,
    "parallel": Parallel,
    "weld": Weld,
    "velocity": Velocity,
    "contact": Contact,
    "string": String,
}
