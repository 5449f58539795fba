# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One run of a plan: the scene with its values, simulated, as one row of the table."""

from __future__ import annotations

import hashlib
import json
import math
import struct
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cached_property, partial
from typing import Any

import numpy as np

from rb_sim.base import __version__
from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.base.names import keys_of
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.io.bag.reader import replaced
from rb_sim.mechanics.compiled import family_of
from rb_sim.mechanics.inputs import Family
from rb_sim.mechanics.samples import concatenate
from rb_sim.scene import yaml_reader
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping, scene_from_plain
from rb_sim.scene.schema import Scene
from rb_sim.simulation.simulation import Simulation
from rb_sim.simulation.trajectory import Trajectory
from rb_sim.sweeps import expressions
from rb_sim.sweeps.expressions import NAMES, Expression
from rb_sim.sweeps.plan import FIXED_COLUMNS, LoadedPlan

# Paths of numbers in a scene: `bodies.coin.position[2]`, `effects.weight.acceleration[2]`.


Path = tuple[str | int, ...]


def parse(text: str, file: str) -> Path:
    """Keys and indices of the path `text`. Raises SceneError if it is not a path."""
    keys = keys_of(text)
    if keys is None:
        allowed = """must be a path like bodies.coin.position[2] or bodies["v1.2"].mass"""
        raise SceneError(f"got {text!r}; {allowed}", key="path", file=file)
    return keys


def placed(data: Any, path: Path, value: Any, text: str, file: str) -> Any:
    """As `replaced`, with errors as SceneError. text: the path as written."""
    try:
        return replaced(data, path, value)
    except RbSimError as error:
        raise SceneError(f"got {text!r}; {error}", key="path", file=file) from None


def check_apart(named: Sequence[tuple[str, Path]], file: str) -> None:
    """Raise SceneError if two paths overlap: one value would overwrite the other.

    named: the paths as written and as parsed.
    """
    for i, (text, path) in enumerate(named):
        for other, before in named[:i]:
            if path[: len(before)] == before[: len(path)]:
                why = f"{other!r} sets it, too: must be a value that nothing else sets"
                raise SceneError(f"got {text!r}; {why}", key="path", file=file)


def with_default(data: Any, defaults: Any, path: Path) -> Any:
    """Copy of `data` with missing parts along `path` filled in from `defaults`.

    defaults: the same scene with all defaults written out.
    """
    if not path or not isinstance(data, Mapping) or not isinstance(defaults, Mapping):
        return data
    first, rest = path[0], path[1:]
    if first in data:
        return {**data, first: with_default(data[first], defaults.get(first), rest)}
    return {**data, first: defaults[first]} if rest and first in defaults else data


OK, FAILED, GIVEN_UP = "ok", "failed", "given up"
"""Status of a run: completed; raised an error; exceeded its time limit."""

TAKEN = frozenset(
    {*FIXED_COLUMNS, *NAMES, *expressions.WHOLE_RUN, *expressions.BY_BODY, *expressions.MAPPINGS}
)
"""Names that are not allowed for varied numbers."""

SECTIONS = frozenset({"bodies", "constraints", "effects"})
"""Sections of a scene that map names to independently validated entries."""


