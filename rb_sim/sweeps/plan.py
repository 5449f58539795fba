# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A plan: a scene, its varied numbers, and the outputs kept of every run."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, Strict, model_validator
from scipy import stats
from scipy.stats import qmc

from rb_sim.base.errors import MissingExtraError, RbSimError, SceneError
from rb_sim.catalogue.spec import (
    Finite,
    Identifier,
    NonNegative,
    Positive,
    Spec,
    one_of,
    refuse,
    refuse_at,
)
from rb_sim.scene import yaml_reader
from rb_sim.scene.listing import find_scene, scene_folders
from rb_sim.scene.load import OVERRIDES
from rb_sim.scene.yaml_reader import validated

MOST_RUNS = 10_000_000
"""Maximum number of runs of a plan: the varied values of more do not fit into memory."""

Sampling = Literal["random", "sobol", "latin_hypercube", "saltelli"]
Pair = Annotated[tuple[Finite, Finite], Strict(False)]


class Grid(Spec):
    """Evenly spaced values, including both ends."""

    start: Finite = Field(alias="from")
    stop: Finite = Field(alias="to")
    count: Annotated[int, Field(ge=1, le=MOST_RUNS)]
    spacing: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _positive_where_log(self) -> Grid:
        if self.spacing == "log" and not (self.start > 0.0 and self.stop > 0.0):
            raise refuse_at((("from",), self.start, refuse("> 0, as must `to`, on a log spacing")))
        if self.count == 1 and self.start != self.stop:
            raise refuse_at((("count",), 1, refuse(">= 2, as `from` and `to` differ")))
        return self


class Normal(Spec):
    """A normal distribution."""

    mean: Finite
    std: NonNegative


def _interval(value: Any) -> Any:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise refuse("two numbers [low, high]")
    if all(isinstance(v, (int, float)) for v in value) and not value[0] < value[1]:
        raise refuse("two numbers [low, high] with low < high")
    return value


Interval = Annotated[Pair, BeforeValidator(_interval)]
NOT_SI = frozenset(
    "° deg degree degrees rpm turn turns mm cm dm km um in inch ft g t lb lbs ms us min h kN MN mN "
    "kJ mJ kW bar hp mph".split()
)
"""Units not allowed for a varied number, since a scene is in SI units."""

KINDS = ("grid", "list", "normal", "uniform", "log_uniform")


