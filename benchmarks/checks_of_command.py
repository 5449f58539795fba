# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`python -m benchmarks.checks_of_command FILE DURATION`: one `rb_sim run`, and as JSON what its
checks cost of it, and what the import of their modules does, which comes with the program
[s of CPU time]; for `benchmarks.checks`."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

METHODS = ("__init__", "add", "finish")
"""Of a CheckList, as a run calls them."""

MODULES = (
    "rb_sim.accuracy.checks",
    "rb_sim.accuracy.checks.step_doubling",
    "rb_sim.accuracy.checks.step_doubling",
)
"""Of the checks and what they ask."""


def main() -> int:
    path, duration = sys.argv[1], float(sys.argv[2])
    from rb_sim.accuracy.checks.check_list import CheckList
    from rb_sim.cli.verbs.run import RunOptions, run

    spent: list[float] = []
    for name in METHODS:
        setattr(CheckList, name, timed(getattr(CheckList, name), spent))
    with contextlib.redirect_stdout(io.StringIO()):
        run(RunOptions(scene=Path(path).as_posix(), duration=duration, quiet=True))
    whole = time.process_time()
    print(json.dumps({"whole": whole, "checks": sum(spent), "imports": imports()}))
    return 0


def imports() -> float:
    """CPU time [s] of importing the modules of the checks, of which all else is there already."""
    names = [name for name in sys.modules if name.startswith(MODULES)]
    for name in names:
        del sys.modules[name]
    began = time.thread_time()
    for name in names:
        importlib.import_module(name)
    return time.thread_time() - began


def timed(action: Callable[..., Any], spent: list[float]) -> Callable[..., Any]:
    """The action, which notes what each call takes."""

    def call(*args: Any, **names: Any) -> Any:
        began = time.thread_time()
        try:
            return action(*args, **names)
        finally:
            spent.append(time.thread_time() - began)

    return call


if __name__ == "__main__":
    sys.exit(main())
