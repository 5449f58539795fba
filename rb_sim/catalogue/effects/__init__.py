# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Registry of the effect kinds; only effects that a scene names are compiled."""

from __future__ import annotations

from rb_sim.catalogue.effects.drag import AngularDamping, LinearDrag, QuadraticDrag
from rb_sim.catalogue.effects.gravity import Gravity
from rb_sim.catalogue.effects.spring import Spring
from rb_sim.catalogue.effects.torsion import TorsionSpring
from rb_sim.catalogue.effects.wrench import CommandedWrench, Wrench, WrenchTable
from rb_sim.catalogue.spec import Spec

SPECS: dict[str, type[Spec]] = {
    "gravity": Gravity,
    "linear_drag": LinearDrag,
    "quadratic_drag": QuadraticDrag,
    "angular_damping": AngularDamping,
    "spring": Spring,
    "torsion_spring": TorsionSpring,
    "wrench": Wrench,
    "wrench_table": WrenchTable,
    "commanded_wrench": CommandedWrench,
}
