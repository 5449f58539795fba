"""What the logs of a node say at their end about how the run went."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from signal import Signals

    from rb_sim.accuracy.choice import Choice
    from rb_sim.ros.command import Commands
    from rb_sim.ros.pacing import Pacer
    from rb_sim.ros.stepper import Stepper
    from rb_sim.ros.watch_sink import WatchSink


def summary_of(
    stepper: Stepper,
    commands: Commands,
    pacer: Pacer,
    watches: WatchSink,
    choice: Choice | None,
    cause: Signals | None,
    failure: str,
    dropped: int,
) -> dict[str, object]:
    """By name, as JSON takes it.

    choice: of method and step, if one was made. cause: the signal that ended the run. failure: why
    the motion could not go on, or "". dropped: samples that found the queue of the logs full.
    """
    return {
        "choice": None if choice is None else choice.as_dict(),
        "samples": stepper.samples + 1,
        "steps": stepper.steps,
        "duration": stepper.t,
        "commands_applied": commands.applied,
        "commands_refused": dict(commands.refused),
        "overruns": pacer.overruns,
        "slips": pacer.slips,
        "samples_dropped": dropped,
        "stopped_by": cause.name if cause else None,
        "error": failure or None,
        "warnings": [finding.as_dict() for finding in watches.look()],
    }
