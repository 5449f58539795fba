"""Several runs at once on a GPU: the laws and loops of lanes, a thread a run, through CuPy."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from rb_sim.engine.cuda_source import program
from rb_sim.engine.lanes import Lanes, Runs
from rb_sim.engine.samples import Array
from rb_sim.graph.c_source import c_function

THREADS = 64
"""Of a block: a run keeps many numbers in registers, so that few fit."""

MOST_ATTEMPTS = 1 << 28
"""Steps tried of one run, after which it stays OPEN: a kernel cannot be asked to end."""

OPTIONS = ("--std=c++17", "--fmad=false")
"""No fused multiply-add: what the processor computes, up to the sines of CUDA's library."""


def why_not() -> str | None:
    """Why no GPU can be used here; None where one can."""
    try:
        cupy = import_module("cupy")
    except ImportError:
        return "CuPy is not installed; pip install 'rb_sim[cuda]'"
    try:
        count = cupy.cuda.runtime.getDeviceCount()
    except Exception as error:  # CuPy's own class, which needs CuPy to be named
        return f"CUDA finds no GPU ({error})".splitlines()[0]
    return None if count else "CUDA finds no GPU"


class CudaLanes(Lanes):
    """As Lanes, on the GPU that CuPy takes."""

    @cached_property
    def source(self) -> str | None:
        """The kernels in CUDA; None where runs cannot go together."""
        outputs = self.step_outputs()
        if outputs is None:
            return None
        step = c_function("step", outputs)
        sample = c_function("sample", self.sample_outputs())
        sizes = {"N": self.n, "M": self._given, "WIDTH": len(self.columns)}
        if step is None or sample is None:
            return None
        return program(step, sample, sizes, self.adaptive)

    @property
    def possible(self) -> bool:
        return self.source is not None

    @cached_property
    def _module(self) -> Any:
        return import_module("cupy").RawModule(code=self.source, options=OPTIONS)

    def run(
        self,
        starts: Array,
        given: Array,
        times: Array,
        goes_on: Callable[[], bool] = lambda: True,
    ) -> Runs:
        """As Lanes.run; `goes_on` is not asked: a run ends after MOST_ATTEMPTS."""
        cupy, runs, count = import_module("cupy"), len(starts), len(times)
        starts, given, times = (
            cupy.asarray(np.ascontiguousarray(x, dtype=float)) for x in (starts, given, times)
        )
        paths = cupy.zeros((runs, count, self.n))
        results = cupy.zeros((runs, 2), dtype=np.int64)
        setting = [float(getattr(self.method, name, 0.0)) for name in SETTINGS]
        arguments = (*setting, starts, given, times, paths, results)
        self._launch("carry", runs, (runs, count, MOST_ATTEMPTS, *arguments))
        out = cupy.zeros((runs, count, len(self.columns)))
        self._launch("samples", runs * count, (runs, count, paths, given, times, out))
        statuses, steps = cupy.asnumpy(results).T
        return Runs(cupy.asnumpy(out), statuses, steps)

    def _launch(self, name: str, threads: int, arguments: tuple[Any, ...]) -> None:
        numbers = tuple(np.int64(x) if isinstance(x, int) else x for x in arguments)
        blocks = -(-threads // THREADS)
        self._module.get_function(name)((blocks,), (THREADS,), numbers)


SETTINGS = ("step", "tolerance", "largest_step")
"""Of a method, in the order of the kernel's arguments; 0 where it has none."""
