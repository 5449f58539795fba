# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Exudyn: explicit Lie-group integrators where no joint is needed, implicit ones with joints.

The heavy top is also stated as an equal body without offset (inertia about the fixed point, its
centre held by coordinate constraints, the weight as a force at the centre of mass), the only form
that Exudyn's explicit integrators with eliminated coordinates solve rightly. The pendulum is also
stated as a kinematic tree of one joint.
"""

from __future__ import annotations

import exudyn
import numpy as np
from exudyn import utilities as exu
from scipy.spatial.transform import Rotation

from benchmarks.peers.engine import Run, Samples, Way, steps, tolerances
from benchmarks.peers.scenes import Array, Scene, rotation

PACKAGE = "exudyn"
KIND = "engine"

_SOLVER = exudyn.DynamicSolverType


def ways(scene: Scene) -> list[Way]:
    """Explicit ways over steps and tolerances, implicit ways over steps; no sphere joint exists."""
    if scene.name == "rolling_sphere":
        return []
    ladder = steps(scene)
    explicit = [
        Way("RK44/LG", ladder),
        Way("RK67/LG", ladder),
        Way("DOPRI5/LG", tolerances(3, 13)),
    ]
    joint = [Way("TrapezoidalIndex2/EP", ladder), Way("GeneralizedAlpha/EP", ladder)]
    if scene.name == "rolling_disk":
        return joint
    if scene.name == "pendulum":
        return [Way("RK44/tree", ladder), Way("RK67/tree", ladder), *joint]
    return explicit + joint if scene.name == "heavy_top" else explicit


def build(scene: Scene, method: str, knob: float) -> Run:
    """The system with the solver of `method`, step [s] or tolerance `knob`."""
    return _Exudyn(scene, method, knob)


class _Exudyn(Run):
    """Every run starts from the initial state, so `advance` goes from the start to the end."""

    def __init__(self, scene: Scene, method: str, knob: float) -> None:
        self._scene, self._knob = scene, knob
        self._solver_name, self._form = method.split("/")

    def _assemble(self, sampled: bool) -> None:
        self._container = exudyn.SystemContainer()
        self._system = self._container.AddSystem()
        sensor = {"storeInternal": True, "writeToFile": False}
        if self._form == "tree":
            tree = _tree(self._scene, self._system)
            self._sensor = self._system.AddSensor(
                exu.SensorNode(
                    nodeNumber=tree,
                    outputVariableType=exudyn.OutputVariableType.Coordinates,
                    **sensor,
                )
            )
        else:
            body = _body(self._scene, self._system, self._form)
            at = {"bodyNumber": body, "localPosition": self._scene.center, **sensor}
            kinds = exudyn.OutputVariableType
            self._sensors = [
                self._system.AddSensor(exu.SensorBody(outputVariableType=kind, **at))
                for kind in (kinds.Position, kinds.RotationMatrix)
            ]
        self._system.Assemble()
        self._settings = self._make_settings(sampled)

    def _make_settings(self, sampled: bool):
        settings = exudyn.SimulationSettings()
        time, explicit = settings.timeIntegration, settings.timeIntegration.explicitIntegration
        time.endTime, time.verboseMode = self._scene.duration, 0
        if self._solver_name == "DOPRI5":
            time.automaticStepSize = True
            time.absoluteTolerance = time.relativeTolerance = self._knob
            time.numberOfSteps = 10  # the largest step is a tenth of the run
        else:
            time.automaticStepSize = False
            time.adaptiveStep = False
            time.numberOfSteps = round(self._scene.duration / self._knob)
        explicit.computeEndOfStepAccelerations = False
        explicit.useLieGroupIntegration = self._form == "LG"
        time.newton.useModifiedNewton = True
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = (
            self._scene.interval if sampled else 10.0 * self._scene.duration
        )
        settings.displayComputationTime = settings.displayStatistics = False
        return settings

    def start(self) -> None:
        self._prepare(sampled=False)

    def _prepare(self, sampled: bool) -> None:
        self._assemble(sampled)
        kind = getattr(_SOLVER, self._solver_name)
        implicit = self._solver_name in ("TrapezoidalIndex2", "GeneralizedAlpha")
        if implicit:
            self._solver = exudyn.MainSolverImplicitSecondOrder()
            alpha = self._settings.timeIntegration.generalizedAlpha
            index2 = self._solver_name == "TrapezoidalIndex2"
            alpha.useIndex2Constraints = alpha.useNewmark = index2
        else:
            self._solver = exudyn.MainSolverExplicit()
            self._settings.timeIntegration.explicitIntegration.dynamicSolverType = kind
        if not self._solver.InitializeSolver(self._system, self._settings):
            raise RuntimeError("exudyn: the solver does not start")

    def advance(self, t: float) -> None:
        if not self._solver.SolveSteps(self._system, self._settings):
            raise ArithmeticError("exudyn: the solver does not converge")

    def pose(self) -> tuple[Array, Array]:
        self._solver.FinalizeSolver(self._system, self._settings)
        if self._form == "tree":
            value = np.atleast_1d(self._system.GetSensorValues(self._sensor))
            position, quaternion = _pendulum_pose(self._scene, value[None])
        else:
            values = [np.array(self._system.GetSensorValues(one))[None] for one in self._sensors]
            position, quaternion = values[0], _quaternions(values[1])
        return position[0], quaternion[0]

    def samples(self, times: Array) -> Samples:
        self._prepare(sampled=True)
        self.advance(times[-1])
        self._solver.FinalizeSolver(self._system, self._settings)
        if self._form == "tree":
            data = self._system.GetSensorStoredData(self._sensor)
            return Samples(data[:, 0], *_pendulum_pose(self._scene, data[:, 1:]))
        position, turn = [self._system.GetSensorStoredData(one) for one in self._sensors]
        return Samples(position[:, 0], position[:, 1:], _quaternions(turn[:, 1:]))


def _quaternions(rows: Array) -> Array:
    return Rotation.from_matrix(rows.reshape(-1, 3, 3)).as_quat()


def _pendulum_pose(scene: Scene, angle: Array) -> tuple[Array, Array]:
    """Angle of the hinge from the initial attitude (n, 1) -> pose."""
    start = Rotation.from_quat(scene.quaternion)
    turn = start * Rotation.from_rotvec(angle * np.array([0.0, 1.0, 0.0]))
    return scene.origin + turn.apply(scene.center), turn.as_quat()


def _body(scene: Scene, system, form: str) -> int:
    """The rigid body with its joint; returns its object number."""
    kinds = exudyn.NodeType
    node = kinds.RotationRotationVector if form == "LG" else kinds.RotationEulerParameters
    held = scene.name == "heavy_top" and form == "LG"
    turn = rotation(scene.quaternion)
    about_origin = np.diag(scene.inertia) + _offset_inertia(scene.mass, scene.center)
    center = np.zeros(3) if held else scene.center
    inertia = exu.RigidBodyInertia(scene.mass, about_origin, com=center)
    created = system.CreateRigidBody(
        referencePosition=scene.origin,
        referenceRotationMatrix=turn,
        initialVelocity=scene.velocity,
        initialAngularVelocity=turn @ scene.spin,
        inertia=inertia,
        gravity=np.zeros(3) if held else scene.gravity,
        nodeType=node,
        returnDict=True,
    )
    body, number = created["bodyNumber"], created["nodeNumber"]
    if held:
        _hold(scene, system, body, number)
    elif scene.name == "heavy_top":
        ground = system.CreateGround()
        system.CreateSphericalJoint(bodyNumbers=[ground, body], position=scene.origin)
    elif scene.name == "pendulum":
        ground = system.CreateGround()
        system.CreateRevoluteJoint(
            bodyNumbers=[ground, body], position=scene.origin, axis=[0.0, 1.0, 0.0]
        )
    elif scene.name == "rolling_disk":
        ground = system.CreateGround()
        system.CreateRollingDisc(
            bodyNumbers=[ground, body],
            axisPosition=[0.0, 0.0, 0.0],
            axisVector=[0.0, 0.0, 1.0],
            discRadius=scene.size[0],
            planePosition=[0.0, 0.0, 0.0],
            planeNormal=[0.0, 0.0, 1.0],
        )
    return body


def _offset_inertia(mass: float, arm: Array) -> Array:
    """Inertia of a point mass at `arm` [kg m^2]."""
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def _hold(scene: Scene, system, body: int, node: int) -> None:
    """Fix the three position coordinates, and hang the weight at the centre of mass."""
    ground = system.AddMarker(
        exu.MarkerNodeCoordinate(
            nodeNumber=system.AddNode(exu.NodePointGround(referenceCoordinates=[0, 0, 0])),
            coordinate=0,
        )
    )
    for coordinate in range(3):
        marker = system.AddMarker(exu.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        system.AddObject(exu.CoordinateConstraint(markerNumbers=[ground, marker]))
    center = system.AddMarker(exu.MarkerBodyPosition(bodyNumber=body, localPosition=scene.center))
    system.AddLoad(exu.Force(markerNumber=center, loadVector=scene.mass * scene.gravity))


def _tree(scene: Scene, system) -> int:
    """The pendulum as a tree of one revolute joint; returns the number of its node.

    The world is turned so that the joint turns about z and starts at angle 0.
    """
    # columns: joint axes in the body at the start (z along the hinge, body y)
    mount = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    turn = rotation(scene.quaternion) @ mount
    center = mount.T @ scene.center
    inertia = mount.T @ np.diag(scene.inertia) @ mount
    node = system.AddNode(
        exu.NodeGenericODE2(
            numberOfODE2Coordinates=1,
            referenceCoordinates=[0.0],
            initialCoordinates=[0.0],
            initialCoordinates_t=[0.0],
        )
    )
    system.AddObject(
        exu.ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=[exudyn.JointType.RevoluteZ],
            linkParents=[-1],
            jointTransformations=exudyn.Matrix3DList([turn]),
            jointOffsets=exudyn.Vector3DList([scene.origin]),
            linkInertiasCOM=exudyn.Matrix3DList([inertia]),
            linkCOMs=exudyn.Vector3DList([center]),
            linkMasses=[scene.mass],
            gravity=scene.gravity,
            baseOffset=[0.0, 0.0, 0.0],
        )
    )
    return node
