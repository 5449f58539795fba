"""rb_sim: a ROS 2 node that simulates a constrained rigid body, exactly.

The names below load when they are first used: what needs no numerics starts without them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rb_sim.errors import RbSimError, SceneError, SimulationError
    from rb_sim.scene.load import load_scene
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation import Simulation, State
    from rb_sim.trajectory import Trajectory

__all__ = [
    "RbSimError",
    "Scene",
    "SceneError",
    "Simulation",
    "SimulationError",
    "State",
    "Trajectory",
    "load_scene",
]
__version__ = "0.1.0"

_HOMES = {
    "RbSimError": "rb_sim.errors",
    "Scene": "rb_sim.scene.schema",
    "SceneError": "rb_sim.errors",
    "Simulation": "rb_sim.simulation",
    "SimulationError": "rb_sim.errors",
    "State": "rb_sim.simulation",
    "Trajectory": "rb_sim.trajectory",
    "load_scene": "rb_sim.scene.load",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
