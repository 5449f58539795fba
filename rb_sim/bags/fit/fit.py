# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Least-squares fit of parameters and initial state to a recording.

    minimise  sum |p_sim - p|^2 / s_p^2 + |turn(q, q_sim)|^2 / s_q^2

over the free numbers, with the poses of the bodies' origins at the recorded instants. If the noise
s_p [m], s_q [rad] is not given, it is estimated from the residuals of a first fit. With the
Jacobian J of the weighted residuals r at the solution, the covariance is (J^T J)^-1 |r|^2 / (n -
p), and its diagonal gives the standard errors (Bard, Nonlinear Parameter Estimation, 1974, ch. 7).
J is exact if the motion is smooth (rb_sim.simulation.sensitivity), else it comes from central
differences, or one-sided ones if the scene is invalid on one side. Numbers that end at such a limit
are reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from rb_sim.bags.analysis.derivatives import NORMAL
from rb_sim.bags.compare import unit_note
from rb_sim.bags.fit.recording import Recording, followed, lost_by
from rb_sim.bags.fit.unknowns import (
    Fitted,
    Free,
    Limits,
    body_of,
    bounds,
    differenced,
    differences,
    free_numbers,
    moving,
    negligible,
    poorly_determined,
    slopes_of,
    start_of,
    values_of,
    with_holding_rows,
    with_numbers,
)
from rb_sim.bags.tracks import Tracks, tracks_of_blocks
from rb_sim.base.errors import RbSimError, SceneError, SimulationError
from rb_sim.base.names import first_few
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.mechanics.samples import SampleBlock, concatenate
from rb_sim.numerics.rotations import (
    angle_between,
    conjugate,
    cross,
    product,
    rotate,
    turn_between,
)
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.schema import Scene, SimulationOptions
from rb_sim.simulation.sensitivity import STEP, NotSmoothError, TangentSimulation
from rb_sim.simulation.simulation import Simulation

# Test whether the residuals are noise, i.e. uncorrelated in time.
#
#     rho = sum r_k r_k+1 / sum r_k^2
#
# is about 0 for noise, with a standard deviation of 1 / sqrt(n), and near 1 for a wrong model or a
# wrong minimum (Durbin and Watson, Biometrika 37, 1950).


FEW = 16
"""Minimum number of samples for this test."""
SYSTEMATIC = 0.5
"""Correlation of neighbours above which residuals are not noise."""
ROUNDING = 1e-7
"""Residuals below this, relative to the largest displacement, are rounding."""


def correlation(columns: Iterable[np.ndarray]) -> float:
    """Lag-1 correlation of the residuals, columns of shape (n, 3) each; 0 for too few samples."""
    products = squares = 0.0
    for r in columns:
        if len(r) >= FEW:
            products += float(np.sum(r[1:] * r[:-1]))
            squares += float(np.sum(r * r))
    return products / squares if squares > 0.0 else 0.0


# Uncertainty of a fit: standard errors, correlations, undetermined combinations.
#
#     cov = D (J^T J)^-1 D^T s^2
#
# with J the Jacobian by the search variables, D the derivatives of the free numbers by these, and
# s^2 the variance of the weighted residuals (Bard, Nonlinear Parameter Estimation, 1974, ch. 7).


SHARE = 0.1
"""Relative component above which a number belongs to an undetermined combination."""


class Spread(NamedTuple):
    """Uncertainty of the fitted numbers."""

    errors: np.ndarray
    """standard errors, infinite for undetermined numbers."""
    correlation: np.ndarray
    undetermined: list[list[int]]
    """indices of the numbers in each undetermined combination."""


def spread_of(
    J: np.ndarray, least: float, variance: float, slopes: np.ndarray, scales: np.ndarray
) -> Spread:
    """Uncertainty from the Jacobian J, variance of the residuals, and slopes D.

    least: singular value of J, relative to the largest, at or below which a combination is
    undetermined."""
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    weak = poorly_determined(s, least)
    inverse = np.where(weak, 0.0, 1.0 / np.where(weak, 1.0, s) ** 2)
    covariance = slopes @ ((Vt.T * inverse) @ Vt * variance) @ slopes.T
    errors = np.sqrt(np.diag(covariance))
    correlation = covariance / np.maximum(np.outer(errors, errors), 1e-300)
    undetermined = []
    for row in Vt[weak]:
        way = np.abs(slopes @ row) / scales
        moved = np.flatnonzero(way > SHARE * way.max())
        errors[moved] = np.inf
        undetermined.append(moved.tolist())
    return Spread(errors, correlation, undetermined)


