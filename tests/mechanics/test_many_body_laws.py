# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The laws of many bodies at any state beside one dense solve: traced, over tables.

M du/dt = f + G^T lambda and G du/dt = -bias as one system of equations (LL 38.2) that numpy
solves; the lines and the wrenches are those of the catalogue, which tests of their own compare
with differences. Nothing is run, so that a comparison costs milliseconds.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from tests.interpreted import interpreted
from tests.mechanics.trees import SCENES
from tests.moving import floats
from tests.numbers import outputs

INSTANT = 0.3


class Dense(NamedTuple):
    """Newton's and Euler's equations of a system at one state, as matrices."""

    mass: np.ndarray
    """(6 N, 6 N); velocities in world axes, spins in axes of the body."""
    rows: np.ndarray
    """G, (n, 6 N)."""
    bias: np.ndarray
    error: np.ndarray
    rate: np.ndarray
    holonomic: np.ndarray
    load: np.ndarray
    """f, (6 N,)."""


def velocities_of(y: np.ndarray) -> np.ndarray:
    return y.reshape(-1, 13)[:, 7:].ravel()


def states_of(y: np.ndarray) -> list[Any]:
    from rb_sim.catalogue.spec import BodyState

    parts = ([floats(one[a:b]) for a, b in ((0, 3), (3, 7), (7, 10), (10, 13))] for one in y)
    return [BodyState(*own) for own in parts]


def lines_of(system: Any, states: list[Any]) -> np.ndarray:
    """The 16 columns of all lines, J spread over the bodies in front of the other four."""
    from rb_sim.catalogue.constraints import rows

    found = []
    for placed in system.constraints:
        own = np.zeros((rows.COUNT[type(placed.row)], rows.ROW_WIDTH))
        rows.fill(placed.row, INSTANT, *pair_of(placed, states), own, 0)
        wide = np.zeros((len(own), 6 * len(states)))
        wide[:, 6 * placed.body : 6 * placed.body + 6] += own[:, :6]
        if placed.parent >= 0:
            wide[:, 6 * placed.parent : 6 * placed.parent + 6] += own[:, 6:12]
        rest = own[:, [rows.BIAS, rows.ERROR, rows.RATE, rows.HOLONOMIC]]
        found.append(np.hstack([wide, rest]))
    return np.vstack([np.zeros((0, 6 * len(states) + 4)), *found])


def pair_of(placed: Any, states: list[Any]) -> tuple[Any, Any]:
    """The states of body and parent."""
    from rb_sim.catalogue.spec import WORLD

    return states[placed.body], WORLD if placed.parent < 0 else states[placed.parent]


def inertial(system: Any, body: int) -> Any:
    from rb_sim.catalogue.spec import Inertial

    own = system.bodies[body]
    return Inertial(float(own[0]), floats(own[1:7]), (0.0, 0.0, 0.0))


def load_of(placed: Any, system: Any, states: list[Any]) -> np.ndarray:
    """The wrench of one effect on its body and the opposite on its parent, (N, 6)."""
    from rb_sim.catalogue.spec import wrench

    (B, A), load = pair_of(placed, states), np.zeros((len(states), 6))
    f, k = wrench(placed.row, INSTANT, inertial(system, placed.body), B, A)
    load[placed.body] += [*f, *k]
    if placed.parent >= 0:
        moment = Rotation.from_quat(B.q_WB).apply(k)
        moment = moment + np.cross(np.array(B.p_WC) - A.p_WC, f)
        load[placed.parent] -= [*f, *Rotation.from_quat(A.q_WB).inv().apply(moment)]
    return load


def dense(system: Any, y: np.ndarray) -> Dense:
    states, blocks, gyroscopic = states_of(y.reshape(-1, 13)), [], []
    for own, state in zip(system.bodies, states, strict=True):
        xx, yy, zz, xy, xz, yz = own[1:7]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        blocks += [own[0] * np.eye(3), inertia]
        gyroscopic.append([0.0, 0.0, 0.0, *np.cross(state.w_WB_B, inertia @ state.w_WB_B)])
    load = -np.array(gyroscopic)
    for placed in system.effects:
        load += load_of(placed, system, states)
    table, wide = lines_of(system, states), 6 * len(states)
    return Dense(block_diag(*blocks), table[:, :wide], *table[:, wide:].T, load=load.ravel())


