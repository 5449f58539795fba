"""How far a body reaches."""

from __future__ import annotations

from typing import Any

import numpy as np


def reach(shape: Any | None) -> float:
    """Distance from the shape's centre to its farthest point [m]; 0 for no shape."""
    if shape is None:
        return 0.0
    match shape.type:
        case "sphere" | "disk":
            return float(shape.radius)
        case "cylinder" | "rod":
            return float(np.hypot(shape.radius or 0.0, 0.5 * shape.length))
        case "box":
            return 0.5 * float(np.linalg.norm(shape.size))
        case _:
            return float(max(shape.semi_axes))