class Vary(Spec):
    """A varied number: its paths in the scene, and its values."""

    path: str | Annotated[tuple[str, ...], Strict(False), Field(min_length=1)] | None = None
    """path in the scene, or several that get the same value; None: used only by `derived`."""
    unit: str = ""
    grid: Grid | None = None
    values: Annotated[tuple[Finite, ...], Strict(False), Field(min_length=1)] | None = Field(
        default=None, alias="list"
    )
    normal: Normal | None = None
    uniform: Interval | None = None
    log_uniform: Interval | None = None

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths in the scene that get the value."""
        if self.path is None:
            return ()
        return (self.path,) if isinstance(self.path, str) else self.path

    @property
    def random(self) -> bool:
        """True if the values are drawn, False if they are listed."""
        return self.grid is None and self.values is None

    @model_validator(mode="after")
    def _one_kind(self) -> Vary:
        given = [self.grid, self.values, self.normal, self.uniform, self.log_uniform]
        if sum(value is not None for value in given) != 1:
            raise refuse(f"a mapping with exactly one of {', '.join(KINDS)}")
        if self.log_uniform is not None and not self.log_uniform[0] > 0.0:
            raise refuse_at((("log_uniform",), self.log_uniform, refuse("two numbers > 0")))
        if self.path is not None and NOT_SI.intersection(re.findall(r"[^\W\d_]+|°", self.unit)):
            allowed = "in SI, as the scene is: leave `path` out and convert it in `derived`"
            raise refuse_at((("unit",), self.unit, refuse(allowed)))
        return self


class Correlation(Spec):
    """Correlation between two drawn numbers (between their underlying normal variables)."""

    between: Annotated[tuple[Identifier, Identifier], Strict(False)]
    coefficient: Annotated[Finite, Field(gt=-1.0, lt=1.0)]


class Output(Spec):
    """A number kept of every run."""

    value: str
    """an expression over the samples."""
    unit: str = ""


def _output(value: Any) -> Any:
    return {"value": value} if isinstance(value, str) else value


class Plan(Spec):
    """Many runs of one scene."""

    description: str = ""
    scene: str
    """a YAML file (relative to the plan), or the name of a shipped scene."""
    simulation: dict[str, Any] = Field(default_factory=dict)
    """duration, rate, method, step or tolerance that replace the scene's."""
    vary: dict[Identifier, Vary] = Field(min_length=1)
    derived: dict[str, str] = Field(default_factory=dict)
    """path in the scene -> expression of the varied names."""
    draws: Annotated[int, Field(ge=1, le=MOST_RUNS)] | None = None
    """number of draws; for saltelli the base samples N of N (D + 2) runs."""
    sampling: Sampling = "random"
    seed: Annotated[int, Field(ge=0)] = 0
    correlations: Annotated[tuple[Correlation, ...], Strict(False)] = ()
    outputs: dict[Identifier, Annotated[Output, BeforeValidator(_output)]] = Field(
        default_factory=dict
    )
    final_state: bool = False
    """keep position, orientation and velocities of every body at the end of each run."""
    trajectories: Annotated[int, Field(ge=0, le=10_000)] = 0
    """number of runs (the first ones) of which all samples are kept."""
    seconds_per_run: Positive = 60.0
    """wall-clock time limit of a run [s]."""

    _file: str = ""

    @model_validator(mode="after")
    def _consistent(self) -> Plan:
        drawn = [name for name, vary in self.vary.items() if vary.random]
        if drawn and self.draws is None:
            raise refuse_at((("draws",), None, refuse(f"given: {drawn[0]} is drawn")))
        if not drawn and self.draws is not None:
            raise refuse_at((("draws",), self.draws, refuse("omitted: nothing is drawn")))
        if not drawn and "sampling" in self.model_fields_set:
            raise refuse_at((("sampling",), self.sampling, refuse("omitted: nothing is drawn")))
        self._check_correlations(drawn)
        for key in self.simulation:
            if key not in OVERRIDES:
                raise refuse_at((("simulation", key), key, refuse(one_of(key, OVERRIDES))))
        if not self.outputs and not self.final_state and not self.trajectories:
            raise refuse_at((("outputs",), None, refuse("given, or final_state: true")))
        for name in self.outputs:
            if name in self.vary or name in FIXED_COLUMNS:
                raise refuse_at((("outputs", name), name, refuse("a name that is not taken")))
        return self

    def _check_correlations(self, drawn: list[str]) -> None:
        """Raise the error of an invalid correlation."""
        if self.correlations and self.sampling == "saltelli":
            allowed = refuse("omitted: Sobol indices are of numbers that do not depend on others")
            raise refuse_at((("correlations",), "some", allowed))
        seen: set[frozenset[str]] = set()
        for i, pair in enumerate(self.correlations):
            where, names = ("correlations", i, "between"), frozenset(pair.between)
            for name in pair.between:
                if name not in drawn:
                    raise refuse_at((where, name, refuse(f"drawn: {one_of(name, drawn)}")))
            if len(names) == 1 or names in seen:
                raise refuse_at((where, list(pair.between), refuse("two names, each pair once")))
            seen.add(names)

    @property
    def grid_shape(self) -> tuple[int, ...]:
        """Number of values of each listed number, in the order of the plan."""
        return tuple(
            vary.grid.count if vary.grid else len(vary.values or ())
            for vary in self.vary.values()
            if not vary.random
        )

    @property
    def drawn(self) -> tuple[str, ...]:
        """Names of the drawn numbers."""
        return tuple(name for name, vary in self.vary.items() if vary.random)

    @property
    def runs(self) -> int:
        """Number of runs of the plan."""
        draws = self.draws or 1
        if self.sampling == "saltelli" and self.drawn:
            draws *= len(self.drawn) + 2
        return draws * math.prod(self.grid_shape)


