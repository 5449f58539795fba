# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters and initial state that make a simulation follow a recording, by least squares.

    minimise  sum |p_sim - p|^2 / s_p^2 + |turn(q, q_sim)|^2 / s_q^2

over the free numbers, with the poses of the bodies' origins at the recorded instants. Where the
noise s_p [m], s_q [rad] is not given, a first fit estimates it from what it leaves. With the
Jacobian J of the weighted residuals r at the solution, cov = (J^T J)^-1 |r|^2 / (n - p), its roots
are the standard errors (Bard, Nonlinear Parameter Estimation, 1974, ch. 7). J is exact where the
motion is smooth (rb_sim.simulation.sensitivity), else it is taken by differences: central ones,
and to one side where the scene refuses the other. What lies at such a limit at the end is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from rb_sim.bags.analysis.derivatives import NORMAL
from rb_sim.bags.tracks import Tracks, tracks_of_blocks
from rb_sim.base.errors import RbSimError, SceneError, SimulationError
from rb_sim.base.names import first_few
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.fit.recording import Recording, followed, lost_by
from rb_sim.fit.unknowns import (
    Fitted,
    Free,
    Limits,
    body_of,
    bounds,
    differenced,
    differences,
    free_numbers,
    held_still,
    moving,
    negligible,
    poorly_determined,
    slopes_of,
    start_of,
    values_of,
    with_numbers,
)
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

# Whether what a fit leaves is noise: neighbours in time are then independent.
#
#     rho = sum r_k r_k+1 / sum r_k^2
#
# is about 0 for noise, with a standard deviation of 1 / sqrt(n), and near 1 for what a wrong model
# or a search that ended elsewhere leaves (Durbin and Watson, Biometrika 37, 1950).


FEW = 16
"""Samples below which nothing is said."""
SYSTEMATIC = 0.5
"""Correlation of neighbours from which on the rest is not noise."""
ROUNDING = 1e-7
"""Of the largest way: residuals below are of rounding and tolerances."""


def correlation(columns: Iterable[np.ndarray]) -> float:
    """Of neighbours in columns of residuals, each shape (n, 3), by their squares; 0 for too few."""
    products = squares = 0.0
    for r in columns:
        if len(r) >= FEW:
            products += float(np.sum(r[1:] * r[:-1]))
            squares += float(np.sum(r * r))
    return products / squares if squares > 0.0 else 0.0


# How sure the numbers of a fit are: standard errors, correlations, and what is not determined.
#
#     cov = D (J^T J)^-1 D^T s^2
#
# with J the Jacobian by the numbers of the search, D the derivatives of the numbers themselves by
# these and s^2 the variance of the weighted residuals (Bard, Nonlinear Parameter Estimation, 1974,
# ch. 7).


SHARE = 0.1
"""Of a combination without effect, from which on a number belongs to it."""


class Spread(NamedTuple):
    """Of the numbers of a fit."""

    errors: np.ndarray
    """standard errors, infinite for what is not determined."""
    correlation: np.ndarray
    undetermined: list[list[int]]
    """which numbers belong to each combination without effect."""


def spread_of(
    J: np.ndarray, least: float, variance: float, slopes: np.ndarray, scales: np.ndarray
) -> Spread:
    """least: singular value of J, relative to the largest, that says nothing."""
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
    """How many residuals have noise: attitudes that are all written as the identity have none, and
    would make the others' look smaller."""
    kinds = [is_angle == k for k in (False, True)]
    return sum(int(kind.sum()) for kind in kinds if np.mean(r[kind] ** 2) > WRITTEN_ROUNDING)


# Poses that lie far from all others beside the motion that was fitted: they draw the fit.
#
# Least squares takes one pose that is a hundred times as far off as ten thousand others. How far
# the others are tells the median of the residuals' sizes, which a few outliers do not change
# (Huber, Robust Statistics, 1981).


FAR = 10.0
"""Standard deviations of the noise: no sample of any size has one so far from noise."""
MOST = 0.1
"""Of the poses: more of them are no outliers, but another motion."""

Residuals = Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


def outliers(residuals: Residuals, rounding: float) -> tuple[str, ...]:
    """A line for each body that has some. residuals: as of `Fitted`; rounding: what is no more than
    that [m, rad] is none."""
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


# The Jacobian of the residuals from the derivatives that the motion carries along.


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
            part[:n, :3] = change.position[at, i] - rotation_change(q, dq, r) - rotate(q, dr)
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
    sign = np.where(np.sum(p * q, axis=1) < 0, -2.0, 2.0)[:, None]
    return sign * product(conjugate(p), dq)[:, :3]


def rotation_change(q: np.ndarray, dq: np.ndarray, a: np.ndarray) -> np.ndarray:
    """d (R(q) a) for the change dq of unit quaternions (n, 4) and one vector, (n, 3)."""
    u, w, du, dw = q[:, :3], q[:, 3:], dq[:, :3], dq[:, 3:]
    t, dt = 2.0 * cross(u, a), 2.0 * cross(du, a)
    return dw * t + w * dt + cross(du, t) + cross(u, dt)


MOST_RUNS = 200
"""Evaluations of a fit, those for J aside."""
PARTS = (0.05, 0.1, 0.2, 0.35, 0.6)
"""Of the recording, that a search follows one after the other where it fails on all of it."""
CORNERS = 8
"""Times that a search is taken up again along the limits that stopped it."""
WORTH = 1e-6
"""Of the sum of squares, for which it is."""
ENOUGH = 4
"""Residuals for each number."""
HOPELESS = 1e6
"""Weighted residual of a trial that cannot be simulated: the search turns back."""


