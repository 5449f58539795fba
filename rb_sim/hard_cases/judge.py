# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Hard cases: read from a file, run with each of their settings, and judged."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rb_sim.accuracy.differences import pose_gaps
from rb_sim.base.errors import RbSimError
from rb_sim.base.names import one_of
from rb_sim.checks.check import effort_of
from rb_sim.checks.check_list import CheckList
from rb_sim.scene.listing import find_scene
from rb_sim.scene.load import load_scene
from rb_sim.scene.schema import METHODS
from rb_sim.scene.yaml_reader import parse, read_text
from rb_sim.simulation.simulation import Simulation
from rb_sim.sweeps.expressions import Expression
from rb_sim.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout


# A case: a scene, how it is run, what must hold, and why it is hard; one YAML file each.


SUFFIX = ".yaml"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Setting(_Strict):
    """One way to run the scene."""

    method: Literal[METHODS]  # type: ignore[valid-type]
    step: float | None = Field(default=None, gt=0.0)
    tolerance: float | None = Field(default=None, gt=0.0)
    duration: float | None = Field(default=None, gt=0.0)
    """instead of the scene's, where the method needs more steps [s]."""


class Check(_Strict):
    """What must hold of every run.

    energy: change of energy less work, over what was exchanged. momentum: the worse of both
    balances. residual: violation of constraints. formula: largest size of a formula over the
    samples. against: largest pose difference to another setting. warned: that a check warns, or the
    run is refused; the figure is 0 then, else 1. refused: likewise, only by an error.
    """

    figure: Literal["energy", "momentum", "residual", "formula", "against", "warned", "refused"]
    formula: str = ""
    against: Setting | None = None
    words: str = ""
    """what an error must say, of refused and warned."""
    bound: float = Field(default=0.5, gt=0.0)
    because: str = ""
    """how the bound follows from order, step and conditioning."""

    @model_validator(mode="after")
    def _complete(self) -> Check:
        if self.figure == "formula" and not self.formula:
            raise ValueError("figure formula needs a formula")
        if self.figure == "against" and self.against is None:
            raise ValueError("figure against needs a setting: against: {method: ...}")
        return self


class Case(_Strict):
    """One hard case."""

    title: str
    theme: str = "other"
    """under which the picture shows it."""
    why: str
    """why it is hard."""
    engines: Mapping[str, str] = {}
    """engines known to fail it, and how; or to hold it, where they do."""
    quick: bool = False
    """whether it is cheap enough for `--quick` and for every run of the tests."""
    limit: str = ""
    """what is not held today, and why: the row then shows what is and does not fail."""
    scene: Mapping[str, Any] | str
    """as in a scene file, or the name of a shipped scene."""
    runs: tuple[Setting, ...] = Field(min_length=1)
    checks: tuple[Check, ...] = Field(min_length=1)
    name: str = ""


def load_case(path: Path) -> Case:
    """The case in a file. Raises RbSimError in one line for what is not one."""
    mapping = parse(read_text(path), str(path))
    if not isinstance(mapping, Mapping):
        raise RbSimError(f"{path}: a case must be a mapping with title, why, scene, runs, checks")
    try:
        return Case.model_validate({**mapping, "name": path.stem})
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise RbSimError(f"{path}: {key}: {first['msg']}") from None


def load_cases(folder: Path, only: Sequence[str] = ()) -> list[Case]:
    """The cases of a folder whose names have one of the parts `only`; all without.

    Raises RbSimError if there are none, or none with one of the parts.
    """
    paths = sorted(folder.glob(f"*{SUFFIX}"))
    names = [path.stem for path in paths]
    if not paths:
        raise RbSimError(f"{folder}: has no case (a file *{SUFFIX})")
    for part in only:
        if not any(part in name for name in names):
            raise RbSimError(f"{part}: no case has it in its name; must be {one_of(part, names)}")
    wanted = [path for path in paths if not only or any(part in path.stem for part in only)]
    return [load_case(path) for path in wanted]


# What must be small in a case, written as a formula over the samples of a run.
#
# Expressions as those of sweeps. Names: t; for each body B: B_x B_y B_z, B_vx B_vy B_vz (centre of
# mass, world), B_wx B_wy B_wz (body axes), B_qx B_qy B_qz B_qw; for each reaction R: R_fx R_fy
# R_fz, R_tx R_ty R_tz; energy, kinetic, potential, residual; pi.


FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, name) for name in ("cosh", "sinh", "tanh", "hypot")},
    **{"atan": np.arctan, "max": np.maximum},
}
"""Besides those of expressions; max is that of two."""


def largest(formula: str, block: SampleBlock, layout: SampleLayout) -> float:
    """The largest size of the formula over the samples; infinite where it is not finite.

    Raises RbSimError for a formula that is not one, or that names what the run has not.
    """
    found = np.asarray(Expression(formula, "formula").value(columns(block, layout), FUNCTIONS))
    if found.dtype.kind not in "bif" or found.ndim > 1:
        raise RbSimError(f"formula {formula!r}: must be a number at each sample")
    return float(np.nan_to_num(abs(found.astype(float)), nan=np.inf, posinf=np.inf).max())


def columns(block: SampleBlock, layout: SampleLayout) -> dict[str, Any]:
    """The names a formula may use."""
    names: dict[str, Any] = {"t": block.t, "pi": np.pi, "residual": block.residual}
    names |= {"energy": block.energy, "kinetic": block.kinetic_energy}
    names["potential"] = block.potential_energy
    for i, body in enumerate(layout.bodies):
        names |= components(f"{body}_", block.position[:, i], "xyz")
        names |= components(f"{body}_v", block.linear_velocity[:, i], "xyz")
        names |= components(f"{body}_w", block.angular_velocity[:, i], "xyz")
        names |= components(f"{body}_q", block.orientation[:, i], "xyzw")
    for i, reaction in enumerate(layout.reactions):
        names |= components(f"{reaction}_f", block.reaction_force[:, i], "xyz")
        names |= components(f"{reaction}_t", block.reaction_torque[:, i], "xyz")
    return names


