# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Expressions for outputs, such as `max(norm(reaction.tip.force))` or `last(position.coin.z)`.

An expression is parsed by Python's grammar and evaluated on the samples of a run; only arithmetic
nodes and listed functions are allowed, so it cannot access anything else.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.base.names import one_of
from rb_sim.simulation.trajectory import QUANTITIES, Trajectory

MOST_CHARACTERS = 1000
"""Maximum length of an expression; Python's parser could overflow its stack on longer ones."""

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.Mod: np.mod,
}
_UNARY: dict[type, Callable[[Any], Any]] = {
    ast.USub: np.negative,
    ast.UAdd: np.positive,
    ast.Not: np.logical_not,
}
_COMPARE: dict[type, Callable[[Any, Any], Any]] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
}


def one_a_sample(x: Any) -> Any:
    """The values over time unchanged. Raises ValueError if each is a vector, since the maximum or
    mean over all components would be meaningless.
    """
    if np.ndim(x) > 1:
        raise ValueError("these are vectors; must be numbers: name a component (.x) or take norm()")
    return x


def _over_time(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def reduced(*arguments: Any) -> Any:
        if len(arguments) != 1:
            raise ValueError(f"got {len(arguments)} arguments; must be one: a list of several")
        return function(one_a_sample(arguments[0]))

    return reduced


def _norm(x: Any) -> Any:
    """Norm of a vector, or of the vector at each sample."""
    if np.shape(x)[-1:] in ((), (1,)):
        raise ValueError("norm() takes vectors; must be abs() of a number")
    return np.sqrt(np.sum(np.square(1.0 * np.asarray(x)), axis=-1))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "min": _over_time(np.min),
    "max": _over_time(np.max),
    "mean": _over_time(np.mean),
    "std": _over_time(np.std),
    "rms": _over_time(lambda x: np.sqrt(np.mean(np.square(x)))),
    "first": lambda x: np.asarray(x)[0],
    "last": lambda x: np.asarray(x)[-1],
    "norm": _norm,
    "abs": np.abs,
    "sign": np.sign,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan2": np.arctan2,
    "any": _over_time(np.any),
    "all": _over_time(np.all),
    "where": np.where,
    "sum": _over_time(np.sum),
}
"""Functions allowed in every expression; `functions` adds those that need the samples of a run."""

NAMES = {"pi": np.pi}

POINTWISE = ("abs", "sign", "sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan2")
"""Functions whose value at a sample depends only on that sample."""


def _pointwise(node: ast.AST) -> bool:
    """Whether the value at a sample depends only on that sample."""
    match node:
        case ast.Constant() | ast.Name() | ast.operator() | ast.unaryop() | ast.cmpop():
            return True
        case ast.BinOp() | ast.UnaryOp() | ast.Compare():
            return all(_pointwise(x) for x in ast.iter_child_nodes(node))
        case ast.Attribute(value=inner):
            return _pointwise(inner)
        case ast.Subscript(value=inner, slice=ast.Constant(value=str())):
            return _pointwise(inner)
        case ast.Call(func=ast.Name(id=name), args=arguments) if name in POINTWISE:
            return all(_pointwise(x) for x in arguments)
    return False


