# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table: the cheapest way of each engine to each decade of error."""

from __future__ import annotations

from typing import Any

DECADES = tuple(range(1, 13))

Results = dict[str, Any]


def cheapest(points: list[dict[str, Any]], error: float) -> dict[str, Any] | None:
    """The cheapest point with at most this error, or None."""
    good = [point for point in points if point["error"] is not None and point["error"] <= error]
    return min(good, key=lambda point: point["cost"]) if good else None


def front(points: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The points that no other point beats in both error and cost, by falling error."""
    kept: list[dict[str, Any]] = []
    finite = [point for point in points if point["error"] is not None]
    for point in sorted(finite, key=lambda point: (point["cost"], point["error"])):
        if not kept or point["error"] < kept[-1]["error"]:
            kept.append(point)
    return kept


def best_engine(engines: Results, kinds: dict[str, str], error: float) -> tuple[str, Any] | None:
    """Name and cheapest point of the best true engine, or None where none gets there."""
    found = [
        (name, cheapest(entry["points"], error))
        for name, entry in engines.items()
        if kinds[name] == "engine"
    ]
    reached = [(name, point) for name, point in found if point]
    return min(reached, key=lambda pair: pair[1]["cost"]) if reached else None


def ratios(results: Results) -> dict[str, dict[str, dict[str, float | None]]]:
    """Scene -> decade -> {"engine": cost of the best engine / rb_sim, "heyoka": heyoka / rb_sim}.

    None where one of the two does not reach the decade; empty without rb_sim.
    """
    table: dict[str, dict[str, dict[str, float | None]]] = {}
    for scene, entry in results["scenes"].items():
        engines = entry["engines"]
        if "rb_sim" not in engines:
            continue
        rows = table.setdefault(scene, {})
        for decade in DECADES:
            own = cheapest(engines["rb_sim"]["points"], 10.0**-decade)
            best = best_engine(engines, results["kinds"], 10.0**-decade)
            limit = cheapest(engines.get("heyoka", {"points": []})["points"], 10.0**-decade)
            rows[f"1e-{decade:02d}"] = {
                "engine": best[1]["cost"] / own["cost"] if best and own else None,
                "heyoka": limit["cost"] / own["cost"] if limit and own else None,
            }
    return table


def markdown(results: Results) -> str:
    """All tables as one text."""
    machine = results["machine"]
    versions = ", ".join(f"{n} {v}" for n, v in machine["versions"].items() if v)
    text = [
        "---",
        "search: {exclude: true}",
        "---",
        "",
        "# Error and CPU time compared with other programs",
        "",
        "Written by `python -m benchmarks.peers`.",
        "",
        f"{results['machine_line']}. {versions}.",
        "",
        "- **Cost**: CPU seconds per simulated second, stepping only, least of several measurements"
        " in one run on one machine. On other machines only the ratios hold. A dash: the error is"
        " not reached.",
        "- **Error**: the largest over the run of the rotation error [rad] and the error of the"
        " centre of mass [m].",
        "- **Not run from**: the step [s] or tolerance from which on a method was not run, because"
        " it would have exceeded the time budget of its program.",
        "- scipy and heyoka integrate equations written by hand for each scene; the others take a"
        " model.",
        "",
    ]
    for name in results["skipped"]:
        text.append(f"Not installed, not measured: {name}.")
    share = ratios(results)
    for scene, entry in results["scenes"].items():
        text += ["", f"## {scene}", "", *_costs(entry)]
        text += ["", *_least(results, entry, share.get(scene, {}))]
        text += ["", *_best(entry), *_notes(entry)]
    return "\n".join(text) + "\n"


def _costs(entry: Results) -> list[str]:
    """Cost of each program by error."""
    engines = entry["engines"]
    names = sorted(engines, key=lambda name: name == "rb_sim")  # last, the others as they came
    rows = []
    for decade in DECADES:
        found = (cheapest(engines[name]["points"], 10.0**-decade) for name in names)
        rows.append([f"1e-{decade:02d}", *map(_cost, found)])
    return _table(["error <=", *names], rows)


def _least(results: Results, entry: Results, share: dict[str, Any]) -> list[str]:
    """Which method was the cheapest, of the engines and of rb_sim, and how much cheaper."""
    engines, rows = entry["engines"], []
    for decade in DECADES:
        error = 10.0**-decade
        best = best_engine(engines, results["kinds"], error)
        row = [f"1e-{decade:02d}", f"{best[0]} {_way(best[1])}" if best else "none"]
        if share:
            own = cheapest(engines["rb_sim"]["points"], error)
            row += [_way(own) if own else "-"]
            row += [_ratio(share[row[0]][kind]) for kind in ("engine", "heyoka")]
        rows.append(row)
    more = ["rb_sim by", "engine/rb_sim", "heyoka/rb_sim"] if share else []
    return _table(["error <=", "best engine", *more], rows)


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(line) + " |" for line in lines]


def _best(entry: Results) -> list[str]:
    reached = []
    for name, engine in entry["engines"].items():
        errors = [point["error"] for point in engine["points"] if point["error"] is not None]
        reached.append(f"{name} {min(errors):.0e}" if errors else f"{name} none")
    return [f"Best error reached: {', '.join(reached)}."]


def _notes(entry: Results) -> list[str]:
    """One item per program; of the failures of a method only the first is quoted."""
    lines = []
    for name, engine in entry["engines"].items():
        kept: dict[str, str] = {}
        for note in engine["notes"]:
            kept.setdefault(note if ": not run from " in note else note.split(" ")[0], note)
        if kept:
            lines.append(f"- {name}: {'; '.join(kept.values())}.")
    return lines and ["", *lines]


def _way(point: dict[str, Any]) -> str:
    return f"{point['method']} {point['knob']:.0e}"


def _cost(point: dict[str, Any] | None) -> str:
    return f"{point['cost']:.1e}" if point else "-"


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2g}"
