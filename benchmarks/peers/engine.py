# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What an engine adapter provides: `engine_NAME.py` with PACKAGE, KIND, ways() and build().

    PACKAGE   name of the distribution on the package index, for its version
    KIND      "engine" (takes a model), "equations" (integrates equations written by hand), "rb_sim"
    ways(scene) -> list[Way]            methods and their ladders, coarse to fine
    build(scene, method, knob) -> Run   ready to run; nothing here is timed

Importing the module imports the engine; an ImportError skips it by name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from benchmarks.peers.scenes import Array, Scene

ENGINES = (
    "rb_sim",
    "mujoco",
    "drake",
    "exudyn",
    "pybullet",
    "dartpy",
    "pinocchio",
    "scipy",
    "heyoka",
)


class Way(NamedTuple):
    """A method and its ladder."""

    method: str
    knobs: tuple[float, ...]
    """steps [s] or tolerances, coarse to fine."""


class Samples(NamedTuple):
    """Poses along a run: time [s] (n,), centre of mass [m] (n, 3), [x, y, z, w] (n, 4)."""

    t: Array
    position: Array
    quaternion: Array


class Run(ABC):
    """One engine on one scene by one way."""

    @abstractmethod
    def start(self) -> None:
        """Go to the initial state; not timed."""

    @abstractmethod
    def advance(self, t: float) -> None:
        """Integrate from the present time to `t` [s]; timed when it goes to the end."""

    @abstractmethod
    def pose(self) -> tuple[Array, Array]:
        """Present centre of mass [m] (3,) and quaternion [x, y, z, w] (4,), world."""

    def samples(self, times: Array) -> Samples:
        """The run with samples, from the start; by default at `times`, in pieces."""
        self.start()
        poses = [self.pose()]
        for t in times[1:]:
            self.advance(float(t))
            poses.append(self.pose())
        positions, quaternions = zip(*poses, strict=True)
        return Samples(times, np.array(positions), np.array(quaternions))


STEPS = (0.1, 0.05, 0.02, 0.01, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5)


def steps(scene: Scene, largest: float = 0.1, smallest: float = 1e-5) -> tuple[float, ...]:
    """The steps of STEPS that divide the scene's sample interval, within the bounds [s]."""
    ladder = [h for h in STEPS if smallest <= h <= largest]
    return tuple(h for h in ladder if abs(scene.interval / h - round(scene.interval / h)) < 1e-9)


def tolerances(first: int, last: int) -> tuple[float, ...]:
    """10**-first ... 10**-last."""
    return tuple(10.0**-n for n in range(first, last + 1))
