# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Entry point of the command `rb_sim`: a signal before a verb begins ends it in one line."""

from __future__ import annotations

import gc
import os
import sys

from rb_sim.simulation.signals import EARLY, deafen

YOUNG = 50_000
"""New objects between two collections: imports and the trace of laws make many, which stay."""


def main() -> None:
    """Load the verbs and hand over to them; leaves through sys.exit."""
    gc.set_threshold(YOUNG)
    # Before numpy is imported. OpenBLAS shares matrices of some forty rows among threads, which
    # takes longer than one thread does, and a sum in parts rounds otherwise on each machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with EARLY:
            try:
                from rb_sim.cli.main import main as run

                run()
            except Exception:  # old packages fail in any way: typer 0.9 with RuntimeError
                from rb_sim.base.installed import complaint

                if not (line := complaint()):
                    raise
                sys.exit(line)
    finally:
        deafen()
        gc.freeze()  # the end of the process would go through all that was imported


if __name__ == "__main__":
    main()
