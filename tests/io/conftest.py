# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A scene with every kind of topic, and samples of a made-up but smooth motion in it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.mechanics.samples import SampleBlock, SampleLayout
from rb_sim.scene.load import load_scene
from rb_sim.scene.schema import Scene

Samples = Callable[..., SampleBlock]
Recorder = Callable[..., Path]

SCENE = """\
description: a ball that rolls, a door on two bearings
bodies:
  ball:
    mass: 2.0
    shape: {type: sphere, radius: 0.1}
    position: [0, 0, 0.1]
  door:
    mass: 3.0
    shape: {type: box, size: [0.6, 0.04, 1.0], center_B: [0.3, 0, 0.5]}
    center_of_mass: [0.3, 0, 0.5]
    position: [0.5, 0.5, 0]
constraints:
  floor: {type: rolling, body: ball, normal_A: [0, 0, 1], point_A: [0, 0, 0]}
  hinge: {type: fixed_axis, body: door, axis_B: [0, 0, 1], point_A: [0.5, 0.5, 0]}
effects:
  weight: {type: gravity}
  drive: {type: commanded_wrench, body: ball}
simulation: {duration: 2, rate: 100, method: rk4, step: 1.0e-3}
"""

LAYOUT = SampleLayout(
    bodies=("ball", "door"),
    reactions=("floor", "hinge", "hinge/A", "hinge/B"),
    reaction_bodies=("ball", "door", "door", "door"),
    commanded=("ball",),
)

START = 1_700_000_000_000_000_000
"""[ns]; a fixed start makes bags comparable."""


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """The scene, loaded from a file called workshop.yaml."""
    path = tmp_path / "workshop.yaml"
    path.write_text(SCENE)
    return load_scene(path)


@pytest.fixture
def layout() -> SampleLayout:
    """What a simulation of the scene would report."""
    return LAYOUT


@pytest.fixture
def samples(scene: Scene) -> Samples:
    """samples(n=200, start=0.0, rate=100.0): n samples from `start` [s]."""
    return partial(_samples, scene)


@pytest.fixture
def record(tmp_path: Path, scene: Scene, layout: SampleLayout, samples: Samples) -> Recorder:
    """record(name="bag", n=200, ...): path of a finished bag with n samples in blocks of 64."""

    def run(name: str = "bag", n: int = 200, summary: dict | None = None, **options) -> Path:
        sink = BagSink(tmp_path / name, **{"start_ns": START, **options})
        sink.open(scene, layout)
        for first in range(0, n, 64):
            sink.write(samples(min(64, n - first), start=first / 100.0))
        sink.close(summary)
        return sink.directory

    return run


def _samples(scene: Scene, n: int = 200, start: float = 0.0, rate: float = 100.0) -> SampleBlock:
    """A function of time alone, so that blocks join smoothly."""
    t = (round(start * rate) + np.arange(n)) / rate
    wave = np.sin(np.multiply.outer(t, np.linspace(0.5, 2.0, 12))) + 0.1
    position = np.stack([np.c_[t, 0.3 * wave[:, 0], 0.1 + 0 * t], wave[:, 1:4]], axis=1)
    q = np.stack([wave[:, 4:8], wave[:, 8:12]], axis=1)
    q /= np.linalg.norm(q, axis=2, keepdims=True)
    v, w = np.stack([wave[:, :3], wave[:, 3:6]], axis=1), np.stack([wave[:, 5:8]] * 2, axis=1)
    momentum, angular = _momenta(scene, position, v, q, w)
    force = np.stack([10.0 * wave[:, k : k + 3] for k in range(4)], axis=1)
    return SampleBlock(
        t=t,
        position=position,
        orientation=q,
        linear_velocity=v,
        angular_velocity=w,
        reaction_force=force,
        reaction_torque=0.1 * force[:, ::-1],
        anchor=np.stack([position[:, 0] * [1, 1, 0]] + [np.full((n, 3), 0.5)] * 3, axis=1),
        command=wave[:, None, :6],
        kinetic_energy=1.0 + wave[:, 0] ** 2,
        potential_energy=19.62 * wave[:, 3],
        power=wave[:, 2],
        momentum=momentum,
        angular_momentum=angular,
        residual=1e-15 * (1 + wave[:, 4] ** 2),
        contact_work=np.zeros(n),
        contact_state=np.zeros((n, 0)),
    )


def _momenta(scene, p, v, q, w):
    """One by one, with matrices of scipy: another way than the package's."""
    from scipy.spatial.transform import Rotation

    linear, angular = np.zeros((len(p), 3)), np.zeros((len(p), 3))
    for i, body in enumerate(scene.bodies.values()):
        R = Rotation.from_quat(q[:, i]).as_matrix()
        linear += body.mass * v[:, i]
        angular += np.cross(p[:, i], body.mass * v[:, i])
        angular += np.einsum("nij,jk,nk->ni", R, body.inertia, w[:, i])
    return linear, angular