def fit(
    recording: Recording,
    scene: Scene,
    data: Mapping[str, Any],
    keys: Sequence[str],
    noise: tuple[float, float] | None = None,
) -> Fitted:
    """Fit the numbers `keys` of the scene. data: the scene's own mapping; noise: (m, rad).

    Raises RbSimError for keys that will not do, SimulationError if the start cannot be simulated.
    """
    problem = _Problem(recording, scene, data, free_numbers(data, keys))
    x = start_of(problem.free)
    r = problem.raw(x)
    if not np.isfinite(r).all():
        raise SimulationError(f"the scene cannot be simulated as it starts: {problem.trouble}")
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
    """The residuals as a function of the numbers over their scales."""

    def __init__(
        self, recording: Recording, scene: Scene, data: Mapping[str, Any], free: list[Free]
    ) -> None:
        self.recording, self.scene, self.data, self.free = recording, scene, data, free
        self.limits = Limits(*bounds(free, data))
        self.attitudes = {n.key: scene.bodies[body_of(n.key)].orientation for n in free if n.turn}
        self.runs = 0
        self._options = scene.simulation
        self.smooth = True
        """False once the exact derivatives could not be had."""
        self.trouble = ""
        self.refused = 0
        """trials of a search that could not be simulated."""
        size = sum(len(recording.tracks.bodies[b].t) for b in recording.pairs.values())
        if 6 * size <= len(free):
            raise RbSimError(f"{size} poses do not determine {len(free)} numbers")
        self._is_angle = np.tile(np.repeat([False, True], 3), size)
        self._sigma = np.ones(6 * size)
        times = [recording.tracks.bodies[b].t for b in recording.pairs.values()]
        self._time = np.repeat(np.concatenate(times), 6)
        self._follow = np.ones(6 * size, bool)
        """which residuals are made small."""

    def weigh(self, position: float, angle: float) -> None:
        """Noise of position [m] and attitude [rad]."""
        self._sigma = np.where(self._is_angle, angle, position)

    def left(self, r: np.ndarray) -> tuple[float, float]:
        """RMS of the residuals of position and attitude, none of them 0."""
        rms = [float(np.sqrt(np.mean(r[self._is_angle == k] ** 2))) for k in (False, True)]
        floor = max(*rms, 1e-15) * 1e-6
        return max(rms[0], floor), max(rms[1], floor)

    def raw(self, x: np.ndarray) -> np.ndarray:
        """Residuals in metres and radians, (position, turn) of each pose in turn."""
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
                return self._usable_rows(raw_jacobian(self.recording, self.scene_at, x))
            except (NotSmoothError, SimulationError):
                self.smooth, self._options = False, differenced(self._options)
        return self._usable_rows(differences(self.raw, x))

    def _usable_rows(self, J: np.ndarray) -> np.ndarray:
        """The rows that are followed, weighted; nothing for numbers whose effect is rounding."""
        size = np.where(self._is_angle, 1.0, self._way or 1.0)[:, None]
        effect = np.sqrt(np.mean((J / size)[self._follow] ** 2, axis=0))
        J = np.where(effect > negligible(self.smooth), J, 0.0) / self._sigma[:, None]
        return J[self._follow]

    def solve(self, x: np.ndarray) -> Any:
        """Least squares from x on. What has no effect there stays as it is, a number or a
        combination of them: a search that divides by its effect would carry it anywhere."""
        moved = moving(self.jacobian(x))
        limits = self.limits
        found = self._search(x, moved, limits)
        if found.held and (stopped := moved & limits.reached(found.x)).any():
            # what the rows without effect hold may be what could go on beside such a bound
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
        """Of the numbers `moved`; how many trials were refused on the way."""

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
        held, derivative = held_still(slopes, start, negligible(self.smooth))
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
        """Numbers to begin with that follow the beginning of the recording, then more and more of
        it: over all of it a search ends where a turn is missed by a whole one, or a bounce."""
        first, last = float(self._time.min()), float(self._time.max())
        for part in PARTS:
            self._follow = self._time <= first + part * (last - first)
            if self._follow.sum() >= ENOUGH * len(x):
                x = self.solve(x).x
        self._follow[:] = True
        return x

    def systematic(self, x: np.ndarray) -> float:
        """The correlation of neighbours in what is left, where that is more than chance and more
        than rounding; else 0."""
        raw = self.raw(x)
        if np.isfinite(raw).all() and max(self.left(raw)) <= ROUNDING * max(self._way, 1e-300):
            return 0.0
        parts = [part for _, *both in self._by_body(raw).values() for part in both]
        rho = correlation(parts)
        return rho if rho > SYSTEMATIC else 0.0

    @property
    def _way(self) -> float:
        """How far a body goes [m] or turns [rad] from its first pose: its origin may be held."""
        seen = [self.recording.tracks.bodies[name] for name in self.recording.pairs.values()]
        gone = [np.abs(track.position - track.position[0]).max() for track in seen]
        turned = [angle_between(track.orientation[:1], track.orientation).max() for track in seen]
        return float(max(*gone, *turned))

    def changed(self, x: np.ndarray) -> dict[str, Any]:
        return with_numbers(self.data, self.free, values_of(self.free, x), self.attitudes)

    def scene_at(self, x: np.ndarray) -> Scene:
        """The scene with these numbers over their scales, as the search simulates it."""
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
    """That which leaves less."""
    return other if float(other.fun @ other.fun) < float(one.fun @ one.fun) else one
