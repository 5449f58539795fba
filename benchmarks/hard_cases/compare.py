# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A case on the other engines: each method over a ladder of steps, the best of it beside the bound.

The engines are judged by the same formulas and the same balance of energy, over samples at the same
instants; what they have no figure for (reactions, residuals, what is told) is left out.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from benchmarks.hard_cases.described import CannotExpressError, Described, described
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.base.errors import RbSimError
from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout, empty_block
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.listing import find_scene
from rb_sim.scene.load import load_scene
from rb_sim.scene.schema import Scene
from rb_sim.simulation.trajectory import Trajectory
from rb_sim.sweeps.hard_cases import Case, Check, Outcome, Row, measure, number

ENGINES = ("mujoco", "drake", "exudyn")

MOST_STEPS = 100_000
"""Steps of one run."""

FINER = (1, 4, 16, 64, 256, 1024)
"""Steps to a sample."""

BETTER = 0.5
"""Share of rb_sim's figure below which an engine's counts as better; up to 1/BETTER as equal."""


def judged_checks(case: Case, layout: SampleLayout) -> list[Check]:
    """The checks that the motion alone decides."""
    reactions = [f"{name}_{kind}" for name in layout.reactions for kind in ("f", "t")]
    return [
        check
        for check in case.checks
        if (check.figure == "formula" and not any(r in check.formula for r in reactions))
        or check.figure == "energy"
    ]


PEERS = """
## Compared with other engines

Made by `python -m benchmarks.hard_cases` in the same run: each engine with its best and its default
method (%s) at steps of a sample period down to 1/1024 of it; the row is the best step.
Judged by the same formulas, or by the energy of the states it gives; checks of reactions or
messages have no row, nor have cases with a part that an engine's description here lacks. *Better*
and *equal* compare the figure with rb_sim's own, which is only as accurate as its case needs.

| case | engine | figure | method | step [s] | is | bound | rb_sim | CPU [s] | verdict |
|---|---|---|---|---|---|---|---|---|---|
"""


class PeerRow(NamedTuple):
    """The best result of another engine for one check of a case."""

    case: str
    engine: str
    check: str
    method: str
    step: float
    figure: float
    bound: float
    ours: float
    """rb_sim's best figure."""
    seconds: float
    """CPU time of that run."""
    verdict: str


def table_of(peers: Sequence[PeerRow]) -> str:
    """The table of other engines; "" without rows."""
    if not peers:
        return ""
    engines = dict.fromkeys(row.engine for row in peers)
    lines = [
        f"| {row.case} | {row.engine} | {row.check} | {row.method} | {row.step:.2g} "
        f"| {number(row.figure)} | {row.bound:.2g} | {number(row.ours)} | {row.seconds:.2g} "
        f"| {row.verdict} |\n"
        for row in peers
    ]
    return PEERS % ", ".join(engines) + "".join(lines)


def rows_on_peers(case: Case, ours: Sequence[Row]) -> Iterator[PeerRow]:
    """The best of every engine for every check; none where the scene or the checks say nothing."""
    source: Any = find_scene(case.scene) if isinstance(case.scene, str) else case.scene
    try:
        scene = load_scene(source)
        layout = compile_scene(scene).layout
        description = described(scene)
    except RbSimError:
        return
    checks = judged_checks(case, layout)
    for engine in ENGINES if checks else ():
        yield from best_of(case, engine, scene, description, layout, checks, ours)


