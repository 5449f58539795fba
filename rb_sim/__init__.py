"""rb_sim: a ROS 2 node that simulates a constrained rigid body, exactly."""

from __future__ import annotations

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
