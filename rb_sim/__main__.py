"""Entry point of the command `rb_sim`: a signal before a verb begins ends it in one line."""

from __future__ import annotations

from rb_sim.cli.signals import EARLY


def main() -> None:
    """Load the verbs and hand over to them; leaves through sys.exit."""
    with EARLY:
        from rb_sim.cli.main import main as run

        run()


if __name__ == "__main__":
    main()
