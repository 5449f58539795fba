"""Entry point of the command `rb_sim`: a signal before a verb begins ends it in one line."""

from __future__ import annotations

import gc
import sys

from rb_sim.simulation.signals import EARLY

YOUNG = 50_000
"""New objects between two collections: imports and the trace of laws make many, which stay."""


def main() -> None:
    """Load the verbs and hand over to them; leaves through sys.exit."""
    gc.set_threshold(YOUNG)
    try:
        with EARLY:
            try:
                from rb_sim.cli.main import main as run

                run()
            except (ImportError, AttributeError, TypeError):
                from rb_sim.base.installed import complaint

                if not (line := complaint()):
                    raise
                sys.exit(line)
    finally:
        gc.freeze()  # the end of the process would go through all that was imported


if __name__ == "__main__":
    main()
