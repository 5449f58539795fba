"""`python -m benchmarks.heaps`: time of a step of heaps, rb_sim beside MuJoCo, in one run.

Each heap is stepped at 1 ms from its start for two seconds, in four parts; told are the CPU time
of a step in the first part (falling, settling) and the least of the others, how far the bodies
moved in the last half second, and of rb_sim how many steps its solver did not solve.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.heaps import scenes

STEP, PARTS, PART = 1e-3, 4, 500
HEAPS: dict[str, Callable[[], dict[str, Any]]] = {
    "10 piled spheres": scenes.piled_balls,
    "stack of 5 boxes": lambda: scenes.stack(5),
    "stack of 10 boxes": lambda: scenes.stack(10),
    "pyramid of 15 boxes": scenes.pyramid,
    "30 spheres in a bin": scenes.balls_in_bin,
    "10 dominoes": scenes.dominoes,
}


class OfRbSim:
    """A heap in rb_sim."""

    def __init__(self, mapping: dict[str, Any]) -> None:
        from rb_sim import Simulation, load_scene

        self.simulation = Simulation(load_scene(mapping))
        self.simulation.warm()
        self.simulation.reset()

    def run(self, steps: int) -> None:
        self.simulation.advance(steps * STEP)

    def places(self) -> np.ndarray:
        return np.array(list(self.simulation.state.position.values()))

    def note(self) -> str:
        return f"{self.simulation.unsolved_steps[0]} of {self.simulation.steps} unsolved"


class OfMuJoCo:
    """The same heap in MuJoCo, at its default solver and tolerance with elliptic cones."""

    def __init__(self, mapping: dict[str, Any]) -> None:
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(model_text(mapping))
        self.data = mujoco.MjData(self.model)
        start(self.data, mapping)

    def run(self, steps: int) -> None:
        self.mujoco.mj_step(self.model, self.data, steps)

    def places(self) -> np.ndarray:
        return self.data.xpos[1:].copy()

    def note(self) -> str:
        return ""


def model_text(mapping: dict[str, Any]) -> str:
    """The heap as MJCF: planes of the world once each, every body free; all pairs may touch."""
    planes, bodies, seen = [], [], set()
    for contact in mapping["constraints"].values():
        if "parent" in contact:
            continue
        surface = contact.get("surface", {})
        point, normal = surface.get("point", [0, 0, 0]), surface.get("normal", [0, 0, 1])
        if (key := (*point, *normal)) not in seen:
            seen.add(key)
            planes.append(
                f'<geom type="plane" size="5 5 1" pos="{words(point)}" zaxis="{words(normal)}"/>'
            )
    for name, body in mapping["bodies"].items():
        shape = body["shape"]
        size = [shape["radius"]] if shape["type"] == "sphere" else [0.5 * x for x in shape["size"]]
        bodies.append(
            f'<body name="{name}" pos="{words(body["position"])}"><freejoint/>'
            f'<geom type="{shape["type"]}" size="{words(size)}" mass="{body["mass"]}"/></body>'
        )
    return (
        f'<mujoco><option timestep="{STEP}" cone="elliptic" gravity="0 0 {-scenes.G}"/>'
        f'<default><geom friction="{scenes.MU} 0 0" condim="3"/></default>'
        f"<worldbody>{''.join(planes)}{''.join(bodies)}</worldbody></mujoco>"
    )


def words(values: Any) -> str:
    return " ".join(f"{value:.17g}" for value in values)


def start(data: Any, mapping: dict[str, Any]) -> None:
    """Initial velocities."""
    none = [0.0, 0.0, 0.0]
    for i, body in enumerate(mapping["bodies"].values()):
        data.qvel[6 * i : 6 * i + 3] = body.get("linear_velocity", none)
        data.qvel[6 * i + 3 : 6 * i + 6] = body.get("angular_velocity", none)


def measured(engine: Any) -> str:
    """One row of the table."""
    costs, before = [], engine.places()
    for _ in range(PARTS):
        before, began = engine.places(), time.process_time()
        engine.run(PART)
        costs.append(1e6 * (time.process_time() - began) / PART)
    moved = np.abs(engine.places() - before).max()
    return f"{costs[0]:8.1f} {min(costs[1:]):8.1f}   {moved:8.1e} m   {engine.note()}"


def main() -> None:
    print("us a step at first and at best later; moved in the last half second")
    for name, make in HEAPS.items():
        for engine in (OfRbSim, OfMuJoCo):
            print(f"{name:20s} {engine.__name__[2:]:8s} {measured(engine(make()))}", flush=True)


if __name__ == "__main__":
    main()