FIXED_COLUMNS = ("run", "batch", "scene_hash", "status", "reason", "steps")
"""Columns of every table of runs."""


class LoadedPlan:
    """A plan and its scene, as plain data.

    plan, file: as read. scene_file: the scene's path. scene: the scene's mapping.
    """

    def __init__(self, plan: Plan, file: str, scene_file: str, scene: dict[str, Any]) -> None:
        self.plan, self.file, self.scene_file, self.scene = plan, file, scene_file, scene

    def as_dict(self) -> dict[str, Any]:
        """Plain data for `from_dict`; keeps the order of `vary`."""
        plan = self.plan.model_dump(by_alias=True, exclude_unset=True, mode="json")
        return {"plan": plan, "file": self.file, "scene_file": self.scene_file, "scene": self.scene}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> LoadedPlan:
        """The plan from the data of `as_dict`."""
        plan = validated(Plan, data["plan"], data["file"])
        return cls(plan, data["file"], data["scene_file"], data["scene"])


def load_plan(source: str | Path | dict[str, Any]) -> LoadedPlan:
    """The plan of a YAML file, a shipped plan (by name), or a mapping.

    Raises SceneError with file, key, value and allowed values, in one line.
    """
    if isinstance(source, dict):
        data, file, folder = source, "<plan>", Path()
    elif not isinstance(source, (str, Path)):
        allowed = "a file, the name of a plan that comes with rb_sim, or a mapping"
        raise SceneError(f"got {source!r:.80}; must be {allowed}", key="plan", file="<plan>")
    else:
        path = find_plan(source)
        data, file, folder = (
            yaml_reader.parse(yaml_reader.read_text(path), str(path)),
            str(path),
            path.parent,
        )
    if isinstance(data, dict) and "bodies" in data:
        why = "is a scene; a plan names one (`scene: FILE`) and what to vary (`vary:`)"
        raise SceneError(why, file=file)
    plan = validated(Plan, data, file)
    if plan.runs > MOST_RUNS:
        raise SceneError(f"has {plan.runs} runs; at most {MOST_RUNS} are allowed", file=file)
    beside = folder / plan.scene
    scene_path = beside if beside.is_file() else find_scene(plan.scene)
    scene = yaml_reader.parse(yaml_reader.read_text(scene_path), str(scene_path))
    if not isinstance(scene, dict):
        raise SceneError("a scene must be a mapping with bodies", file=str(scene_path))
    return LoadedPlan(plan, file, str(scene_path), scene)


def shipped_plans() -> dict[str, Path]:
    """Paths of the plans shipped with rb_sim, by name."""

    for folder in scene_folders():
        found = {path.stem: path for path in sorted((folder / "sweeps").glob("*.yaml"))}
        plans = {name: path for name, path in found.items() if not name.endswith("_scene")}
        if plans:
            return plans
    return {}


def find_plan(source: str | Path) -> Path:
    """Path of a plan given by file or by the name of a shipped one.

    Raises SceneError, which lists the shipped plans.
    """
    path = Path(source)
    if path.is_file():
        return path
    plans = shipped_plans()
    if str(source) in plans:
        return plans[str(source)]
    why = "is a folder" if path.is_dir() else "does not exist"
    allowed = f"a YAML file or the name of a shipped plan: {one_of(path.stem, plans)}"
    raise SceneError(f"{why}; a plan must be {allowed}", file=str(source))


# Values of the varied numbers in every run.