def components(start: str, values: Array, letters: str) -> dict[str, Array]:
    """Columns by name."""
    return {f"{start}{letter}": values[:, k] for k, letter in enumerate(letters)}


# Runs a case with each of its settings and measures what must hold.


HOLDS, FAILS, LIMIT = "holds", "FAILS", "limit"
"""Verdicts; limit: what is not held, and said so in the case."""

MOST_STEPS = 5e7
"""Steps between two samples beyond which a run is given up as one that does not advance."""


class Row(NamedTuple):
    """One line of the table."""

    case: str
    method: str
    knob: str
    """the step, or the tolerance."""
    check: str
    figure: float
    bound: float
    seconds: float
    """CPU time of the run."""
    verdict: str
    said: str
    """what an error or a check said, or ""."""

    @property
    def margin(self) -> float:
        """Bound over figure."""
        return self.bound / self.figure if self.figure > 0.0 else float("inf")


class Outcome(NamedTuple):
    """What one run gave."""

    run: Trajectory | None
    check_list: CheckList | None
    error: str
    seconds: float


def rows_of(case: Case) -> Iterator[Row]:
    """The rows of a case, as they are measured."""
    for setting in case.runs:
        outcome = run(case, setting)
        for check in case.checks:
            figure, said = measure(case, check, outcome)
            holds = figure <= check.bound
            verdict = HOLDS if holds else LIMIT if case.limit else FAILS
            knob = f"{setting.step:g} s" if setting.step is not None else f"{setting.tolerance:g}"
            yield Row(
                case.name, setting.method, knob, check.figure, figure, check.bound,
                outcome.seconds, verdict, said,
            )  # fmt: skip


def run(case: Case, setting: Setting) -> Outcome:
    """The case under one setting, watched."""
    from rb_sim.motion.pieces import Limits

    given = {
        name: value
        for name in ("method", "step", "tolerance", "duration")
        if (value := getattr(setting, name)) is not None
    }
    source: Any = find_scene(case.scene) if isinstance(case.scene, str) else case.scene
    began = time.process_time()
    check_list = blocks = None
    try:
        simulation = Simulation(load_scene(source, **given))
        simulation.warm()
        began = time.process_time()
        options = simulation.scene.simulation
        blocks = []
        check_list = CheckList(simulation.scene, simulation.layout, simulation.compiled)
        limits = Limits(steps=MOST_STEPS)
        with np.errstate(all="ignore"):
            for block in simulation.blocks(options.duration, options.rate, limits=limits):
                check_list.add(block, partial(effort_of, simulation))
                blocks.append(block)
        seconds = time.process_time() - began
    except (RbSimError, ZeroDivisionError) as error:
        # plain Python divides by zero where compiled code goes on with infinity, then NaN
        return Outcome(None, check_list, str(error) or "division", time.process_time() - began)
    from rb_sim.mechanics.samples import concatenate

    whole = concatenate(blocks, simulation.layout)
    return Outcome(Trajectory(whole, simulation.layout), check_list, "", seconds)


def measure(case: Case, check: Check, outcome: Outcome) -> tuple[float, str]:
    """(figure, what was said); infinite where the run did not come to its end."""
    findings = outcome.check_list.findings if outcome.check_list is not None else ()
    lines = [outcome.error] if outcome.error else [str(finding) for finding in findings]
    said = lines[0] if lines else ""
    if check.figure in ("warned", "refused"):
        spoken = lines if outcome.error or check.figure == "warned" else []
        found = [line for line in spoken if re.search(check.words, line)]
        return (0.0, found[0]) if found else (1.0, said)
    if outcome.run is None or outcome.check_list is None:
        return float("inf"), said
    return float(FIGURES[check.figure](case, check, outcome)), said


def _energy(case: Case, check: Check, outcome: Outcome) -> float:
    assert outcome.check_list is not None
    energy = outcome.check_list.ledger.energy()
    return 0.0 if energy is None else energy["relative"] or 0.0


def _momentum(case: Case, check: Check, outcome: Outcome) -> float:
    assert outcome.check_list is not None
    balances = outcome.check_list.ledger.momentum()
    return max((b["relative"] or 0.0 for b in (balances or {}).values()), default=float("inf"))


def _residual(case: Case, check: Check, outcome: Outcome) -> float:
    assert outcome.run is not None
    return float(outcome.run.residual.max())


def _formula(case: Case, check: Check, outcome: Outcome) -> float:
    assert outcome.run is not None
    return largest(check.formula, outcome.run.block, outcome.run.layout)


def _against(case: Case, check: Check, outcome: Outcome) -> float:
    """Largest pose difference [m, rad] to the run with another setting."""
    assert check.against is not None and outcome.run is not None
    other = run(case, check.against).run
    if other is None or len(other) != len(outcome.run):
        return float("inf")
    poses = (np.dstack([r.block.position, r.block.orientation]) for r in (outcome.run, other))
    return float(max(gap.max() for gap in pose_gaps(*poses)))


FIGURES: dict[str, Callable[[Case, Check, Outcome], float]] = {
    "energy": _energy,
    "momentum": _momentum,
    "residual": _residual,
    "formula": _formula,
    "against": _against,
}
