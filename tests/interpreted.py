# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Run a function with the kernels as plain Python, in a process of its own.

The sources are the same. A step takes about a millisecond instead of a microsecond, so this is for
single kernels, which would be compiled for one call, and for what plain Python gives; whole runs
are `tests.runs`.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from typing import Any

from tests import runs

SWITCH = "RB_SIM_INTERPRETED"


@lru_cache(maxsize=1)
def _worker() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))


def interpreted(function: Callable[..., Any], *arguments: Any) -> Any:
    """function(*arguments) without the compiler; the function must be importable by its name."""
    if os.environ.get(SWITCH) == "1":
        return function(*arguments)
    os.environ[SWITCH] = "1"
    try:
        future = _worker().submit(function, *arguments)
    finally:
        del os.environ[SWITCH]
    return future.result()


def trajectory(scene: dict[str, Any], coordinates: str = "auto", **options: Any) -> Any:
    """The samples (a SampleBlock) of a run of a scene mapping, interpreted and unwatched."""
    return interpreted(_trajectory, scene, coordinates, options)


def _trajectory(scene: dict[str, Any], coordinates: str, options: dict[str, Any]) -> Any:
    return runs.trajectory(scene, coordinates, checks=False, **options)
