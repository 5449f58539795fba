"""Random tosses of bodies onto supports and each other: `python -m benchmarks.contact.tosses`.

Each toss follows from the seed and its number alone.  It is fine if the body never overlaps its
support by more than 1e-9 of its size (unless the support gives way), gains no energy, and the run
ends; a run that is refused has to say so in one line.  Depths below planes are found from the pose
alone, others from the gaps that the run reports.
"""

from __future__ import annotations

import argparse
import os
import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.contact.shapes import depth_below, size_of

DEEPEST = 1e-9
"""Overlap, in sizes of the body, that is none."""
GAINED = 1e-6
"""Energy, relative to that of the toss, that is none: what the default tolerance leaves."""
SUPPORTS = ("floor", "slope", "sphere", "bowl", "trough", "ball")
SHAPES = ("disk", "cylinder", "box", "rod", "ellipsoid", "ball")


class TimeUpError(Exception):
    """A toss took longer than it may."""


def unit(rng: np.random.Generator) -> list[float]:
    a = rng.normal(size=3)
    return (a / np.linalg.norm(a)).tolist()


def shape_of(name: str, rng: np.random.Generator) -> dict[str, Any]:
    r, length = rng.uniform(0.05, 0.15), rng.uniform(0.1, 0.4)
    if name == "ball":
        return {"type": "sphere", "radius": r}
    if name == "ellipsoid":
        return {"type": "ellipsoid", "semi_axes": rng.uniform(0.06, 0.14, 3).tolist()}
    if name == "box":
        return {"type": "box", "size": rng.uniform(0.08, 0.25, 3).tolist()}
    axis = {"axis_B": [0.0, 0.0, 1.0]}
    if name == "rod":
        return {"type": "rod", "length": length} | axis
    if name == "disk":
        return {"type": "disk", "radius": r} | axis
    return {"type": "cylinder", "radius": r, "length": length} | axis


def support_of(name: str, rng: np.random.Generator) -> tuple[dict[str, Any], list[float]]:
    """(surface, normal above which the body starts)."""
    if name == "slope":
        lean = rng.uniform(0.05, 0.4)
        normal = [float(np.sin(lean)), 0.0, float(np.cos(lean))]
        return {"type": "plane", "normal": normal}, normal
    if name == "sphere":
        return {"type": "sphere", "radius": 1.5, "center": [0.0, 0.0, -1.5]}, [0.0, 0.0, 1.0]
    if name == "bowl":
        centre = {"center": [0.0, 0.0, 3.0]}
        return {"type": "sphere", "radius": 3.0, "side": "inside"} | centre, [0.0, 0.0, 1.0]
    if name == "trough":
        axis = {"axis": [1.0, 0.0, 0.0], "point": [0.0, 0.0, 3.0]}
        return {"type": "cylinder", "radius": 3.0, "side": "inside"} | axis, [0.0, 0.0, 1.0]
    return {"type": "plane"}, [0.0, 0.0, 1.0]


def law_of(shape: str, support: str, rng: np.random.Generator) -> dict[str, Any]:
    law: dict[str, Any] = {}
    kind = rng.choice(["smooth", "coulomb", "two coefficients", "regularised"])
    mu = float(rng.uniform(0.05, 0.8))
    if kind == "coulomb":
        law["friction"] = {"type": "coulomb", "static": mu}
    elif kind == "two coefficients":
        law["friction"] = {"type": "coulomb", "static": mu, "kinetic": 0.8 * mu}
    elif kind == "regularised":
        law["friction"] = {"type": "regularised", "coefficient": mu, "speed": 0.05}
    if rng.random() < 0.2:
        damping = float(rng.choice([0.0, 20.0]))
        law["compliance"] = {"stiffness": float(rng.uniform(2e3, 2e4)), "damping": damping}
    elif rng.random() < 0.7:
        law["restitution"] = float(rng.uniform(0.0, 0.9))
    if shape == "disk" and support in ("floor", "slope") and "compliance" not in law:
        law["lies_flat"] = bool(rng.random() < 0.7)
    return law


def toss(seed: int, number: int, shapes: Any = SHAPES, supports: Any = SUPPORTS) -> dict[str, Any]:
    """The mapping of one toss."""
    rng = np.random.default_rng([seed, number])
    shape_name = str(shapes[rng.integers(len(shapes))])
    support = str(supports[rng.integers(len(supports))])
    shape = shape_of(shape_name, rng)
    surface, normal = support_of(support, rng)
    height = size_of(shape) * rng.uniform(1.05, 2.5)
    contact = {"type": "contact", "body": "b"} | law_of(shape_name, support, rng)
    bodies = {
        "b": {
            "mass": float(rng.uniform(0.2, 2.0)),
            "shape": shape,
            "position": (height * np.array(normal)).tolist(),
            "orientation": {"axis": unit(rng), "angle": float(rng.uniform(0.0, 3.1))},
            "linear_velocity": [*rng.normal(0.0, 0.7, 2).tolist(), float(rng.normal(0.0, 1.0))],
            "angular_velocity": (rng.uniform(0.0, 20.0) * np.array(unit(rng))).tolist(),
        }
    }
    if support == "ball":
        surface = {"type": "shape"}
        radius = float(rng.uniform(0.3, 0.6))
        below = {"shape": {"type": "sphere", "radius": radius}, "position": [0.0, 0.0, -radius]}
        bodies["a"] = {"mass": float(rng.uniform(1.0, 5.0))} | below
        contact["parent"] = "a"
    constraints = {"c": contact | {"surface": surface}}
    if support == "ball":
        floor = {"type": "plane", "point": [0.0, 0.0, -2.0 * bodies["a"]["shape"]["radius"]]}
        constraints["f"] = {"type": "contact", "body": "a", "surface": floor}
    return {
        "bodies": bodies,
        "constraints": constraints,
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 0.6, "rate": 500},
    }


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
        if contact["surface"]["type"] == "plane":
            normal = contact["surface"].get("normal", [0.0, 0.0, 1.0])
            p, q = block.position[:, 0], block.orientation[:, 0]
            deepest = max(deepest, float(depth_below(body["shape"], p, q, normal).max()) / size)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first toss")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="CPU time that a toss may take")
    parser.add_argument("--budget", type=float, default=float("inf"), help="CPU time of all [s]")
    parser.add_argument("--shapes", nargs="+", default=SHAPES, choices=SHAPES)
    parser.add_argument("--supports", nargs="+", default=SUPPORTS, choices=SUPPORTS)
    options = parser.parse_args()
    seen: Counter[str] = Counter()
    kernels = "interpreted" if os.environ.get("NUMBA_DISABLE_JIT") == "1" else "compiled"
    for number in range(options.first, options.first + options.count):
        if time.process_time() > options.budget:
            break
        mapping = toss(options.seed, number, options.shapes, options.supports)
        found = judged(mapping, options.seconds)
        kind = found.partition(":")[0]
        seen[kind] += 1
        if kind != "fine":
            shape, surface = mapping["bodies"]["b"]["shape"], mapping["constraints"]["c"]["surface"]
            print(f"{number} ({shape['type']} on {surface['type']}) {found}", flush=True)
    counts = ", ".join(f"{name} {n}" for name, n in seen.most_common())
    print(f"seed {options.seed}, {sum(seen.values())} tosses, {kernels}: {counts}")


if __name__ == "__main__":
    main()