class Expression:
    """A parsed and validated expression.

    text: as written. key: its place in the plan, for messages. Raises RbSimError if it is not an
    expression or contains disallowed parts.
    """

    def __init__(self, text: str, key: str) -> None:
        self.text, self.key = text, key
        if len(text) > MOST_CHARACTERS:
            raise self._refuse(f"is longer than {MOST_CHARACTERS} characters")
        try:
            self._tree = ast.parse(text, mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise self._refuse("must be an expression like max(energy)") from None

    def value(self, names: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
        """The value for these names (arrays, numbers, or objects and mappings of them).

        Raises RbSimError for unknown names or functions, or wrong arguments.
        """
        known = {**FUNCTIONS, **functions}
        try:
            with np.errstate(all="ignore"):
                return self._of(self._tree, {**NAMES, **names}, known)
        except RbSimError:
            raise
        except (TypeError, ValueError, IndexError, KeyError, ArithmeticError) as error:
            raise self._refuse(f"cannot be evaluated: {error}") from None

    @property
    def names(self) -> set[str]:
        """Names used in the expression, without functions."""
        called = {id(x.func) for x in ast.walk(self._tree) if isinstance(x, ast.Call)}
        found = [x for x in ast.walk(self._tree) if isinstance(x, ast.Name)]
        return {x.id for x in found if id(x) not in called}

    def of_ends(self, numbers: Iterable[str]) -> bool:
        """Whether only first and last sample matter. numbers: names that are not samples."""
        known = {*numbers, *NAMES}

        def holds(node: ast.AST) -> bool:
            match node:
                case ast.Call(func=ast.Name(id="first" | "last"), args=[inner]):
                    return _pointwise(inner)
                case ast.Call(func=ast.Name(), args=arguments):
                    return all(holds(x) for x in arguments)
                case ast.Name(id=name):
                    return name in known
            return all(holds(x) for x in ast.iter_child_nodes(node))

        return holds(self._tree)

    def _refuse(self, why: str) -> RbSimError:
        return RbSimError(f"{self.key}: got {self.text[:80]!r}; {why}")

    def _of(self, node: ast.expr, names: Mapping[str, Any], functions: Mapping[str, Any]) -> Any:
        """The value of one node."""

        def of(x: ast.expr) -> Any:
            return self._of(x, names, functions)

        match node:
            case ast.Constant(value=bool() | int() | float() | str() as value):
                return float(value) if isinstance(value, int) and abs(value) < 2**53 else value
            case ast.Name(id=name):
                return self._named(names, name)
            case ast.Attribute(value=inner, attr=name):
                return self._named(of(inner), name)
            case ast.Subscript(value=inner, slice=index):
                return self._indexed(of(inner), of(index))
            case ast.BinOp(left=a, op=op, right=b) if type(op) in _BINARY:
                return _BINARY[type(op)](of(a), of(b))
            case ast.UnaryOp(op=op, operand=a) if type(op) in _UNARY:
                return _UNARY[type(op)](of(a))
            case ast.BoolOp(op=ast.And(), values=values):
                return np.logical_and.reduce([of(v) for v in values])
            case ast.BoolOp(op=ast.Or(), values=values):
                return np.logical_or.reduce([of(v) for v in values])
            case ast.Compare(left=a, ops=[op], comparators=[b]) if type(op) in _COMPARE:
                return _COMPARE[type(op)](of(a), of(b))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                if name not in functions:
                    raise self._refuse(f"the function must be {one_of(name, functions)}")
                return functions[name](*(of(a) for a in arguments))
            case ast.List(elts=elements) | ast.Tuple(elts=elements):
                values = [of(e) for e in elements]
                rows = any(isinstance(e, (ast.List, ast.Tuple)) for e in elements)
                if rows or not values:
                    return values
                return np.stack(np.broadcast_arrays(*values), axis=-1)
        raise self._refuse(f"{ast.unparse(node)[:40]!r} is not allowed in an expression")

    def _named(self, names: Any, name: str) -> Any:
        """The entry `name` of a mapping; for an array x, y, z, w are its components."""
        if isinstance(names, Mapping):
            if name not in names:
                raise self._refuse(f"{name!r} must be {one_of(name, names)}")
            return names[name]
        size = np.shape(names)[-1] if np.ndim(names) else 1
        components = "xyzw"[:size] if size > 1 else ""  # size 1: a number over time
        if len(name) != 1 or name not in components:
            allowed = one_of(name, components) if components else "omitted: it is a number"
            raise self._refuse(f"{name!r} must be {allowed}")
        return np.asarray(names)[..., components.index(name)]

    def _indexed(self, value: Any, index: Any) -> Any:
        """The entry with a string index; a number could mean component or sample."""
        if isinstance(index, str):
            return self._named(value, index)
        allowed = "must be a name: components are .x, .y, .z, the ends of a run first() and last()"
        raise self._refuse(f"the index {index!r} {allowed}")


# Names and functions of an output expression for a run.


BY_BODY = tuple(q.name for q in QUANTITIES if q.along == "body")
WHOLE_RUN = ("t", *(q.name for q in QUANTITIES if not q.along and not q.components))
MAPPINGS = ("reaction", "contact_state")
"""Names that are followed by the name of a constraint."""

EVENT_KINDS = (
    *("ambiguous", "closes", "impact", "jams", "leaps", "opens", "rests", "reverses", "rolls"),
    *("slack", "slips", "spins", "sticks", "stops rolling", "stops spinning", "taut"),
)
"""Kinds of contact events (see rb_sim.contact.event_workspace)."""

COMPONENTS = {q.name: (q.components, q.unit) for q in QUANTITIES if q.name in BY_BODY}
"""Components and unit of each body quantity."""


def names(run: Trajectory) -> dict[str, Any]:
    """Arrays over time by name: of the run, and by body, reaction and contact."""
    columns: dict[str, Any] = {name: getattr(run.block, name) for name in WHOLE_RUN}
    if not run.layout.contacts:
        del columns["contact_work"]
    columns |= {name: dict(getattr(run, name)) for name in BY_BODY}
    columns["reaction"] = {name: reaction._asdict() for name, reaction in run.reaction.items()}
    if run.layout.contacts:
        columns["contact_state"] = dict(run.contact_state)
    return columns


def functions(run: Trajectory) -> dict[str, Callable[..., Any]]:
    """Functions of an expression that need the samples of this run."""

    def times(contact: str, kind: str) -> np.ndarray:
        """Times of the events of that kind at that contact [s]."""
        _known(contact, run.layout.contacts, "contact")
        _known(kind, EVENT_KINDS, "kind of event")
        return np.array([e.t for e in run.events if e.contact == contact and e.kind == kind])

    def event_time(contact: str, kind: str, number: float = 1.0) -> float:
        """Time of the event with that number, counted from 1 [s]; NaN if there is none."""
        if not (number >= 1 and number == int(number)):
            raise ValueError(f"got the number {number:g}; must be a whole number >= 1")
        found = times(contact, kind)
        i = int(number) - 1
        return float(found[i]) if 0 <= i < len(found) else float("nan")

    def event_count(contact: str, kind: str) -> float:
        return float(len(times(contact, kind)))

    def integral(x: Any) -> Any:
        """Integral over time, by the trapezoidal rule."""
        x = one_a_sample(1.0 * np.asarray(x))
        return np.sum(0.5 * (x[1:] + x[:-1]) * np.diff(run.t))

    def time_of(condition: Any) -> float:
        """Time of the first sample at which the condition holds [s]; NaN if there is none."""
        found = np.flatnonzero(one_a_sample(np.asarray(condition)))
        return float(run.t[found[0]]) if len(found) else float("nan")

    return {
        "event_time": event_time,
        "event_count": event_count,
        "integral": integral,
        "time_of": time_of,
    }


def _known(name: str, allowed: tuple[str, ...], what: str) -> None:
    if not allowed:
        raise ValueError(f"got the {what} {name!r}; the scene has none")
    if name not in allowed:
        raise ValueError(f"got the {what} {name!r}; must be {one_of(name, allowed)}")


def final_state(run: Trajectory) -> dict[str, float]:
    """Components of the last sample of every body, by `quantity.body.component`."""
    state = {}
    for quantity in BY_BODY:
        by_body: Mapping[str, Any] = getattr(run, quantity)
        for body, values in by_body.items():
            for i, component in enumerate(COMPONENTS[quantity][0]):
                state[f"{quantity}.{body}.{component}"] = float(values[-1, i])
    return state


def final_units(bodies: tuple[str, ...]) -> dict[str, str]:
    """Columns of `final_state` with their units, in the same order."""
    return {
        f"{quantity}.{body}.{component}": unit
        for quantity, (components, unit) in COMPONENTS.items()
        for body in bodies
        for component in components
    }
