"""heyoka's compiled Taylor integrator on hand-written minimal equations: the speed limit."""

from __future__ import annotations

import heyoka
import numpy as np

from benchmarks.peers import equations
from benchmarks.peers.engine import Run, Samples, Way
from benchmarks.peers.scenes import Array, Scene

PACKAGE = "heyoka"
KIND = "equations"

_SYMBOLS = equations.Functions(heyoka.sin, heyoka.cos, heyoka.sqrt)


def ways(scene: Scene) -> list[Way]:
    """The Taylor method over its tolerance; its order grows as the tolerance shrinks."""
    ladder = tuple(10.0 ** (-0.5 * n) for n in range(2, 32))
    return [Way(f"Taylor/{form}", ladder) for form in equations.forms(scene)]


def build(scene: Scene, method: str, knob: float) -> Run:
    """Compile the integrator of the form named by `method` for tolerance `knob`."""
    return _Taylor(scene, method.split("/")[1], knob)


class _Taylor(Run):
    def __init__(self, scene: Scene, form: str, tolerance: float) -> None:
        self._equations = equations.forms(scene)[form]
        start = self._equations.start
        variables = heyoka.make_vars(*[f"y{n}" for n in range(len(start))])
        rates = self._equations.rates(heyoka.time, variables, _SYMBOLS)
        system = list(zip(variables, rates, strict=True))
        self._integrator = heyoka.taylor_adaptive(system, start, tol=tolerance)

    def start(self) -> None:
        self._integrator.time = 0.0
        self._integrator.state[:] = self._equations.start

    def advance(self, t: float) -> None:
        self._integrator.propagate_until(t)

    def pose(self) -> tuple[Array, Array]:
        t, y = np.array([self._integrator.time]), self._integrator.state[None]
        position, quaternion = self._equations.pose(t, y)
        return position[0], quaternion[0]

    def samples(self, times: Array) -> Samples:
        self.start()
        states = self._integrator.propagate_grid(times)[-1]
        return equations.samples(self._equations, times, states)
