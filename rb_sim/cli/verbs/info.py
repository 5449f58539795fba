# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim info`: contents of a bag as a table or as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rb_sim.base.names import first_few
from rb_sim.base.plain_data import json_text
from rb_sim.cli.plain import columns, facts, plain_console, warn
from rb_sim.io.messages.topic_names import CONTACT_EVENTS, RESETS, STATE_COMMAND

DAMAGED = 1
"""Exit code for a damaged or unfinished bag."""
WHEN_IT_HAPPENS = (CONTACT_EVENTS, RESETS, STATE_COMMAND)
"""Last parts of event topics: they have no rate, and gaps between their messages mean nothing."""
SHOWN = 5
"""Most resets and gaps in the table; --json has all."""


def info(bag: Path, as_json: bool = False) -> int:
    """Print the contents of a bag; returns 0, or DAMAGED. Raises SinkError if it is not a bag."""
    from rb_sim.bags.info import info as read

    found = read(bag)
    if as_json:
        print(json_text(found))
    else:
        _print(found)
    warn(found["notes"] + found["health"]["damage"])
    return 0 if found["health"]["whole"] else DAMAGED


def _print(found: dict[str, Any]) -> None:
    console = plain_console(highlight=False)
    console.print(facts(lines(found)))
    heads = ("topic", "type", "messages", "rate [Hz]", "jitter [ms]", "gaps", "longest [s]")
    topics = [_topic(name, topic) for name, topic in found["topics"].items()]
    console.print(columns(heads, topics, names=("topic", "type"), folded=heads))


def lines(found: dict[str, Any]) -> list[tuple[str, str]]:
    """(label, text) of each row of the table."""
    files = f" in {found['files']} files" if found["files"] > 1 else ""
    size = f"{found['size'] / 1e6:.3g} MB{files}"
    rows = [("bag", f"{found['path']}: {found['messages']} messages, {size}")]
    rows.append(("written by", found["library"] or "unknown"))
    rows.append(("duration", f"{found['duration']:.9g} s"))
    rows += [] if found["run"] is None else _run(found["run"])
    if found["run"] is None:
        rows.append(("scene", "none: not recorded by rb_sim"))
    resets = found["resets"]
    if resets:
        shown = first_few([f"{t:g}" for t in resets], most=SHOWN)
        rows.append(("resets", f"{len(resets)}, at t = {shown} s"))
    for body, count in found["commands"].items():
        rows.append(("commands", f"{count} for {body.rpartition('/')[2]}"))
    rows.append(("health", _health(found["health"], found["messages"])))
    return rows


def _run(run: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [("scene", ": ".join(part for part in (run["scene"], run["description"]) if part))]
    rows.append(("bodies", ", ".join(run["bodies"])))
    for section in ("constraints", "effects"):
        named = ", ".join(f"{name} ({kind})" for name, kind in run[section].items())
        rows.append((section, named or "none"))
    rows.append(("method", _method(run)))
    options = run["simulation"]
    rows.append(("settings", f"{options['duration']:g} s at {options['rate']:g} samples a second"))
    settings = dict(run["settings"])
    by, given = settings.pop("by", "unknown"), settings.pop("options", {})
    settings |= {f"--{name}": value for name, value in given.items()}
    shown = ", ".join(f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
                     for name, value in settings.items())  # fmt: skip
    rows.append(
        ("run by", f"{'rb_sim node' if by == 'node' else by}{': ' + shown if shown else ''}")
    )
    rows.append(("versions", ", ".join(f"{k} {v}" for k, v in run["versions"].items()) or "?"))
    rows.append(("host", ", ".join(run["host"].values()) or "unknown"))
    refused = ", ".join(f"{count} {why}" for why, count in run["commands_refused"].items())
    if refused:
        rows.append(("refused commands", refused))
    if run["samples_dropped"]:
        lacking = f"{run['samples_dropped']} samples: the queue of the logs was full"
        rows.append(("is lacking", lacking))
    if run["outcome"]:
        rows.append(("outcome", str(run["outcome"])))
    return rows


def _method(run: dict[str, Any]) -> str:
    options = run["simulation"]
    text = options["method"]
    for key, unit in (("step", " s"), ("tolerance", "")):
        if options.get(key) is not None:
            text += f", {key} {options[key]:g}{unit}"
    choice = run["choice"]
    if choice:
        chosen = [str(choice["method"])]
        chosen += [f"{k} {choice[k]:g}" for k in ("step", "tolerance") if choice.get(k)]
        text += f"; it chose {', '.join(chosen)}"
    return text


def _health(health: dict[str, Any], messages: int) -> str:
    if not health["whole"]:
        if not health["finished"]:
            return "never finished (rb_sim recover)"
        if health["damage"]:
            return "not whole"
        return "cut: the run did not end, its log did (disk full, or a process was killed)"
    unchecked = health["messages_without_checksum"]
    if not unchecked:
        count = health["chunks"]
        return f"whole; {count} {'checksums are' if count != 1 else 'checksum is'} right"
    some = "any message" if unchecked == messages else f"{unchecked} of {messages} messages"
    return f"no damage found, but no checksum covers {some}"


def _topic(name: str, topic: dict[str, Any]) -> tuple[str, ...]:
    rate = "" if topic["rate"] is None else f"{topic['rate']:.6g}"
    happens = name.rpartition("/")[2] in WHEN_IT_HAPPENS
    back = f" ({topic['backwards']} back)" if topic["backwards"] else ""
    cells = (name, topic["type"].rpartition("/")[2], str(topic["count"]))
    if happens:
        return (*cells, "", "", back.strip())
    return (
        *cells,
        rate,
        f"{topic['jitter'] * 1e3:.3g}" if topic["jitter"] > 1e-9 else "0",
        f"{topic['gaps']}{back}",
        f"{topic['longest_gap']:.4g}",
    )
