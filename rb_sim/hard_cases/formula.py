"""What must be small in a case, written as a formula over the samples of a run.

Names: t; for each body B: B_x B_y B_z, B_vx B_vy B_vz (centre of mass, world), B_wx B_wy B_wz (body
axes), B_qx B_qy B_qz B_qw; for each reaction R: R_fx R_fy R_fz, R_tx R_ty R_tz; energy, kinetic,
potential, residual; pi.  Functions: FUNCTIONS.  Nothing else of Python is understood.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.errors import RbSimError

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout

FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "cosh", "sinh", "tanh")},
    **{name: getattr(np, name) for name in ("sqrt", "exp", "log", "abs", "hypot", "where")},
    **{"atan": np.arctan, "atan2": np.arctan2, "acos": np.arccos, "max": np.maximum},
}

OPERATIONS: dict[type, Any] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.USub: np.negative,
    ast.UAdd: np.positive,
    ast.Lt: np.less,
    ast.Gt: np.greater,
}


def largest(formula: str, block: SampleBlock, layout: SampleLayout) -> float:
    """The largest size of the formula over the samples; infinite where it is not finite.

    Raises RbSimError for a formula that is not one, or that names what the run has not.
    """
    names = columns(block, layout)
    try:
        tree = ast.parse(formula, mode="eval").body
    except SyntaxError as error:
        raise RbSimError(f"formula {formula!r}: {error.msg}") from None
    with np.errstate(all="ignore"):
        values = np.abs(np.asarray(value_of(tree, names, formula), dtype=float))
    return float(np.nan_to_num(values, nan=np.inf, posinf=np.inf).max())


def value_of(node: ast.AST, names: Mapping[str, Any], formula: str) -> Any:
    """The value of a part of the formula."""
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.UnaryOp(op=op, operand=operand) if type(op) in OPERATIONS:
            return OPERATIONS[type(op)](value_of(operand, names, formula))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATIONS:
            both = value_of(left, names, formula), value_of(right, names, formula)
            return OPERATIONS[type(op)](*both)
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in OPERATIONS:
            both = value_of(left, names, formula), value_of(right, names, formula)
            return OPERATIONS[type(op)](*both)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in FUNCTIONS:
            return FUNCTIONS[name](*(value_of(arg, names, formula) for arg in args))
    what = ast.unparse(node) if isinstance(node, ast.expr) else type(node).__name__
    raise RbSimError(f"formula {formula!r}: {what!r} is no name, number or function of a case")


def columns(block: SampleBlock, layout: SampleLayout) -> dict[str, Any]:
    """The names a formula may use."""
    names: dict[str, Any] = {"t": block.t, "pi": np.pi, "residual": block.residual}
    names |= {"energy": block.energy, "kinetic": block.kinetic_energy}
    names["potential"] = block.potential_energy
    for i, body in enumerate(layout.bodies):
        names |= components(f"{body}_", block.position[:, i], "xyz")
        names |= components(f"{body}_v", block.linear_velocity[:, i], "xyz")
        names |= components(f"{body}_w", block.angular_velocity[:, i], "xyz")
        names |= components(f"{body}_q", block.orientation[:, i], "xyzw")
    for i, reaction in enumerate(layout.reactions):
        names |= components(f"{reaction}_f", block.reaction_force[:, i], "xyz")
        names |= components(f"{reaction}_t", block.reaction_torque[:, i], "xyz")
    return names


def components(start: str, values: Array, letters: str) -> dict[str, Array]:
    """Columns by name."""
    return {f"{start}{letter}": values[:, k] for k, letter in enumerate(letters)}
