"""What became of a toss: fine, or in one line what is wrong with it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.contact.shapes import depth_below, depth_in_round, size_of

DEEPEST = 1e-9
"""Overlap, in sizes of the body, that is none."""
GAINED = 1e-6
"""Energy, relative to that of the toss, that is none: what the default tolerance leaves."""


class TimeUpError(Exception):
    """A toss took longer than it may."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raises TimeUpError after `seconds` of CPU time; kernels are seen out first."""

    def up(*_: Any) -> None:
        raise TimeUpError

    before = signal.signal(signal.SIGVTALRM, up)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def judged(mapping: dict[str, Any], seconds: float) -> str:
    """What became of a toss: "fine", or what is wrong with it."""
    from rb_sim import Simulation, load_scene
    from rb_sim.errors import RbSimError

    try:
        with limited(seconds), np.errstate(all="ignore"):
            block = Simulation(load_scene(mapping)).run().block
    except TimeUpError:
        return f"endless: not done after {seconds:g} s of CPU"
    except RbSimError as error:
        text = str(error)
        return "unclear: " + repr(text) if "\n" in text else "refused: " + text
    except Exception as error:  # noqa: BLE001 (what is counted is that there is none)
        return f"traceback: {type(error).__name__}: {error}"
    return verdict(mapping, block)


def verdict(mapping: dict[str, Any], block: Any) -> str:
    """Of the samples."""
    contact, body = mapping["constraints"]["c"], mapping["bodies"]["b"]
    size = size_of(body["shape"])
    if "compliance" not in contact:
        deepest = float(block.residual.max())  # in lengths of the scene, at least the body's
        deepest = max(deepest, deepest_of(body["shape"], contact["surface"], block) / size)
        if not deepest <= DEEPEST:
            return f"overlaps: by {deepest:.2g} of its size"
        total = block.energy
    else:
        total = block.energy - block.contact_work  # the support stores some
    scale = float(block.kinetic_energy.max()) + body["mass"] * 9.81 * size
    gained = float((total - np.minimum.accumulate(total)).max()) / scale
    if not gained <= GAINED:
        return f"gains: {gained:.2g} of its energy"
    return "fine"


def deepest_of(shape: dict[str, Any], surface: dict[str, Any], block: Any) -> float:
    """Deepest overlap over all samples, from the poses alone [m]; -inf where only the gaps that the
    run reports tell it."""
    p, q = block.position[:, 0], block.orientation[:, 0]
    if surface["type"] == "plane":
        return float(depth_below(shape, p, q, surface.get("normal", [0.0, 0.0, 1.0])).max())
    if surface.get("side") == "inside":
        return float(depth_in_round(shape, p, q, surface).max())
    return -np.inf
