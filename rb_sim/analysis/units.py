"""Units of what an analysis tells, by the names of its columns."""

from __future__ import annotations

UNITS = {"x": "m", "y": "m", "z": "m", "vx": "m/s", "vy": "m/s", "vz": "m/s", "wx": "rad/s",
         "wy": "rad/s", "wz": "rad/s", "fx": "N", "fy": "N", "fz": "N", "tx": "N m", "ty": "N m",
         "tz": "N m", "ax": "m/s^2", "ay": "m/s^2", "az": "m/s^2", "Fx": "N", "Fy": "N", "Fz": "N",
         "Kx": "N m", "Ky": "N m", "Kz": "N m", "kinetic": "J", "Px": "N s", "Py": "N s",
         "Pz": "N s", "Lx": "N m s", "Ly": "N m s", "Lz": "N m s"}  # fmt: skip
SCALARS = {"energy": "J", "power": "W"}
"""Of the sources of a single number in bags of ours; those of others are topics, with a slash."""


def unit_of(source: str, column: str) -> str:
    """The unit of a column of a source, "" for a number without one or of an unknown one."""
    return SCALARS.get(source, "") if column == "value" else UNITS.get(column, "")
