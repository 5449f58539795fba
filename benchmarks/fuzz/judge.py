"""What became of one input: fine, refused in one line, or a find."""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from rb_sim import load_scene
from rb_sim.errors import RbSimError
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.yaml_reader import parse
from rb_sim.simulation import Simulation
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.watch_list import WatchList

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


def of_file(text: str, budget: float) -> Verdict:
    """Read, validate and compile a scene file's text."""

    def action() -> tuple[str, str]:
        compile_scene(scene_from_mapping(parse(text, "file")))
        return "ran", ""

    return judged(action, budget)


def of_scene(mapping: dict[str, Any], budget: float) -> Verdict:
    """Run a scene to its end, watched, and balance it."""

    def action() -> tuple[str, str]:
        return run(Simulation(load_scene(mapping), announce=None))

    return judged(action, budget)


def run(simulation: Simulation) -> tuple[str, str]:
    """A run to its end has finite samples; what it lost, it says."""
    watches = WatchList(simulation.scene, simulation.layout)
    options = simulation.scene.simulation
    finite = True
    for block in simulation.blocks(options.duration, options.rate):
        watches.add(block, effort_of(simulation))
        columns = (block.position, block.linear_velocity, block.reaction_force, block.energy)
        finite &= all(bool(np.isfinite(column).all()) for column in columns)
    if watches.findings:
        return "told", ""
    if not finite:
        return "not finite", "samples that are not finite, and no word of it"
    energy = watches.ledger.energy()
    error = 0.0 if energy is None else energy["relative"] or 0.0
    doubt = 0.0 if energy is None else 30.0 * energy["quadrature"] / (energy["scale"] or 1.0)
    if error > SILENT + doubt:
        return "silent", f"energy balance broken by {error:.2g} without a word"
    if not simulation.layout.contacts and watches.ledger.worst_residual > 1e-8:
        return "silent", f"residual {watches.ledger.worst_residual:.2g} without a word"
    return "ran", ""