def noisy(r: np.ndarray, is_angle: np.ndarray) -> int:
    """Number of residuals with noise. Attitudes recorded as the identity have none, and would make
    the variance too small."""
    kinds = [is_angle == k for k in (False, True)]
    return sum(int(kind.sum()) for kind in kinds if np.mean(r[kind] ** 2) > WRITTEN_ROUNDING)


# Outliers: poses far from the fitted motion, which distort the fit.
#
# One pose a hundred times as far off weighs as much as ten thousand others. The scale of the noise
# is taken from the median of the residuals, which is robust (Huber, Robust Statistics, 1981).


FAR = 10.0
"""Standard deviations of the noise beyond which a pose is an outlier."""
MOST = 0.1
"""Largest fraction of outliers; more of them mean a different motion."""

Residuals = Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


def outliers(residuals: Residuals, rounding: float) -> tuple[str, ...]:
    """A line for each body with outliers. residuals: as in `Fitted`; rounding: smaller residuals do
    not count [m, rad]."""
    lines = []
    for body, (t, *parts) in residuals.items():
        far = np.zeros(len(t), bool)
        for part in parts:
            size = np.abs(part)
            sigma = np.median(size, axis=0) / NORMAL
            far |= (size > np.maximum(FAR * sigma, rounding)).any(axis=1)
        if far.any() and far.sum() <= MOST * len(t):
            at = first_few([f"{x:.6g}" for x in t[far]])
            lines.append(
                f"{body}: {far.sum()} of {len(t)} poses are off by more than {FAR:g} times the "
                f"noise of the others (t = {at} s): they distort the fit and enlarge its errors"
            )
    return tuple(lines)


# Exact Jacobian of the residuals by integrated sensitivities.


SMALL = 0.03
"""Smallest value, relative to its scale, for which the difference step shrinks with the value: a
number may start at 0."""


def raw_jacobian(
    recording: Recording,
    scene_at: Callable[[np.ndarray], Scene],
    x: np.ndarray,
    like: TangentSimulation | None = None,
) -> tuple[np.ndarray, TangentSimulation]:
    """d (position, rotation) of each pose in turn / d x, shape (6 poses, len(x)) [m, rad], and the
    run that gave it; `like`: that of another x.

    Raises NotSmoothError if the motion has no derivatives, SimulationError as a run does.
    """
    sizes = np.clip(np.abs(x), SMALL, 1.0)
    simulation = TangentSimulation(scene_at, x, sizes.tolist(), like)
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
            part[:n, :3] = change.position[at, i] - rotation_change(q, dq, r) - rotate(q, dr)
            part[:n, 3:] = _turn_change(seen.orientation[:n], q, dq)
            columns[k] = np.append(columns[k], part.ravel())
    return np.stack(columns, axis=1), simulation


def _center_change(
    scene_at: Callable[[np.ndarray], Scene], x: np.ndarray, k: int, h: float, body: str
) -> np.ndarray:
    """d r_OC / d x_k. r_OC is linear in the scene's numbers, so the difference is exact."""
    ends = []
    for side in (-h, h):
        moved = x.copy()
        moved[k] += side
        ends.append(np.array(scene_at(moved).bodies[body].center_of_mass))
    return (ends[1] - ends[0]) / (2.0 * h)


