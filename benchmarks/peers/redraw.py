"""Draws a scene's picture again from the table that was published.

    python -m benchmarks.peers.redraw docs/peers.md rolling_disk PICTURE.png

The table tells, for each error, the least cost that kept it: the fronts, without the other points.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from benchmarks.peers.plot import plot

BY_HAND = ("scipy", "heyoka")
"""Programs that integrate equations written by hand, not a model."""


def entry(text: str, scene: str) -> dict[str, Any]:
    """What `plot` takes, from the first table below the heading of the scene."""
    table = text.split(f"\n## {scene}\n\n")[1].split("\n\n")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in table.strip().splitlines()
    ]
    points = {
        name: [
            {"error": float(line[0]), "cost": float(line[k])} for line in rows[2:] if line[k] != "-"
        ]
        for k, name in enumerate(rows[0])
        if k
    }
    return {"engines": {name: {"points": found} for name, found in points.items() if found}}


def main() -> int:
    """Draw; returns the exit code."""
    table, scene, picture = sys.argv[1:]
    found = entry(Path(table).read_text(encoding="utf-8"), scene)
    kinds = {
        name: "rb_sim" if name == "rb_sim" else "equations" if name in BY_HAND else "engine"
        for name in found["engines"]
    }
    plot(scene, found, kinds, f"least cost for an error, from {table}", Path(picture))
    return 0


if __name__ == "__main__":
    sys.exit(main())
