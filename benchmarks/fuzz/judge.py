# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What became of one input: fine, refused in one line, or a find."""

from __future__ import annotations

import math
import signal
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.fuzz.newton_euler import broken_law
from rb_sim import load_scene
from rb_sim.accuracy.checks.check import effort_of
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.base.errors import RbSimError
from rb_sim.motion.motion import Forecast
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.yaml_reader import parse
from rb_sim.simulation.simulation import Simulation

SILENT = 3e-2
"""Relative error of the energy balance that no run may keep to itself; the widest bound of any
method is 2e-2."""


class Verdict(NamedTuple):
    """find: "" if all is well."""

    kind: str
    """ran, refused, told, ended, or what the find is."""
    find: str
    seconds: float


class OutOfTimeError(BaseException):
    """Not an Exception: nothing on the way may catch it."""


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Raise OutOfTimeError inside after so many seconds of processor time."""

    def late(number: int, frame: Any) -> None:
        raise OutOfTimeError

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def judged(action: Any, budget: float) -> Verdict:
    """The verdict of action() -> (kind, find)."""
    began = time.process_time()
    try:
        with within(budget), np.errstate(all="ignore"):
            kind, find = action()
    except RbSimError as error:
        text = str(error)
        find = "error of more than one line" if "\n" in text or not text else ""
        kind = "refused"
    except OutOfTimeError:
        kind, find = "hang", f"not done after {budget:g} s of processor time"
    except Exception:
        kind, find = "traceback", traceback.format_exc()
    return Verdict(kind, find, time.process_time() - began)


COMPILING = 20.0
"""Budgets that loops may take to compile; once for all scenes, and not the scene's own cost."""

FINER = (256.0, 32768.0)
"""Times the rate at which a balance that seems broken is drawn again: a damped spring that turns a
thin rod about its own axis at 3e5 rad/s needs the last."""

HOLDS = ("ran", ""), ("told", "")
"""What a run at a finer rate ends in whose balance holds, as far as no run may keep to itself."""

FIRST = 20
"""Samples of a damaged file's run."""


def of_file(text: str, budget: float) -> Verdict:
    """Read, validate and compile a scene file's text; run what can be run for some samples."""
    made: list[Simulation] = []

    def make() -> tuple[str, str]:
        scene = scene_from_mapping(parse(text, "file"))
        compile_scene(scene)
        made.append(Simulation(scene, announce=None))
        return "ran", ""

    verdict = judged(make, budget)
    return of_simulation(made[0], budget, FIRST) if made else verdict


def of_scene(mapping: dict[str, Any], budget: float) -> Verdict:
    """Run a scene to its end, watched, and balance it."""
    made: list[Simulation] = []

    def make() -> tuple[str, str]:
        made.append(Simulation(load_scene(mapping), announce=None))
        return "ran", ""

    verdict = judged(make, budget)
    if made:
        verdict = of_simulation(made[0], budget)
    if verdict.kind in ("ran", "told") and not verdict.find:
        lawful = judged(lambda: laws_hold(mapping), COMPILING * budget)
        return lawful if lawful.find else verdict
    return verdict


def laws_hold(mapping: dict[str, Any]) -> tuple[str, str]:
    """Whether Newton's and Euler's laws hold on a run of the scene."""
    broken = broken_law(mapping)
    return ("lawless", broken) if broken else ("ran", "")


def of_simulation(simulation: Simulation, budget: float, most: float = math.inf) -> Verdict:
    """Compile it, then run it, to so many samples at most."""

    def warm() -> tuple[str, str]:
        simulation.warm()
        return "ran", ""

    verdict = judged(warm, COMPILING * budget)
    if verdict.find or verdict.kind != "ran":
        return verdict
    return judged(lambda: run(simulation, budget, most), 2.0 * budget)


def run(simulation: Simulation, budget: float, most: float, finer: float = 1.0) -> tuple[str, str]:
    """A run to its end has finite samples; what it lost, it says; what takes too long, it says.

    finer: times the scene's rate of samples. Where a balance seems broken in silence, samples so
    much closer say whether it is: work is integrated over them.
    """
    check_list = CheckList(simulation.scene, simulation.layout)
    options = simulation.scene.simulation
    rate = finer * options.rate
    duration = min(options.duration, most / options.rate)
    # what still advances then takes long, and is no hang: that one is not asked any more
    forecast = Forecast(
        duration, effort=0.2 * budget, most=budget, wall=1.8 * budget, clock=time.process_time
    )
    finite = True
    for block in simulation.blocks(duration, rate, forecast.goes_on):
        check_list.add(block, partial(effort_of, simulation))
        columns = (block.position, block.linear_velocity, block.reaction_force, block.energy)
        finite &= all(bool(np.isfinite(column).all()) for column in columns)
    if forecast.given_up:
        return "too long", ""
    if check_list.findings:
        return "told", broken(check_list) if finer > 1.0 else ""
    if not finite:
        return "not finite", "samples that are not finite, and no word of it"
    if not simulation.layout.contacts and check_list.ledger.worst_residual > 1e-8:
        return "silent", f"residual {check_list.ledger.worst_residual:.2g} without a word"
    silent = broken(check_list)
    if silent and finer == 1.0 and resolves(simulation, budget, most):
        silent = ""
    return ("silent", silent) if silent else ("ran", "")


def resolves(simulation: Simulation, budget: float, most: float) -> bool:
    """Whether the balance holds between samples that are closer."""
    return any(run(fresh(simulation), budget, most, finer) in HOLDS for finer in FINER)


def fresh(simulation: Simulation) -> Simulation:
    """The same at its start."""
    simulation.reset()
    return simulation


def broken(check_list: CheckList) -> str:
    """By how much the energy balance is broken, in words; "" if it is not."""
    energy = check_list.ledger.energy()
    error = 0.0 if energy is None else energy["relative"] or 0.0
    uncertainty = 0.0 if energy is None else 30.0 * energy["quadrature"] / (energy["scale"] or 1.0)
    if error > SILENT + uncertainty:
        return f"energy balance broken by {error:.2g} without a word"
    return ""
