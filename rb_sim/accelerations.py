"""Accelerations of the bodies at the samples of a trajectory, by Newton's and Euler's equations.

    m a_C = F        I dw/dt + w x I w = K        (about the centre of mass C, body axes)

F and K are the wrenches of the effects, evaluated at the samples, and the recorded reactions: an
integration knows nothing of them, so they cost only who asks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.effect_wrenches import wrenches_by_body
from rb_sim.errors import RbSimError
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene
from rb_sim.sinks.frames import conjugate, cross, rotate

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout
    from rb_sim.trajectory import Trajectory
    from rb_sim.wrenches import Reaction


class Accelerations(NamedTuple):
    """Of all bodies, in the order of the layout."""

    linear: Array
    """of the centre of mass, world axes [m/s^2], shape (n, N, 3)."""
    angular: Array
    """dw/dt, body axes [rad/s^2], shape (n, N, 3)."""


def accelerations(trajectory: Trajectory) -> Accelerations:
    """The accelerations at every sample; at an impact without its jump.

    Raises RbSimError where the scene is not known, and for time_stepping, whose reactions are means
    over a step.
    """
    scene = trajectory.scene
    if not isinstance(scene, Scene):
        raise RbSimError("accelerations: the scene of these samples is not known")
    if scene.simulation.method == "time_stepping":
        raise RbSimError(
            "accelerations: method time_stepping has reactions that are means over its steps; "
            "must be another method"
        )
    block, bodies = trajectory.block, trajectory.layout.bodies
    force, torque = np.zeros_like(block.position), np.zeros_like(block.position)
    for body, wrench in _wrenches(trajectory, scene):
        i = bodies.index(body)
        lever = wrench.anchor - block.position[:, i]
        force[:, i] += wrench.force
        torque[:, i] += wrench.torque + cross(lever, wrench.force)
    mass = np.array([scene.bodies[name].mass for name in bodies])
    inertia = np.array([scene.bodies[name].inertia for name in bodies])
    spin = block.angular_velocity
    moment = rotate(conjugate(block.orientation), torque)
    moment -= cross(spin, np.einsum("bij,nbj->nbi", inertia, spin))
    angular = np.linalg.solve(inertia, moment[..., None])[..., 0]
    return Accelerations(force / mass[:, None], np.asarray(angular, dtype=float))


def accelerating(scene: Scene, layout: SampleLayout) -> Callable[[SampleBlock], Accelerations]:
    """What gives the accelerations of blocks of a run. Raises RbSimError as `accelerations`."""
    from rb_sim.engine.samples import empty_block
    from rb_sim.trajectory import Trajectory

    def of(block: SampleBlock) -> Accelerations:
        return accelerations(Trajectory(block, layout, scene))

    of(empty_block(0, layout))  # refuses what it cannot do, before the run
    return of


def _wrenches(trajectory: Trajectory, scene: Scene) -> Iterator[tuple[str, Reaction]]:
    """(body, a wrench ON it) of all effects and constraints, those on parents included."""
    for by_body in wrenches_by_body(trajectory).values():
        yield from by_body.items()
    place = InitialPlace(scene)
    reactions = trajectory.reaction
    joints: dict[str, Any] = dict(scene.constraints)
    for name, spec in joints.items():
        suffixes = spec.reaction_suffixes(place)
        for suffix in ("",) if "" in suffixes else suffixes:  # the total has all others in it
            wrench = reactions[f"{name}/{suffix}" if suffix else name]
            yield spec.body, wrench
            if getattr(spec, "parent", None) is not None:
                yield spec.parent, wrench._replace(force=-wrench.force, torque=-wrench.torque)
