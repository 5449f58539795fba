# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Statics: reactions of bodies at rest, or why there is no equilibrium (LL 38)."""

import sys

from rb_sim.base.errors import Called
from rb_sim.scene.load import load_statics
from rb_sim.scene.schema import StaticsScene
from rb_sim.statics.solve import solve
from rb_sim.statics.statics_tables import Finding, Reaction, ReactionRange, StaticsResult

__all__ = [
    "Finding",
    "Reaction",
    "ReactionRange",
    "StaticsResult",
    "StaticsScene",
    "load_statics",
    "solve",
]

sys.modules[__name__].__class__ = Called  # rb_sim.statics is a function, too
