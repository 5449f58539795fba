"""The inertia tensor as a scene gives it: three moments or a matrix, of a body that can exist."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Strict

from rb_sim.catalogue.spec import Vector3, refuse

Rows3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
INERTIA_SLACK = 1e-9
"""Relative round-off allowed in the symmetry and the triangle inequality of an inertia tensor."""
SMALLEST_INERTIA = 1e-150
"""[kg m^2]; below it products of moments underflow."""


def is_triple(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) == 3


def from_principal_moments(value: Any) -> Any:
    """[Ixx, Iyy, Izz] -> the diagonal 3x3; three rows of three pass; the rest is refused."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if is_triple(value):
        if all(is_triple(row) for row in value):
            return value
        if not any(isinstance(entry, (list, tuple)) for entry in value):
            a, b, c = value
            return ((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, c))
    raise refuse("3 principal moments [Ixx, Iyy, Izz] or 3 rows of 3 numbers")


@lru_cache(maxsize=256)  # in a sweep it is the same in most runs
def inertia_of_some_body(rows: Rows3) -> Rows3:
    """Refuse what is no inertia tensor; symmetrise what is one up to round-off.

    Some mass distribution has the tensor I if and only if its principal moments are positive and
    none exceeds the sum of the two others (equality: a plane body).
    """
    tensor = np.array(rows)
    scale = float(np.abs(tensor).max())
    if scale < SMALLEST_INERTIA:
        raise refuse("an inertia with three principal moments > 0")
    tensor /= scale
    if float(np.abs(tensor - tensor.T).max()) > INERTIA_SLACK:
        raise refuse("a symmetric inertia tensor")
    small, middle, large = (float(v) for v in np.linalg.eigvalsh(0.5 * (tensor + tensor.T)))
    if small <= 0.0:
        raise refuse(f"an inertia with three principal moments > 0, but one is {small * scale:.6g}")
    if large > (small + middle) * (1.0 + INERTIA_SLACK):
        raise refuse(
            "an inertia that some body can have: no principal moment above the sum of the others, "
            f"but {large * scale:.6g} > {small * scale:.6g} + {middle * scale:.6g}"
        )
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rows
    xy, yz, zx = (0.5 * xy + 0.5 * yx, 0.5 * yz + 0.5 * zy, 0.5 * zx + 0.5 * xz)
    return ((xx, xy, zx), (xy, yy, yz), (zx, yz, zz))


SymmetricInertia = Annotated[
    tuple[Vector3, Vector3, Vector3],
    Strict(False),
    AfterValidator(inertia_of_some_body),
    BeforeValidator(from_principal_moments),
]
"""Inertia tensor [kg m^2]: 3 principal moments on the body axes, or 3x3; kept as 3 rows."""