def _turn_change(p: np.ndarray, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Change of turn_between(p, q), which is linear in q except for its sign."""
    sign = np.where(np.sum(p * q, axis=1) < 0, -2.0, 2.0)[:, None]
    return sign * product(conjugate(p), dq)[:, :3]


def rotation_change(q: np.ndarray, dq: np.ndarray, a: np.ndarray) -> np.ndarray:
    """d (R(q) a) for a change dq of unit quaternions (n, 4) and one vector a, (n, 3)."""
    u, w, du, dw = q[:, :3], q[:, 3:], dq[:, :3], dq[:, 3:]
    t, dt = 2.0 * cross(u, a), 2.0 * cross(du, a)
    return dw * t + w * dt + cross(du, t) + cross(u, dt)


MOST_RUNS = 200
"""Maximum number of residual evaluations of a search, without those for J."""
PARTS = (0.05, 0.1, 0.2, 0.35, 0.6)
"""Fractions of the recording that are fitted one after the other if a fit to all of it fails."""
CORNERS = 8
"""Maximum number of restarts of a search along limits that stopped it."""
WORTH = 1e-6
"""Minimum relative decrease of the sum of squares for another restart."""
ENOUGH = 4
"""Minimum number of residuals per free number."""
HOPELESS = 1e6
"""Weighted residual assigned to a trial that cannot be simulated, so that the search turns back."""


def fit(
    recording: Recording,
    scene: Scene,
    data: Mapping[str, Any],
    keys: Sequence[str],
    noise: tuple[float, float] | None = None,
) -> Fitted:
    """Fit the numbers `keys` of the scene. data: its mapping; noise: (m, rad) or None.

    None: the noise is estimated. Raises RbSimError for invalid keys, SimulationError if the scene
    cannot be simulated at the start.
    """
    problem = _Problem(recording, scene, data, free_numbers(data, keys))
    x = start_of(problem.free)
    r = problem.raw(x)
    if not np.isfinite(r).all():
        raise SimulationError(f"the scene cannot be simulated as it starts: {problem.trouble}")
    problem.check_units(r)
    if noise is not None:
        problem.weigh(*noise)
    found = problem.solve(x)
    if problem.systematic(found.x):
        other = problem.solve(problem.grown(x))
        found = _better(found, other)
    if noise is None:
        problem.weigh(*problem.left(problem.raw(found.x)))
        found = problem.solve(found.x)
    return problem.result(found, given=noise is not None)


class _Problem:
    """The residuals as a function of the search variables (numbers relative to their scales)."""

    def __init__(
        self, recording: Recording, scene: Scene, data: Mapping[str, Any], free: list[Free]
    ) -> None:
        self.recording, self.scene, self.data, self.free = recording, scene, data, free
        self.limits = Limits(*bounds(free, data))
        self.attitudes = {n.key: scene.bodies[body_of(n.key)].orientation for n in free if n.turn}
        self.runs = 0
        self._options = scene.simulation
        self.smooth = True
        """False once exact derivatives were not available."""
        self._like: TangentSimulation | None = None
        """the last run with derivatives, whose laws serve the next one."""
        self.trouble = ""
        self.refused = 0
        """number of trials that could not be simulated."""
        size = sum(len(recording.tracks.bodies[b].t) for b in recording.pairs.values())
        if 6 * size <= len(free):
            raise RbSimError(f"{size} poses do not determine {len(free)} numbers")
        self._is_angle = np.tile(np.repeat([False, True], 3), size)
        self._sigma = np.ones(6 * size)
        times = [recording.tracks.bodies[b].t for b in recording.pairs.values()]
        self._time = np.repeat(np.concatenate(times), 6)
        self._follow = np.ones(6 * size, bool)
        """mask of the residuals in use."""

    def check_units(self, r: np.ndarray) -> None:
        """Raise RbSimError if recorded positions are a scaled copy of those at the start values, so
        in cm or mm: a search would change the parameters until the size fits. r: as `raw`."""
        for body, (_, off, _) in self._by_body(r).items():
            seen = self.recording.tracks.bodies[self.recording.pairs[body]].position
            if line := unit_note(seen + off, seen, ("the scene", "the recording")):
                raise RbSimError(f"{self.recording.tracks.name}: {body}: {line}")

    def weigh(self, position: float, angle: float) -> None:
        """Set the noise of position [m] and attitude [rad]."""
        self._sigma = np.where(self._is_angle, angle, position)

    def left(self, r: np.ndarray) -> tuple[float, float]:
        """RMS residuals of position [m] and attitude [rad], both > 0."""
        rms = [float(np.sqrt(np.mean(r[self._is_angle == k] ** 2))) for k in (False, True)]
        floor = max(*rms, 1e-15) * 1e-6
        return max(rms[0], floor), max(rms[1], floor)

    def raw(self, x: np.ndarray) -> np.ndarray:
        """Residuals [m, rad], (position, rotation) of each pose; NaN if the simulation fails."""
        self.runs += 1
        try:
            tracks = self._simulate(x)
        except (SceneError, SimulationError) as error:
            self.trouble = str(error)
            return np.full(len(self._sigma), np.nan)
        parts = []
        for body, name in self.recording.pairs.items():
            seen, own = self.recording.tracks.bodies[name], tracks.bodies[body]
            at = self.recording.samples(body, len(own.t))
            n = len(at)
            part = np.zeros((len(seen.t), 6))
            part[:n, :3] = own.position[at] - seen.position[:n]
            part[:n, 3:] = turn_between(seen.orientation[:n], own.orientation[at])
            parts.append(part.ravel())
        return np.concatenate(parts)

    def weighted(self, x: np.ndarray) -> np.ndarray:
        r = (self.raw(x) / self._sigma)[self._follow]
        if np.isfinite(r).all():
            return r
        self.refused += 1
        return np.full(len(r), HOPELESS)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        if self.smooth:
            try:
                self.runs += 1
                found, self._like = raw_jacobian(self.recording, self.scene_at, x, self._like)
                return self._usable_rows(found)
            except (NotSmoothError, SimulationError):
                self.smooth, self._options = False, differenced(self._options)
        return self._usable_rows(differences(self.raw, x))

    def _usable_rows(self, J: np.ndarray) -> np.ndarray:
        """Weighted rows of J in use; columns with an effect below rounding are zero."""
        size = np.where(self._is_angle, 1.0, self._way or 1.0)[:, None]
        effect = np.sqrt(np.mean((J / size)[self._follow] ** 2, axis=0))
        J = np.where(effect > negligible(self.smooth), J, 0.0) / self._sigma[:, None]
        return J[self._follow]

    def solve(self, x: np.ndarray) -> Any:
        """Least-squares solution from x on. Numbers or combinations without effect keep their start
        value, as a search would move them arbitrarily."""
        moved = moving(self.jacobian(x))
        limits = self.limits
        found = self._search(x, moved, limits)
        if found.held and (stopped := moved & limits.reached(found.x)).any():
            # the rows that hold undetermined combinations may block motion along such a bound
            found = _better(found, self._search(found.x, moved & ~stopped, limits))
        for _ in range(CORNERS):
            if not found.refused:
                break
            slope = self.jacobian(found.x).T @ found.fun
            limits = self.limits.at(found.x, slope, self._possible)
            if limits.same(self.limits):
                break
            other = self._search(found.x, moved & ~limits.fixed, limits)
            gain = 1.0 - float(other.fun @ other.fun) / max(float(found.fun @ found.fun), 1e-300)
            found = _better(found, other)
            if gain < WORTH:
                break
        found.limited = moved & limits.reached(found.x)
        return found

    def _search(self, x: np.ndarray, moved: np.ndarray, limits: Limits) -> Any:
        """Least-squares search over the numbers `moved`; also counts the refused trials."""

        def whole(part: np.ndarray) -> np.ndarray:
            full = x.copy()
            full[moved] = part
            return full

        def slopes(part: np.ndarray) -> np.ndarray:
            return self.jacobian(whole(part))[:, moved]

        if not moved.any():
            message = "none of the parameters changes the motion"
            return OptimizeResult(x=x, fun=self.weighted(x), message=message, refused=0, held=0)
        start = limits.inside(x)[moved]
        held, derivative = with_holding_rows(slopes, start, negligible(self.smooth))
        count = int(self._follow.sum())
        self.refused = 0
        found = least_squares(
            lambda part: np.append(self.weighted(whole(part)), held @ (part - start)), start,
            jac=derivative, bounds=(limits.low[moved], limits.high[moved]),
            x_scale="jac", max_nfev=MOST_RUNS, xtol=1e-12, ftol=1e-12, gtol=1e-12,
        )  # fmt: skip
        return OptimizeResult(
            x=whole(found.x), fun=found.fun[:count], message=found.message,
            refused=self.refused, held=len(held),
        )  # fmt: skip

    def _possible(self, x: np.ndarray) -> bool:
        return bool(np.isfinite(self.raw(x)).all())

    def grown(self, x: np.ndarray) -> np.ndarray:
        """Start values found by fitting increasing parts of the recording.

        A fit to all of it would end in a local minimum off by a whole turn or a bounce."""
        first, last = float(self._time.min()), float(self._time.max())
        for part in PARTS:
            self._follow = self._time <= first + part * (last - first)
            if self._follow.sum() >= ENOUGH * len(x):
                x = self.solve(x).x
        self._follow[:] = True
        return x

    def systematic(self, x: np.ndarray) -> float:
        """Lag-1 correlation of the residuals, if above SYSTEMATIC and the residuals exceed
        rounding; else 0."""
        raw = self.raw(x)
        if np.isfinite(raw).all() and max(self.left(raw)) <= ROUNDING * max(self._way, 1e-300):
            return 0.0
        parts = [part for _, *both in self._by_body(raw).values() for part in both]
        rho = correlation(parts)
        return rho if rho > SYSTEMATIC else 0.0

    @property
    def _way(self) -> float:
        """Largest displacement [m] or rotation [rad] of a body from its first pose."""
        seen = [self.recording.tracks.bodies[name] for name in self.recording.pairs.values()]
        gone = [np.abs(track.position - track.position[0]).max() for track in seen]
        turned = [angle_between(track.orientation[:1], track.orientation).max() for track in seen]
        return float(max(*gone, *turned))

    def changed(self, x: np.ndarray) -> dict[str, Any]:
        return with_numbers(self.data, self.free, values_of(self.free, x), self.attitudes)

    def scene_at(self, x: np.ndarray) -> Scene:
        """The scene with these search variables, as the search simulates it."""
        return self._scene(x, self._options)

    def _scene(self, x: np.ndarray, options: SimulationOptions | None = None) -> Scene:
        scene = scene_from_mapping(self.changed(x), name=self.scene.name, file=self.scene.file)
        return scene.model_copy(update={"simulation": options or self.scene.simulation})

    def _simulate(self, x: np.ndarray) -> Tracks:
        simulation = Simulation(self.scene_at(x))
        made, scene = followed(simulation, self.recording), simulation.scene
        return tracks_of_blocks(made, scene, simulation.layout, scene.name)

    def result(self, solution: Any, *, given: bool) -> Fitted:
        J, r = self.jacobian(solution.x), solution.fun
        variance = (
            1.0 if given else float(r @ r) / max(1, noisy(r, self._is_angle) - len(self.free))
        )
        spread = spread_of(J, negligible(self.smooth), variance, slopes_of(self.free, solution.x),
                           np.array([number.scale for number in self.free]))  # fmt: skip
        names = [number.name for number in self.free]
        undetermined = [" and ".join(names[k] for k in which) for which in spread.undetermined]
        raw = self.raw(solution.x)
        position, angle = self.left(raw)
        residuals, left = self._by_body(raw), self.systematic(solution.x)
        return Fitted(
            self.free, values_of(self.free, solution.x), spread.errors, spread.correlation,
            {"position": position, "angle": angle}, residuals, self.runs,
            str(solution.message), undetermined, self.changed(solution.x),
            [name for name, at in zip(names, solution.limited, strict=True) if at],
            left, () if left else outliers(residuals, ROUNDING * self._way),
            lost_by(self._scene(solution.x), self.recording),
        )  # fmt: skip

    def _by_body(self, raw: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        found, at = {}, 0
        for body, name in self.recording.pairs.items():
            t = self.recording.tracks.bodies[name].t
            part = raw[at : at + 6 * len(t)].reshape(-1, 6)
            at += 6 * len(t)
            found[body] = (t, part[:, :3], part[:, 3:])
        return found


def _better(one: OptimizeResult, other: OptimizeResult) -> OptimizeResult:
    """The result with the smaller sum of squares."""
    return other if float(other.fun @ other.fun) < float(one.fun @ one.fun) else one
