# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Summary of a run, as numbers for summary.json and the logs, and as a table."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, NamedTuple

from rb_sim.accuracy.choice import listed
from rb_sim.base import __version__
from rb_sim.base.errors import RbSimError
from rb_sim.catalogue.constraints.joints import Free
from rb_sim.catalogue.contact import Touching
from rb_sim.contact.events.shares import undetermined_at_start
from rb_sim.contact.few_contacts import MOST_CONTACTS

if TYPE_CHECKING:
    from rb_sim.accuracy.checks.check_list import CheckList
    from rb_sim.base.errors import GlobalError
    from rb_sim.scene.schema import SimulationOptions
    from rb_sim.simulation.simulation import Simulation

SPELL = 0.02
"""Approximate wall-clock time of one measurement of the cost of a step [s]."""

REPEATS = 5
"""Number of measurements; the smallest one counts, as others include disturbances."""

SHOWN_RANGES = 6
"""Most redundant reactions in the table; summary.json has all."""

SHOWN_EVENTS = 5
"""Most contact events in the table; summary.json has some more."""


class Clocks(NamedTuple):
    """Times that a run took [s]."""

    integrating: float
    """CPU time of stepping and sampling, from which the real-time factor follows."""
    wall: float
    """wall-clock time from the first to the last step, including logging."""


def summarize(
    simulation: Simulation,
    check_list: CheckList,
    clocks: Clocks,
    outcome: str,
    error: GlobalError | None = None,
    *,
    timed: bool = True,
) -> dict[str, Any]:
    """The summary of a run: numbers, text, lists and dicts.

    outcome: "finished", "interrupted by ..." or the error. error: global error from the second run.
    timed: measure the CPU time of a step, which takes further steps. Resets the simulation.
    """
    scene, compiled, ledger = simulation.scene, simulation.compiled, check_list.ledger
    options = scene.simulation
    steps, rejected = simulation.steps, simulation.rejected_steps
    span = ledger.end or 0.0
    contacts = ledger.contacts()
    indeterminate = undetermined_at_start(compiled)
    return {
        "rb_sim": __version__,
        "scene": scene.name,
        "file": scene.file,
        "description": scene.description,
        "outcome": outcome,
        "duration": options.duration,
        "simulated": span,
        "rate": options.rate,
        "samples": ledger.samples,
        "method": options.method,
        "step": options.step,
        "tolerance": options.tolerance,
        "choice": None if simulation.choice is None else simulation.choice.as_dict(),
        "coordinates": "reduced" if compiled.reduced else "maximal",
        "degrees_of_freedom": compiled.degrees_of_freedom,
        "constraint_rows": compiled.rows,
        "indeterminate_reactions": list(indeterminate),
        "ranges_at_start": _ranges_at_start(simulation) if indeterminate else {},
        "steps": steps,
        "rejected_steps": rejected,
        "global_error": None if error is None else error.as_dict(),
        "nanoseconds_per_step": (
            nanoseconds_per_step(simulation, span, clocks.integrating) if timed else None
        ),
        "processor_time": clocks.integrating,
        "wall_time": clocks.wall,
        "real_time_factor": span / clocks.integrating if clocks.integrating > 0.0 else None,
        "energy": ledger.energy(),
        "momentum": ledger.momentum(),
        "momentum_not_balanced_because_of": ledger.unknown_force or None,
        "worst_residual": ledger.worst_residual,
        "warnings": [finding.as_dict() for finding in check_list.findings],
        **({} if contacts is None else {"contacts": contacts | _law_of_impacts(options)}),
        **({"load_distribution": ONE_OF_SEVERAL} if is_heap(simulation) else {}),
    }


ONE_OF_SEVERAL = "one of the admissible distributions"
"""Loads of the contacts of a heap that the laws leave open."""


def is_heap(simulation: Simulation) -> bool:
    """Whether time stepping does not look for the least of the loads that the laws leave open: of
    bodies that touch each other without joints, or at many points."""
    scene = simulation.scene
    if scene.simulation.method != "time_stepping":
        return False
    touching = [spec for spec in scene.constraints.values() if isinstance(spec, Touching)]
    joined = any(not isinstance(s, (Touching, Free)) for s in scene.constraints.values())
    each_other = any(s.parent is not None or getattr(s, "between", None) for s in touching)
    many = len(simulation.compiled.contact_laws) > MOST_CONTACTS
    return each_other and (many or not joined)