class PlanRunner:
    """Runs single points of one plan; created once per process.

    looks: values of a few runs that together vary everything; they show which numbers the compiled
    laws must take as inputs, so that laws are compiled once for all runs. Raises RbSimError for an
    invalid expression or path.
    """

    def __init__(self, loaded: LoadedPlan, looks: Sequence[Mapping[str, float]] = ()) -> None:
        self.loaded, plan = loaded, loaded.plan
        self._paths = {
            name: [(text, parse(text, loaded.file)) for text in vary.paths]
            for name, vary in plan.vary.items()
        }
        self._derived = [
            (text, parse(text, loaded.file), Expression(source, f"derived.{text}"))
            for text, source in plan.derived.items()
        ]
        self._check_targets()
        self.expressions = {
            name: Expression(output.value, f"outputs.{name}")
            for name, output in plan.outputs.items()
        }
        fixed = {"scene": loaded.scene, "simulation": plan.simulation, "derived": plan.derived}
        self._base, self._checked = self._with_defaults()
        self._looks = looks
        outputs = {name: output.value for name, output in plan.outputs.items()}
        settings = {**fixed, "outputs": outputs, "final": plan.final_state, "rb_sim": __version__}
        paths_of = {name: vary.paths for name, vary in plan.vary.items()}
        text = json.dumps([settings, paths_of], sort_keys=True, default=str)
        self._hash = hashlib.sha256(text.encode())

    def _check_targets(self) -> None:
        """Raise RbSimError if a varied number has no effect, or two set the same value."""
        plan, file = self.loaded.plan, self.loaded.file
        settings = [(f"simulation: {{{key}: ...}}", ("simulation", key)) for key in plan.simulation]
        places = [place for several in self._paths.values() for place in several]
        derived = [(text, path) for text, path, _ in self._derived]
        check_apart([*settings, *places, *derived], file)
        used = {name for _, _, expression in self._derived for name in expression.names}
        for name, vary in plan.vary.items():
            if not vary.paths and name not in used:
                message = "is missing; must be given, as nothing in `derived` names this number"
                raise SceneError(message, key=f"vary.{name}.path", file=file)

    @cached_property
    def quantities(self) -> set[str]:
        """Names of samples that the outputs need."""
        whole = {*expressions.WHOLE_RUN, *expressions.BY_BODY, "reaction"}
        named = {name for output in self.expressions.values() for name in output.names}
        return (named & whole) | (
            set(expressions.BY_BODY) if self.loaded.plan.final_state else set()
        )

    @cached_property
    def of_ends(self) -> bool:
        """Whether the outputs need only the first and the last sample."""
        varied = self.loaded.plan.vary
        return all(output.of_ends(varied) for output in self.expressions.values())

    def _with_defaults(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """The scene as plain data, with the defaults that a path refers to written out; and its
        validated sections."""
        data = self.loaded.scene
        checked = scene_from_mapping(data, file=self.loaded.scene_file)
        defaults = checked.model_dump(by_alias=True, mode="json", warnings=False)
        named = [path for places in self._paths.values() for _, path in places]
        for path in (*named, *(path for _, path, _ in self._derived)):
            data = with_default(data, defaults, path)
        return data, {section: getattr(checked, section) for section in SECTIONS}

    @cached_property
    def family(self) -> Family | None:
        """The laws shared by the runs of the plan; None if none are shared.

        It depends only on the plan, so that a run gives the same bits in every worker.
        """
        members = []
        for values in self._looks:
            with suppress(RbSimError):  # reported in the row of that run
                members.append(compile_scene(self.scene(values)))
        return family_of(members) if members else None

    def scene_hash(self, values: Mapping[str, float]) -> str:
        """Hash of a run: scene, settings, values and outputs."""
        digest = self._hash.copy()
        for name in sorted(values):
            digest.update(name.encode() + struct.pack("<d", values[name]))
        return digest.hexdigest()[:24]

    def mapping(self, values: Mapping[str, float]) -> dict[str, Any]:
        """The scene as plain data with these values."""
        data = self._base
        for name, places in self._paths.items():
            for text, path in places:
                data = placed(data, path, float(values[name]), text, self.loaded.file)
        for text, path, expression in self._derived:
            value = _numbers(expression, expression.value(values, {}))
            data = placed(data, path, value, text, self.loaded.file)
        return data

    def scene(self, values: Mapping[str, float]) -> Scene:
        """The validated scene of one run."""
        data = self.mapping(values)
        return scene_from_plain(
            self._known(data),
            file=self.loaded.scene_file,
            text=partial(yaml_reader.write, data),
            **self.loaded.plan.simulation,
        )

    def _known(self, data: Mapping[str, Any]) -> dict[str, Any]:
        """The data with unchanged entries replaced by validated objects, to save time."""
        known = dict(data)
        for section in SECTIONS.intersection(data):
            own, base, checked = (of[section] or {} for of in (data, self._base, self._checked))
            if not isinstance(own, Mapping):  # reported by the scene's validation
                continue
            known[section] = {
                # a contact of all bodies is validated under other names, one for each body
                name: checked.get(name, entry) if entry is base[name] else entry
                for name, entry in own.items()
            }
        return known

    def scene_text(self, values: Mapping[str, float]) -> str:
        """YAML of the scene of one run with the plan's simulation options, to be run on its own."""
        data = self.mapping(values)
        options = self.scene(values).simulation.model_dump(exclude_none=True, exclude_unset=True)
        return yaml_reader.write({**data, "simulation": options})

    def run(self, values: Mapping[str, float]) -> tuple[dict[str, Any], Trajectory | None]:
        """(status, reason, steps and outputs of one run; its samples, None if it failed).

        Errors of this run become its status and reason, not exceptions.
        """
        columns = {name: math.nan for name in self.expressions}
        row: dict[str, Any] = {"status": OK, "reason": "", "steps": 0, **columns}
        try:
            simulation = Simulation(self.scene(values), family=self.family, announce=None)
            trajectory, finished = self._simulated(simulation)
            row["steps"] = simulation.steps
            if not finished:
                row["status"] = GIVEN_UP
                row["reason"] = (
                    f"took more than {self.loaded.plan.seconds_per_run:g} s of wall time"
                )
                return row, trajectory
            row |= self.outputs(values, trajectory)
        except RbSimError as error:
            row |= {"status": FAILED, "reason": str(error)}
            return row, None
        return row, trajectory

    def _simulated(self, simulation: Simulation) -> tuple[Trajectory, bool]:
        """Samples of a run, and whether it completed in time, compilation excluded."""
        options = simulation.scene.simulation
        began: float | None = None  # set at the first call, after compilation
        late = False

        def goes_on(_: float) -> bool:
            nonlocal began, late
            now = time.perf_counter()
            began = now if began is None else began
            late = now - began > self.loaded.plan.seconds_per_run
            return not late

        blocks = list(simulation.blocks(options.duration, options.rate, goes_on))
        run = Trajectory(concatenate(blocks, simulation.layout), simulation.layout)
        whole = options.duration - run.t[-1] <= COMPUTED_ROUNDING / options.rate
        return run, bool(whole) or not late

    def outputs(self, values: Mapping[str, float], run: Trajectory) -> dict[str, float]:
        """The plan's outputs of a run. Raises RbSimError if one is not a single number."""
        names, functions = {**expressions.names(run), **values}, expressions.functions(run)
        kept = {}
        for name, expression in self.expressions.items():
            kept[name] = _one_number(expression, expression.value(names, functions))
        if self.loaded.plan.final_state:
            kept |= expressions.final_state(run)
        return kept

    def check(self, values: Mapping[str, float]) -> Simulation:
        """The simulation of one run, to validate the plan before all others start.

        Raises RbSimError for errors common to all runs: a path, an output.
        """
        for name in values:
            if name in TAKEN:
                allowed = "another name: this one has a meaning in the table or in expressions"
                raise SceneError(
                    f"got {name!r}; must be {allowed}", key="vary", file=self.loaded.file
                )
        simulation = Simulation(self.scene(values))
        self.outputs(values, simulation.sample())
        return simulation


def ended(steps: int, outputs: Mapping[str, float]) -> dict[str, Any]:
    """The row of a completed run."""
    return {"status": OK, "reason": "", "steps": steps, **outputs}


def _numbers(expression: Expression, value: Any) -> Any:
    """Value of a derived expression for the scene. Raises RbSimError if it is not numeric."""
    try:
        return np.asarray(value, dtype=float).tolist()
    except (TypeError, ValueError):
        raise RbSimError(f"{expression.key}: gives no number; must give numbers") from None


def _one_number(expression: Expression, value: Any) -> float:
    """Value of an output. Raises RbSimError if it is not a single number."""
    if isinstance(value, (str, Mapping)):
        what = "no number"
    elif np.ndim(value):
        what = "a list, as over the samples"
    else:
        return float(value)
    allowed = "must give one number: take its max(), min(), rms(), last() ..."
    raise RbSimError(f"{expression.key}: gives {what}; {allowed}")
