"""The Jacobian of the residuals from the derivatives that the motion carries along."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rb_sim.bags.alignment import turn_between
from rb_sim.bags.tracks import tracks_of_blocks
from rb_sim.engine.samples import SampleBlock, concatenate
from rb_sim.fit.recording import Recording, followed
from rb_sim.scene.schema import Scene
from rb_sim.sensitivity import STEP, NotSmoothError, TangentSimulation

SMALL = 0.03
"""Size of a number, of its scale, below which the scenes beside do not come nearer: a number may
begin at 0."""


def raw_jacobian(
    recording: Recording, scene_at: Callable[[np.ndarray], Scene], x: np.ndarray
) -> np.ndarray:
    """d (position, turn) of each pose in turn / d x, shape (6 poses, len(x)) [m, rad].

    Raises NotSmoothError where the motion has no derivatives, SimulationError as a run does.
    """
    sizes = np.clip(np.abs(x), SMALL, 1.0)
    simulation = TangentSimulation(scene_at, x, sizes.tolist())
    made: list[SampleBlock] = []
    parts: list[list[SampleBlock]] = []
    for block in followed(simulation, recording):
        made.append(block)
        parts.append(simulation.take_derivatives(len(block)))
    layout, scene = simulation.layout, simulation.scene
    whole = concatenate(made, layout)
    changes = [concatenate(blocks, layout) for blocks in zip(*parts, strict=True)]
    tracks = tracks_of_blocks([whole], scene, layout, scene.name)
    columns = [np.zeros(0)] * len(x)
    for body, name in recording.pairs.items():
        i, seen = layout.bodies.index(body), recording.tracks.bodies[name]
        if len(tracks.bodies[body].t) != len(whole):
            raise NotSmoothError("sensitivities: the recording was set back in between")
        at = recording.samples(body, len(whole))
        n, q = len(at), whole.orientation[at, i]
        r = np.array(scene.bodies[body].center_of_mass)
        for k, change in enumerate(changes):
            dq, h = change.orientation[at, i], STEP * float(sizes[k])
            dr = _center_change(scene_at, x, k, h, body)
            part = np.zeros((len(seen.t), 6))
            part[:n, :3] = change.position[at, i] - rotation_change(q, dq, r) - rotated(q, dr)
            part[:n, 3:] = _turn_change(seen.orientation[:n], q, dq)
            columns[k] = np.append(columns[k], part.ravel())
    return np.stack(columns, axis=1)


def _center_change(
    scene_at: Callable[[np.ndarray], Scene], x: np.ndarray, k: int, h: float, body: str
) -> np.ndarray:
    """d r_OC / d x_k; r_OC is a number of the scene itself, so that the difference is exact."""
    ends = []
    for side in (-h, h):
        moved = x.copy()
        moved[k] += side
        ends.append(np.array(scene_at(moved).bodies[body].center_of_mass))
    return (ends[1] - ends[0]) / (2.0 * h)


def _turn_change(p: np.ndarray, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """The change of turn_between(p, q), which is linear in q but for the sign of both."""
    sign = np.where(np.sum(p * q, axis=1) < 0, -1.0, 1.0)[:, None]
    same = np.where(np.sum(p * dq, axis=1) < 0, -1.0, 1.0)[:, None]
    return sign * same * turn_between(p, dq)


def rotated(q: np.ndarray, a: np.ndarray) -> np.ndarray:
    """R(q) a for unit quaternions (n, 4) and one vector, (n, 3)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, a)
    return a + w * t + np.cross(u, t)


def rotation_change(q: np.ndarray, dq: np.ndarray, a: np.ndarray) -> np.ndarray:
    """d (R(q) a) for the change dq."""
    u, w, du, dw = q[:, :3], q[:, 3:], dq[:, :3], dq[:, 3:]
    t, dt = 2.0 * np.cross(u, a), 2.0 * np.cross(du, a)
    return dw * t + w * dt + np.cross(du, t) + np.cross(u, dt)
