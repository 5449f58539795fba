"""`python -m benchmarks.watches_of_command FILE DURATION`: one `rb_sim run`, and as JSON what its
watches cost of it, imports included [s of CPU time]; for `benchmarks.watches`."""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

METHODS = ("__init__", "add", "finish")
"""Of a WatchList, as a run calls them."""


def main() -> int:
    path, duration = sys.argv[1], float(sys.argv[2])
    # what a run imports for other ends than to watch it comes first
    from rb_sim import simulation  # noqa: F401
    from rb_sim.cli import compiling, outputs, summary  # noqa: F401
    from rb_sim.cli.run import RunOptions, run

    began = time.thread_time()
    from rb_sim.watches.watch_list import WatchList

    spent = [time.thread_time() - began]
    for name in METHODS:
        setattr(WatchList, name, timed(getattr(WatchList, name), spent))
    with contextlib.redirect_stdout(io.StringIO()):
        run(RunOptions(scene=Path(path).as_posix(), duration=duration, quiet=True))
    print(json.dumps({"whole": time.process_time(), "watches": sum(spent)}))
    return 0


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
