# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""rb_sim: rigid bodies under constraints, exactly, with the reaction of every constraint.

    run = rb_sim.Simulation("heavy_top").run()
    run.position["top"], run.reaction["tip"].force     # (n, 3) each, SI, world axes

The names below load when they are first used: what needs no numerics starts without them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rb_sim.base import __version__ as __version__

if TYPE_CHECKING:
    from rb_sim.base.errors import (
        AccuracyWarning,
        RbSimError,
        SceneError,
        SceneWarning,
        SimulationError,
    )
    from rb_sim.cli.public import analyze, compare, fit, linearize, statics
    from rb_sim.scene.listing import list_scenes as scenes
    from rb_sim.scene.load import SceneBuilder, load_scene, load_statics
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.reaction_ranges import reaction_ranges
    from rb_sim.simulation.record import State
    from rb_sim.simulation.simulation import Simulation
    from rb_sim.simulation.trajectory import Trajectory
    from rb_sim.sweeps.sweep import sweep

__all__ = [
    "AccuracyWarning",
    "RbSimError",
    "Scene",
    "SceneBuilder",
    "SceneError",
    "SceneWarning",
    "Simulation",
    "SimulationError",
    "State",
    "Trajectory",
    "analyze",
    "compare",
    "fit",
    "linearize",
    "load_scene",
    "load_statics",
    "reaction_ranges",
    "scenes",
    "statics",
    "sweep",
]

_HOMES = {
    "AccuracyWarning": "rb_sim.base.errors",
    "RbSimError": "rb_sim.base.errors",
    "Scene": "rb_sim.scene.schema",
    "SceneBuilder": "rb_sim.scene.load",
    "SceneError": "rb_sim.base.errors",
    "SceneWarning": "rb_sim.base.errors",
    "Simulation": "rb_sim.simulation.simulation",
    "SimulationError": "rb_sim.base.errors",
    "State": "rb_sim.simulation.record",
    "Trajectory": "rb_sim.simulation.trajectory",
    "analyze": "rb_sim.cli.public",
    "compare": "rb_sim.cli.public",
    "fit": "rb_sim.cli.public",
    "linearize": "rb_sim.cli.public",
    "load_scene": "rb_sim.scene.load",
    "load_statics": "rb_sim.scene.load",
    "reaction_ranges": "rb_sim.simulation.reaction_ranges",
    "scenes": "rb_sim.scene.listing",
    "statics": "rb_sim.cli.public",
    "sweep": "rb_sim.sweeps.sweep",
}


_NAMES_THERE = {"scenes": "list_scenes"}
"""Where the name at home is another."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rb_sim.base.errors import named_if_lacking

    with named_if_lacking():
        module = import_module(_HOMES[name])
    value = getattr(module, _NAMES_THERE.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