def best_of(
    case: Case, engine: str, scene: Scene, description: Described, layout: SampleLayout,
    checks: Sequence[Check], ours: Sequence[Row],
) -> Iterator[PeerRow]:  # fmt: skip
    """The rows of one engine."""
    module = loaded(engine)
    best: dict[int, PeerRow] = {}
    words = ""
    for method in module.METHODS:
        for step, every in ladder(scene):
            began = time.process_time()
            try:
                outcome = run(module, scene, description, layout, method, step, every)
            except CannotExpressError as error:
                words = f"cannot: {error}"
                break
            except Exception as error:  # an engine's own errors are of every kind
                words = f"fails: {str(error).strip().splitlines()[0][:80]}"
                continue
            seconds = time.process_time() - began
            for k, check in enumerate(checks):
                figure, _ = measure(case, check, outcome)
                if k in best and not figure < best[k].figure:
                    continue
                least = least_of(case, check, ours)
                verdict = said(figure, check.bound, least)
                best[k] = PeerRow(
                    case.name, engine, check.figure, method, step, figure, check.bound, least,
                    seconds, verdict,
                )  # fmt: skip
    yield from best.values()
    if not best:
        nothing = float("inf")
        yield PeerRow(case.name, engine, "", "", 0.0, nothing, checks[0].bound, 0.0, 0.0, words)


def least_of(case: Case, check: Check, ours: Sequence[Row]) -> float:
    """The least figure of rb_sim's rows for the check: every run has a row of each, in order."""
    own = ours[case.checks.index(check) :: len(case.checks)]
    return min((row.figure for row in own), default=float("inf"))


def said(figure: float, bound: float, ours: float) -> str:
    """Whether it holds the bound or by how much it fails, and how it stands beside rb_sim."""
    if not np.isfinite(figure):
        return "fails: not finite"
    word = "holds" if figure <= bound else f"fails by {figure / bound:.2g}"
    if figure < BETTER * ours:
        return f"{word}, better than rb_sim"
    return f"{word}, equal to rb_sim" if figure * BETTER <= ours else word


def ladder(scene: Scene) -> list[tuple[float, int]]:
    """(step [s], steps to a sample), from one step to a sample on."""
    options = scene.simulation
    samples = options.duration * options.rate
    finer = [k for k in FINER if samples * k <= MOST_STEPS] or [1]
    return [(1.0 / (options.rate * k), k) for k in finer]


def loaded(engine: str) -> Any:
    """The module that runs it. Raises RbSimError if the package is not installed."""
    try:
        return importlib.import_module(f"benchmarks.hard_cases.on_{engine}")
    except ImportError as error:
        raise RbSimError(
            f"{engine} cannot be imported ({error}); pip install 'rb_sim[peers]'"
        ) from None


def run(
    module: Any, scene: Scene, description: Described, layout: SampleLayout, method: str,
    step: float, every: int,
) -> Outcome:  # fmt: skip
    """The run as the judge takes rb_sim's own."""
    options = scene.simulation
    count = round(options.duration * options.rate) + 1
    with np.errstate(all="ignore"):
        rows = module.run(description, method, step, count, every)
        block = sampled(scene, description, layout, rows, np.arange(count) / options.rate)
        check_list = CheckList(scene, layout)
        check_list.ledger.add(block)
    return Outcome(Trajectory(block, layout), check_list, "", 0.0)


def sampled(
    scene: Scene, description: Described, layout: SampleLayout, rows: Array, t: Array
) -> SampleBlock:
    """The engine's rows as samples, with the energies that follow from them."""
    kinetic, potential = np.zeros(len(t)), np.zeros(len(t))
    for k, link in enumerate(description.links):
        place, velocity, spin = rows[:, k, :3], rows[:, k, 7:10], rows[:, k, 10:13]
        kinetic += 0.5 * link.body.mass * (velocity * velocity).sum(axis=1)
        kinetic += 0.5 * np.einsum("ni,ij,nj->n", spin, link.body.inertia, spin)
        potential -= link.body.mass * place @ description.gravity
    for at, spring in description.springs:
        if any(description.links[at].center) or spring.damping:
            potential[:] = np.nan  # the end is not the centre, or the energy is no balance alone
        stretch = np.linalg.norm(rows[:, at, :3] - np.array(spring.point_A), axis=1)
        potential += 0.5 * spring.stiffness * (stretch - spring.rest_length) ** 2
    return replace(
        empty_block(len(t), layout),
        t=t,
        position=rows[:, :, :3],
        orientation=rows[:, :, 3:7],
        linear_velocity=rows[:, :, 7:10],
        angular_velocity=rows[:, :, 10:13],
        kinetic_energy=kinetic,
        potential_energy=potential,
    )
