# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Work-precision plot of one scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.peers.report import front
from rb_sim.base.palette import ENGINES, GREY


def plot(scene: str, entry: dict[str, Any], kinds: dict[str, str], title: str, path: Path) -> None:
    """Every point of every engine, and its front as a line; written to `path`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 5.5), layout="constrained")
    axes = figure.add_subplot()
    for name, engine in entry["engines"].items():
        points = [p for p in engine["points"] if p["error"] is not None and p["error"] < 10.0]
        if not points:
            continue
        colour = ENGINES.get(name, GREY)
        # an error of exactly zero cannot stand on a logarithmic axis
        errors = [max(p["error"], 1e-16) for p in points]
        axes.plot([p["cost"] for p in points], errors, ".", color=colour, alpha=0.35, ms=4)
        best = front(points)
        axes.plot(
            [p["cost"] for p in best],
            [max(p["error"], 1e-16) for p in best],
            color=colour,
            label=name,
            linewidth=2.6 if kinds[name] == "rb_sim" else 1.4,
            linestyle="--" if kinds[name] == "equations" else "-",
            marker="o",
            markersize=3.5,
        )
    axes.set(xscale="log", yscale="log", ylim=(1e-16, 3.0))
    # the axes of `rb_sim accuracy`, so that the two pictures can be laid side by side
    axes.set_xlabel("CPU seconds per simulated second")
    axes.set_ylabel("error: largest of rotation [rad] and position [m] over the run")
    axes.set_title(f"{scene}\n{title}", fontsize=9)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, title="dashed: equations\nwritten by hand", title_fontsize=7)
    figure.savefig(path, dpi=130)
