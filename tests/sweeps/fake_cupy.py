"""What rb_sim takes of CuPy, on the processor: kernels are compiled by g++ and run in a loop."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

SHIM = """
#include <math.h>
#define __global__
#define __device__
struct Place { unsigned x; };
static Place blockIdx, blockDim, threadIdx;
extern "C" void place(unsigned block, unsigned threads, unsigned thread)
{ blockIdx.x = block; blockDim.x = threads; threadIdx.x = thread; }
"""
FLAGS = ("-O1", "-shared", "-fPIC", "-ffp-contract=off", "-std=c++17", "-Wall", "-Werror",
         "-Wno-unused-function", "-Wno-unused-variable", "-Wno-unused-parameter")  # fmt: skip


class Cupy:
    """Stands for the module; folder: for what g++ writes."""

    asarray, asnumpy, zeros = (
        staticmethod(f) for f in (np.ascontiguousarray, np.asarray, np.zeros)
    )

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.launched: list[str] = []

    def RawModule(self, code: str, options: tuple[str, ...]) -> Cupy:
        assert "--fmad=false" in options
        source, library = self._folder / "kernels.cpp", self._folder / "kernels.so"
        source.write_text(SHIM + code)
        subprocess.run(["g++", *FLAGS, str(source), "-o", str(library)], check=True)
        self._library = ctypes.CDLL(str(library))
        return self

    def get_function(self, name: str) -> Any:
        kernel, place = getattr(self._library, name), self._library.place

        def launch(grid: tuple[int], block: tuple[int], arguments: tuple[Any, ...]) -> None:
            self.launched.append(name)
            for b in range(grid[0]):
                for thread in range(block[0]):
                    place(b, block[0], thread)
                    kernel(*map(_as_c, arguments))

        return launch


def _as_c(x: Any) -> Any:
    """As CuPy passes it: arrays by address, numpy's integers as long long, floats as double."""
    if isinstance(x, np.ndarray):
        assert x.flags.c_contiguous
        return ctypes.c_void_p(x.ctypes.data)
    if isinstance(x, np.int64):
        return ctypes.c_longlong(int(x))
    assert isinstance(x, float)
    return ctypes.c_double(x)