def points(plan: Plan) -> dict[str, np.ndarray]:
    """Value of each varied name in every run, shape (runs,) each.

    The draws are the innermost index: every grid point gets the same draws (common random numbers).
    The same plan gives the same values on every machine.
    """
    draws = _drawn(plan)
    count = len(next(iter(draws.values()))) if draws else 1
    shape = plan.grid_shape
    grid_index = np.arange(int(np.prod(shape, dtype=int)))
    unravelled = iter(np.unravel_index(grid_index, shape) if shape else ())
    table = {}
    for name, vary in plan.vary.items():
        if vary.random:
            table[name] = np.tile(draws[name], len(grid_index))
        else:
            table[name] = np.repeat(listed(vary)[next(unravelled)], count)
    return table


def listed(vary: Vary) -> np.ndarray:
    """Values of a listed number."""
    if vary.grid is None:
        return np.array(vary.values, dtype=float)
    grid = vary.grid
    space = np.geomspace if grid.spacing == "log" else np.linspace
    return space(grid.start, grid.stop, grid.count)


def _drawn(plan: Plan) -> dict[str, np.ndarray]:
    """Draws of each drawn name."""
    names = plan.drawn
    if not names:
        return {}
    u = _unit_cube(plan, len(names))
    if plan.correlations:
        u = stats.norm.cdf(stats.norm.ppf(u) @ _factor(plan, names).T)
    return {name: _quantile(plan.vary[name], u[:, i]) for i, name in enumerate(names)}


def _unit_cube(plan: Plan, dimensions: int) -> np.ndarray:
    """Points in the open unit cube, shape (draws, dimensions)."""
    assert plan.draws is not None
    if plan.sampling == "saltelli":
        return _saltelli(plan, dimensions)
    engines: dict[str, Any] = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube}
    if plan.sampling == "random":
        u = np.random.default_rng(plan.seed).random((plan.draws, dimensions))
    else:
        with warnings.catch_warnings():  # draws need not be a power of 2
            warnings.simplefilter("ignore", UserWarning)
            u = engines[plan.sampling](dimensions, seed=plan.seed).random(plan.draws)
    tiny = np.finfo(float).tiny
    return np.clip(u, tiny, 1.0 - np.finfo(float).epsneg)


def _saltelli(plan: Plan, dimensions: int) -> np.ndarray:
    """Saltelli's design for first-order and total Sobol indices (SALib), (runs, dimensions)."""
    try:
        from SALib.sample import sobol
    except ImportError as error:
        raise MissingExtraError("SALib", "sweep", "sampling saltelli") from error
    assert plan.draws is not None
    problem = saltelli_problem([str(i) for i in range(dimensions)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        u = sobol.sample(problem, plan.draws, calc_second_order=False, seed=plan.seed)
    return np.clip(u, np.finfo(float).tiny, 1.0 - np.finfo(float).epsneg)


def saltelli_problem(names: list[str]) -> dict[str, Any]:
    """SALib's description of numbers that are uniform on [0, 1]."""
    return {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}


def _factor(plan: Plan, names: tuple[str, ...]) -> np.ndarray:
    """Cholesky factor of the correlations. Raises RbSimError if not positive definite."""
    matrix = np.eye(len(names))
    for pair in plan.correlations:
        i, j = (names.index(name) for name in pair.between)
        matrix[i, j] = matrix[j, i] = pair.coefficient
    try:
        return np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise RbSimError(
            "correlations: no numbers can have all of them at once (the matrix is not positive "
            "definite); make them smaller"
        ) from None


def _quantile(vary: Vary, u: np.ndarray) -> np.ndarray:
    """Values of a drawn number at the probabilities u."""
    if vary.normal is not None:
        return vary.normal.mean + vary.normal.std * stats.norm.ppf(u)
    if vary.uniform is not None:
        low, high = vary.uniform
        return low + (high - low) * u
    assert vary.log_uniform is not None
    low, high = np.log(vary.log_uniform)
    return np.exp(low + (high - low) * u)
