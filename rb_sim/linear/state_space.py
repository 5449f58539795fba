# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The result: x' = A x + B f, y = C x + D f with names for every number."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import null_space, qr

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.mechanics.samples import Array


class Mode(NamedTuple):
    """One eigenvalue of A, or a complex pair."""

    real: float
    """[1/s]; motions grow where it is positive."""
    imaginary: float
    """[rad/s], not negative."""
    frequency: float
    """|eigenvalue| / 2 pi [Hz]; nan for a real eigenvalue: nothing oscillates."""
    damping: float
    """- real / |eigenvalue|; nan for the eigenvalue 0."""
    state: str
    """the state with the largest part in it."""


@dataclass(frozen=True)
class LinearModel:
    """Small deviations from a motion, in minimal coordinates on the constraint manifold.

    A state BODY/position_x is the deviation of the centre of mass, BODY/angle_x that of the
    orientation (a small rotation vector), BODY/velocity_x and BODY/spin_x the deviations of the
    linear and the angular velocity, all in the axes that were requested. Deviations that
    the constraints determine by the others are not states; they are among the outputs.
    """

    t: float
    """Instant of the motion [s]."""
    A: Array
    """Matrix of the states, shape (n, n)."""
    B: Array
    """Matrix of the inputs, shape (n, m)."""
    C: Array
    """Outputs by states, shape (p, n)."""
    D: Array
    """Outputs by inputs, shape (p, m)."""
    states: tuple[str, ...]
    """Names of the states, n."""
    inputs: tuple[str, ...]
    """Names of the commanded forces [N] and torques [N m] about the body origin, m."""
    outputs: tuple[str, ...]
    """Names of the outputs, p: pose and twist of every body, then force [N] and torque [N m] of
    every reaction (world axes)."""

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A, complex [1/s], fastest growth first; multiple zeros are exactly 0."""
        return np.array([value for value, _ in self._eigen], complex)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Eigenvalues with frequency and damping, a complex pair once, zeros one by one."""
        found = []
        for value, state in self._eigen:
            if value.imag >= 0.0:
                size, nan = abs(value), float("nan")
                frequency = size / (2.0 * np.pi) if value.imag > 0.0 else nan
                damping = -value.real / size if size > 0.0 else nan
                found.append(Mode(value.real, value.imag, frequency, damping, self.states[state]))
        return tuple(found)

    @cached_property
    def _eigen(self) -> list[tuple[complex, int]]:
        """Each eigenvalue with the state that has the largest part in its mode.

        A multiple zero (a body that moves freely along x: position and velocity) comes out of a
        solver as a pair of some 1e-8, so zeros are split off before: null space after null space.
        """
        if not self.states:
            return []
        found: list[tuple[complex, int]] = []
        basis, left = np.eye(len(self.A)), np.array(self.A, float)
        while left.size:
            zero = null_space(left, rcond=COMPUTED_ROUNDING)
            if not zero.shape[1]:
                break
            factors: Any = qr((basis @ zero).T, mode="r", pivoting=True)
            order = factors[1]
            found += [(0j, int(k)) for k in order[: zero.shape[1]]]
            rest = null_space(zero.T)
            basis, left = basis @ rest, rest.T @ left @ rest
        values: Any = np.linalg.eigvals(left) if left.size else []
        for value in map(complex, values):
            near = np.linalg.svd(self.A - value * np.eye(len(self.A)))[2][-1]
            found.append((value, int(np.argmax(np.abs(near)))))
        return sorted(found, key=lambda mode: (-mode[0].real, -mode[0].imag))

    @property
    def fastest(self) -> float:
        """Size of the largest eigenvalue [1/s]; 0 without states."""
        return float(np.max(np.abs(self.eigenvalues), initial=0.0))

    def change(self, later: LinearModel, turned: float = 0.0) -> float:
        """Largest difference between the rates of deviations here and a little later on the motion,
        relative to them, the axes having turned about z by `turned` [rad].

        If it is not 0, the motion is not steady in these axes, and eigenvalues at one instant do
        not show whether deviations grow. The choice of the states does not matter.
        """
        here, there = self._deviations(), later._deviations()
        c, s = math.cos(turned), math.sin(turned)
        turn = np.kron(np.eye(len(here) // 3), [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        chosen = [later.outputs.index(state) for state in later.states]
        moved = (turn @ here)[chosen]
        rates = turn.T @ there @ later.A @ moved
        size = float(np.max(np.abs(self.A), initial=0.0))
        off = float(np.max(np.abs(turn.T @ there @ moved - here), initial=0.0))
        change = float(np.max(np.abs(rates - here @ self.A), initial=0.0))
        return max(off, change / size) if size else 0.0

    def _deviations(self) -> Array:
        """The deviations of all bodies, shape (12 N, n), by the states."""
        kinds = [name.rsplit("/", 1)[1].split("_")[0] for name in self.outputs]
        return self.C[: sum(kind not in ("force", "torque") for kind in kinds)]

    def as_dict(self) -> dict[str, Any]:
        """A, B, C, D as lists with their names, t and the modes; None: a mode has no such value."""
        plain: dict[str, Any] = {"t": self.t}
        plain |= {name: list(getattr(self, name)) for name in ("states", "inputs", "outputs")}
        plain |= {name: getattr(self, name).tolist() for name in "ABCD"}
        modes = [mode._asdict() for mode in self.modes]
        plain["modes"] = [{k: None if v != v else v for k, v in mode.items()} for mode in modes]
        return plain

    def to_npz(self, path: str | PathLike[str]) -> None:
        """Write A, B, C, D, their names, t and the eigenvalues to a numpy archive.

        control.ss(f["A"], f["B"], f["C"], f["D"]) of python-control takes them as they are.
        """
        names: dict[str, Any] = {
            key: np.array(getattr(self, key), dtype=str) for key in ("states", "inputs", "outputs")
        }
        np.savez_compressed(
            path,
            A=self.A,
            B=self.B,
            C=self.C,
            D=self.D,
            **names,
            eigenvalues=self.eigenvalues,
            t=np.array(self.t),
        )