MOST_RANGED = 8
"""Most contact points for which a summary has ranges: each takes a dozen optimisations."""


def _ranges_at_start(simulation: Simulation) -> dict[str, dict[str, list[float]]]:
    """[min, max] of each component that is not unique, by reaction; infinite: unbounded.

    Empty for many contacts, or if no contact state is known. Resets the simulation.
    """
    from rb_sim.simulation.reaction_ranges import reaction_ranges

    if len(simulation.layout.contacts) > MOST_RANGED:
        return {}
    simulation.reset()
    try:
        found = reaction_ranges(simulation.sample(), 0)
    except RbSimError:
        return {}
    return {name: span.undetermined for name, span in found.items() if span.undetermined}


def _law_of_impacts(options: SimulationOptions) -> dict[str, str]:
    """The law of simultaneous impacts; empty for time stepping, which has no impact times."""
    return {} if options.method == "time_stepping" else {"impacts_at_once": options.impacts}


def nanoseconds_per_step(simulation: Simulation, span: float, integrating: float) -> float | None:
    """CPU time of one step [ns], rejected attempts included, sampling excluded; None without steps.

    Measured by repeating the beginning of the run. span: simulated time of the run [s];
    integrating: its CPU time [s]. With contacts, whose events may be frequent at the beginning, the
    mean of the whole run, events and samples included.
    """
    if not span > 0.0:
        return None
    tried = simulation.steps + simulation.rejected_steps
    if not tried:
        return None
    if simulation.compiled.contact_laws:
        return 1e9 * integrating / tried
    piece = span * min(1.0, SPELL / max(integrating, 1e-9))
    calls, runs = [], []
    for _ in range(REPEATS):
        simulation.reset()
        calls.append(_cost_of_advance(simulation, 0.0))
        runs.append(_cost_of_advance(simulation, piece))
    tried = simulation.steps + simulation.rejected_steps
    return max(min(runs) - min(calls), 0) / tried or None if tried else None


def _cost_of_advance(simulation: Simulation, duration: float) -> int:
    """CPU time of one call of `advance` [ns]."""
    began = time.thread_time_ns()
    simulation.advance(duration)
    return time.thread_time_ns() - began