def solution(of: Dense, right: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(u, lambda) of M u = load + G^T lambda, G u = right; lambda of least norm."""
    weights = np.linalg.inv(of.mass)
    free = weights @ load
    A = of.rows @ weights @ of.rows.T
    multipliers = np.linalg.pinv(A, rcond=1e-10, hermitian=True) @ (right - of.rows @ free)
    return free + weights @ of.rows.T @ multipliers, multipliers


def any_state(system: Any, start: np.ndarray, seed: int, near: bool) -> np.ndarray:
    """A state on the manifold, near the start or anywhere, with random velocities."""
    from tests.numbers import projected

    rng, y = np.random.default_rng(seed), start.copy().reshape(-1, 13)
    y[:, 7:] = rng.normal(size=(len(y), 6))
    if not near:
        y[:, :3] += 0.05 * rng.normal(size=(len(y), 3))
        turns = Rotation.from_rotvec(0.1 * rng.normal(size=(len(y), 3)))
        y[:, 3:7] = (turns * Rotation.from_quat(y[:, 3:7])).as_quat()
    return projected(system, INSTANT, y.ravel())


def compiled_state(name: str, seed: int) -> tuple[Any, np.ndarray]:
    from rb_sim import load_scene
    from rb_sim.scene.compile import compile_scene

    made = compile_scene(load_scene(SCENES[name]()), coordinates="maximal")
    return made, any_state(made.system, made.y, seed, near=name in ("loop", "cranks", "double"))


def reactions(system: Any, of: Dense, states: list[Any]) -> list[np.ndarray]:
    """[force, torque about the anchor, anchor] of each output, world axes."""
    from rb_sim.catalogue.constraints.rows import anchor

    _, multipliers = solution(of, -of.bias, of.load)
    out = []
    for main, *counted in system.members:
        placed = system.constraints[main]
        B, A = pair_of(placed, states)
        point, own = np.array(anchor(placed.row, B, A)), np.zeros(6)
        for part in np.flatnonzero(counted):
            k = slice(system.first_row[part], system.first_row[part + 1])
            own += multipliers[k] @ of.rows[k, 6 * placed.body : 6 * placed.body + 6]
        torque = Rotation.from_quat(B.q_WB).apply(own[3:])
        out.append(np.concatenate([own[:3], torque + np.cross(B.p_WC - point, own[:3]), point]))
    return out


def reported(system: Any, y: np.ndarray, of: Dense) -> np.ndarray:
    """The sample by the dense equations, but for its residual."""
    from rb_sim.catalogue.spec import potential

    states, u = states_of(y.reshape(-1, 13)), velocities_of(y)
    energy, power = 0.0, float(solution(of, -of.bias, of.load)[1] @ of.rate)
    for placed in system.effects:
        if type(placed.row) in potential.kernels:
            body, pair = inertial(system, placed.body), pair_of(placed, states)
            energy += potential(placed.row, INSTANT, body, *pair)
        else:
            power += float(load_of(placed, system, states).ravel() @ u)
    momentum = (of.mass @ u).reshape(-1, 6)
    angular = np.zeros(3)
    for B, own in zip(states, momentum, strict=True):
        angular += np.cross(B.p_WC, own[:3]) + Rotation.from_quat(B.q_WB).apply(own[3:])
    balance = [0.5 * u @ of.mass @ u, energy, power, *momentum[:, :3].sum(axis=0), *angular]
    return np.concatenate([y, *reactions(system, of, states), balance])


def shown(name: str, seed: int) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """(what, expected, found): accelerations and samples, traced and over tables."""
    from rb_sim.mechanics.initial_projection import changing_in
    from rb_sim.mechanics.multibody_laws import MultiBodyLaws
    from rb_sim.mechanics.samples import row_width
    from rb_sim.mechanics.table_laws import TableLaws

    made, y = compiled_state(name, seed)
    system, width, n = made.system, row_width(made.layout), len(y)
    of = dense(system, y)
    expected, _ = solution(of, -of.bias, of.load)
    rows = reported(system, y, of)
    found: list[tuple[str, np.ndarray, np.ndarray]] = []
    changing = changing_in(system, made.dependent)
    for kind, some in ((MultiBodyLaws, []), (MultiBodyLaws, changing), (TableLaws, [])):
        law = kind(system, width, made.redundant, (), made.dependent, some)
        p = np.array([*law.inputs.values(system, INSTANT), 0.0])
        what = f"{kind.__name__}{' that chooses' if some else ''}"
        dy = outputs(law.rate, INSTANT, y, p, n)
        found.append((f"{what}, rate", expected, velocities_of(dy)))
        out = outputs(law.sample, INSTANT, y, p, width)
        found.append((f"{what}, sample", rows, out[:-1]))
        found.append((f"{what}, residual", np.zeros(1), out[-1:]))
    return found


@pytest.mark.parametrize("name", SCENES)
def test_accelerations_and_samples_are_those_of_one_dense_solve(name: str) -> None:
    """Reactions, of least norm where lines depend on others; energies, power and momenta."""
    for what, expected, found in interpreted(shown, name, 1):
        size = 1.0 + float(np.abs(expected).max())
        assert_allclose(found, expected, rtol=0.0, atol=1e-10 * size, err_msg=what)


def slips(name: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Velocities after the way back to the manifold: as it finds them, as one dense solve does."""
    from tests.numbers import projected

    made, y = compiled_state(name, seed)
    y.reshape(-1, 13)[:, 7:] += np.random.default_rng(seed).normal(size=(len(y) // 13, 6))
    of = dense(made.system, y)
    expected, _ = solution(of, of.rate, of.mass @ velocities_of(y))
    return expected, velocities_of(projected(made.system, INSTANT, y))


@pytest.mark.parametrize("name", SCENES)
def test_projected_velocities_are_the_nearest_in_the_metric_of_m(name: str) -> None:
    expected, found = interpreted(slips, name, 3)
    assert_allclose(found, expected, rtol=0.0, atol=1e-10)
