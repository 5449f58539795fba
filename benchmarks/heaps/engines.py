# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A heap in rb_sim, in MuJoCo and in Drake, each stepped by the same step."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.heaps import scenes
from benchmarks.heaps.overlap import planes_of

Array = np.ndarray


class OfRbSim:
    """A heap in rb_sim."""

    name = "rb_sim"

    def __init__(self, mapping: dict[str, Any], step: float) -> None:
        from rb_sim import Simulation, load_scene

        options = mapping["simulation"] | {"step": step}
        self.step = step
        self.simulation = Simulation(load_scene(mapping | {"simulation": options}))
        self.simulation.warm()
        self.simulation.reset()

    def run(self, steps: int) -> None:
        self.simulation.advance(steps * self.step)

    def poses(self) -> tuple[Array, Array]:
        """Positions and orientations of all bodies."""
        state = self.simulation.state
        return np.array(list(state.position.values())), np.array(list(state.orientation.values()))

    def note(self) -> str:
        """What the solver says of itself."""
        unsolved, worst = self.simulation.unsolved_steps
        reported = f"{unsolved} of {self.simulation.steps} unsolved, worst {worst:.0e}"
        return f"{reported}, violation {self.simulation.solver_give:.0e}"


class OfMuJoCo:
    """The same heap in MuJoCo, at its default solver and tolerance with elliptic cones."""

    name = "MuJoCo"

    def __init__(self, mapping: dict[str, Any], step: float) -> None:
        import mujoco

        self.mujoco: Any = mujoco
        self.model = self.mujoco.MjModel.from_xml_string(model_text(mapping, step))
        self.data = self.mujoco.MjData(self.model)
        none = [0.0, 0.0, 0.0]
        for i, body in enumerate(mapping["bodies"].values()):
            self.data.qvel[6 * i : 6 * i + 3] = body.get("linear_velocity", none)
            self.data.qvel[6 * i + 3 : 6 * i + 6] = body.get("angular_velocity", none)

    def run(self, steps: int) -> None:
        self.mujoco.mj_step(self.model, self.data, steps)

    def poses(self) -> tuple[Array, Array]:
        return self.data.xpos[1:].copy(), self.data.xquat[1:][:, [1, 2, 3, 0]].copy()

    def note(self) -> str:
        return ""


def model_text(mapping: dict[str, Any], step: float) -> str:
    """The heap as MJCF: planes of the world once each, every body free; all pairs may touch."""
    planes, bodies = [], []
    for point, normal in planes_of(mapping):
        place = f'pos="{words(point)}" zaxis="{words(normal)}"'
        planes.append(f'<geom type="plane" size="5 5 1" {place}/>')
    for name, body in mapping["bodies"].items():
        shape = body["shape"]
        size = [shape["radius"]] if shape["type"] == "sphere" else [0.5 * x for x in shape["size"]]
        bodies.append(
            f'<body name="{name}" pos="{words(body["position"])}"><freejoint/>'
            f'<geom type="{shape["type"]}" size="{words(size)}" mass="{body["mass"]}"/></body>'
        )
    return (
        f'<mujoco><option timestep="{step}" cone="elliptic" gravity="0 0 {-scenes.G}"/>'
        f'<default><geom friction="{scenes.MU} 0 0" condim="3"/></default>'
        f"<worldbody>{''.join(planes)}{''.join(bodies)}</worldbody></mujoco>"
    )


def words(values: Any) -> str:
    return " ".join(f"{value:.17g}" for value in values)


class OfDrake:
    """The same heap in Drake's discrete plant at its default contact solver: boxes as compliant
    hydroelastic bodies (points alone give two boxes one point), balls by points."""

    name = "Drake"

    def __init__(self, mapping: dict[str, Any], step: float) -> None:
        import pydrake.all

        drake: Any = pydrake.all
        self.step, self.time = step, 0.0
        builder = drake.DiagramBuilder()
        self.plant, _ = drake.AddMultibodyPlantSceneGraph(builder, step)
        properties = drake.ProximityProperties()
        rub = drake.CoulombFriction(scenes.MU, scenes.MU)
        drake.AddContactMaterial(None, None, rub, properties)
        soft = drake.ProximityProperties(properties)
        drake.AddCompliantHydroelasticProperties(0.05, 1e7, soft)
        stiff = drake.ProximityProperties(properties)
        drake.AddRigidHydroelasticProperties(stiff)
        world = self.plant.world_body()
        for k, (point, normal) in enumerate(planes_of(mapping)):
            X = drake.HalfSpace.MakePose(normal, point)
            self.plant.RegisterCollisionGeometry(world, X, drake.HalfSpace(), f"plane{k}", stiff)
        self.bodies = []
        for name, body in mapping["bodies"].items():
            shape, mass = body["shape"], body["mass"]
            if shape["type"] == "sphere":
                solid = drake.Sphere(shape["radius"])
                inertia = drake.SpatialInertia.SolidSphereWithMass(mass, shape["radius"])
            else:
                solid = drake.Box(*shape["size"])
                inertia = drake.SpatialInertia.SolidBoxWithMass(mass, *shape["size"])
            self.bodies.append(self.plant.AddRigidBody(name, inertia))
            give = properties if shape["type"] == "sphere" else soft
            self.plant.RegisterCollisionGeometry(
                self.bodies[-1], drake.RigidTransform(), solid, name, give
            )
        self.plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -scenes.G])
        self.plant.Finalize()
        self.simulator = drake.Simulator(builder.Build())
        whole = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(whole)
        for one, body in zip(self.bodies, mapping["bodies"].values(), strict=True):
            X = drake.RigidTransform(np.array(body["position"], float))
            self.plant.SetFreeBodyPose(self.context, one, X)
            v = drake.SpatialVelocity(
                np.array(body.get("angular_velocity", [0.0] * 3)),
                np.array(body.get("linear_velocity", [0.0] * 3)),
            )
            self.plant.SetFreeBodySpatialVelocity(context=self.context, body=one, V_JpJc=v)
        self.simulator.Initialize()

    def run(self, steps: int) -> None:
        self.time += steps * self.step
        self.simulator.AdvanceTo(self.time)

    def poses(self) -> tuple[Array, Array]:
        poses = [self.plant.EvalBodyPoseInWorld(self.context, body) for body in self.bodies]
        turns = [X.rotation().ToQuaternion() for X in poses]
        return (
            np.array([X.translation() for X in poses]),
            np.array([[q.x(), q.y(), q.z(), q.w()] for q in turns]),
        )

    def note(self) -> str:
        return ""


ENGINES: dict[str, Any] = {engine.name: engine for engine in (OfRbSim, OfMuJoCo, OfDrake)}