def lines(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """(label, text) of each row of the table. Warnings are printed after it, on stderr."""
    energy, momentum = summary["energy"], summary["momentum"]
    rows = [("scene", _joined(summary["scene"], summary["description"], ": "))]
    rows += [
        ("simulated", _simulated(summary)),
        ("method", _method(summary)),
        ("steps", _steps(summary)),
        ("samples", f"{summary['samples']} at {summary['rate']:g} Hz"),
    ]
    rows += _errors(summary)
    if energy is not None:
        rows.append(("energy error", _balance(energy, "J")))
    if momentum is not None:
        rows.append(("momentum error", _balance(momentum["linear"], "N s")))
        rows.append(("angular momentum error", _balance(momentum["angular"], "N m s")))
    elif summary["samples"]:
        rows.append(("momentum error", f"not known: {_why_no_momentum(summary)}"))
    rows += _contacts(summary.get("contacts"))
    rows.append(("constraint violation", f"{summary['worst_residual']:.2g} (relative)"))
    if summary["choice"] is not None and summary["choice"]["errors"]:
        rows.append(("global error by auto", listed(summary["choice"]["errors"])))
    certificate = summary.get("certificate") or {"text": []}
    rows += list(zip(("certified", "", "", ""), certificate["text"], strict=False))
    if summary["indeterminate_reactions"]:
        rows.append(
            (
                "redundant constraints",
                _indeterminate(summary),
            )
        )
    if "load_distribution" in summary:
        rows.append(("load distribution", f"{summary['load_distribution']} if it is not unique"))
    return rows


def _errors(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Row of the global error, if it was measured."""
    error = summary["global_error"]
    return [] if error is None else [("global error", error["text"])]


def _why_no_momentum(summary: dict[str, Any]) -> str:
    cause = summary["momentum_not_balanced_because_of"]
    if "contacts" in summary:
        return f"the samples do not contain the whole impulse of {cause}"
    return f"the samples do not contain the force of {cause}"


def _contacts(contacts: dict[str, Any] | None) -> list[tuple[str, str]]:
    """Rows of work, impulses and events of contacts, if there are any."""
    if contacts is None:
        return []
    rows = [("work of contacts", f"{contacts['work']:.6g} J")]
    for name, impulse in contacts["impulses"].items():
        vector = ", ".join(f"{component:.4g}" for component in impulse)
        rows.append(("impact impulse", f"({vector}) N s by {name}"))
    if "impacts_at_once" in contacts:
        law = contacts["impacts_at_once"].replace("_", " ")
        rows.append(("simultaneous impacts", f"{law} (simulation.impacts)"))
    counts = contacts["events"]
    by_kind = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    rows.append(("contact events", by_kind or "none"))
    rows += [("", _event(event)) for event in contacts["first_events"][:SHOWN_EVENTS]]
    if sum(counts.values()) > SHOWN_EVENTS:
        rows.append(("", "..."))
    return rows


def _event(event: dict[str, Any]) -> str:
    strength = math.hypot(*event["impulse"])
    struck = f" ({strength:.4g} N s)" if strength else ""
    return f"t = {event['t']:.9g} s: {event['contact']} {event['kind']}{struck}"


def _joined(first: str, second: str, by: str) -> str:
    return by.join(part for part in (first, second) if part)


def _simulated(summary: dict[str, Any]) -> str:
    factor = summary["real_time_factor"]
    times = "" if factor is None else f" ({factor:.3g} times real time)"
    logged = f"{summary['wall_time']:.3g} s wall-clock time with logging"
    return (
        f"{summary['simulated']:g} s in {summary['processor_time']:.3g} s CPU time{times}, {logged}"
    )


def _method(summary: dict[str, Any]) -> str:
    choice = summary["choice"]
    if choice is not None:
        return f"auto: {_method({**choice, 'choice': None})} ({choice['reason']})"
    if summary["step"] is not None:
        return f"{summary['method']}, step {summary['step']:g} s"
    return f"{summary['method']}, tolerance {summary['tolerance']:g}"


def _steps(summary: dict[str, Any]) -> str:
    rejected, cost = summary["rejected_steps"], summary["nanoseconds_per_step"]
    text = str(summary["steps"])
    if rejected:
        text += f" and {rejected} rejected"
    with_what = " with events and samples" if "contacts" in summary else ""
    return text if cost is None else f"{text}, {cost:.3g} ns each{with_what}"


def _balance(balance: dict[str, Any], unit: str) -> str:
    text = f"{balance['error']:.2g} {unit}"
    if balance["relative"] is not None:
        text += f" (relative {balance['relative']:.2g})"
    if balance["quadrature"] > 0.1 * abs(balance["error"]):
        text += f", sampling error {balance['quadrature']:.2g} {unit}"
    return text


def _indeterminate(summary: dict[str, Any]) -> str:
    """Redundant reactions, each with its components that are not unique and their bounds."""
    names, ranges = summary["indeterminate_reactions"], summary["ranges_at_start"]
    reported = "" if "load_distribution" in summary else ": minimum-norm reactions reported"
    shown = [f"{name} ({_spans(ranges[name])})" if name in ranges else name for name in names]
    more = f" and {len(shown) - SHOWN_RANGES} more" if len(shown) > SHOWN_RANGES else ""
    return f"{', '.join(shown[:SHOWN_RANGES])}{more}{reported}"


def _spans(components: dict[str, list[float]]) -> str:
    free = [key for key, span in components.items() if not any(map(math.isfinite, span))]
    texts = [f"{', '.join(free)} not unique"] if free else []
    for key, (low, high) in components.items():
        if key not in free:
            unit = "N m" if key.startswith("torque") else "N"
            texts.append(f"{key} {low:.4g} to {high:.4g} {unit}")
    return ", ".join(texts)
