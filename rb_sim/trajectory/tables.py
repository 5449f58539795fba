# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A trajectory as tables: numpy archive, pandas DataFrame, xarray Dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.mechanics.samples import Array

if TYPE_CHECKING:
    from pathlib import Path

    from rb_sim.trajectory.record import Record


class Quantity(NamedTuple):
    """A field of a SampleBlock as it appears in tables. along: axis of the layout, or ""."""

    name: str
    field: str
    along: str
    components: tuple[str, ...]
    unit: str
    meaning: str


XYZ, QUATERNION, NONE = ("x", "y", "z"), ("x", "y", "z", "w"), ()
WRENCH = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")

QUANTITIES = (
    Quantity("position", "position", "body", XYZ, "m", "centre of mass, world"),
    Quantity("orientation", "orientation", "body", QUATERNION, "1", "quaternion, body to world"),
    Quantity(
        "linear_velocity", "linear_velocity", "body", XYZ, "m/s", "of the centre of mass, world"
    ),
    Quantity("angular_velocity", "angular_velocity", "body", XYZ, "rad/s", "body axes"),
    Quantity("reaction.force", "reaction_force", "reaction", XYZ, "N", "on the body, world axes"),
    Quantity("reaction.torque", "reaction_torque", "reaction", XYZ, "N m", "about the anchor"),
    Quantity("reaction.anchor", "anchor", "reaction", XYZ, "m", "anchor or contact point, world"),
    Quantity("command", "command", "commanded", WRENCH, "N, N m", "about the body origin, world"),
    Quantity("contact_state", "contact_state", "contact", NONE, "1", "0 open, 1 slip, 2 stick"),
    Quantity("momentum", "momentum", "", XYZ, "kg m/s", "total, world"),
    Quantity("angular_momentum", "angular_momentum", "", XYZ, "kg m^2/s", "about the world origin"),
    Quantity("kinetic_energy", "kinetic_energy", "", NONE, "J", "of all bodies"),
    Quantity("potential_energy", "potential_energy", "", NONE, "J", "of the conservative effects"),
    Quantity("energy", "energy", "", NONE, "J", "kinetic plus potential"),
    Quantity("power", "power", "", NONE, "W", "of the forces without potential"),
    Quantity("contact_work", "contact_work", "", NONE, "J", "of all contacts since the start"),
    Quantity("residual", "residual", "", NONE, "1", "of the scene's scale"),
)


ACCELERATIONS = (
    Quantity("linear_acceleration", "", "body", XYZ, "m/s^2", "of the centre of mass, world"),
    Quantity("angular_acceleration", "", "body", XYZ, "rad/s^2", "rate of w, body axes"),
)
"""Not in a block: found from it where they are asked for."""


def names_along(trajectory: Record, along: str) -> tuple[str, ...]:
    """Names on an axis of the layout: bodies, reactions, commanded, contacts."""
    layout = trajectory.layout
    axes = {
        "body": layout.bodies,
        "reaction": layout.reactions,
        "commanded": layout.commanded,
        "contact": layout.contacts,
    }
    return axes[along]


def save_npz(trajectory: Record, path: Path, accelerations: bool) -> None:
    """Write `npz_columns`; raises SinkError where that is not possible."""
    columns = npz_columns(trajectory, accelerations)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **columns)
    except OSError as error:
        raise SinkError(f"{path}: cannot be written: {error.strerror}") from None


def npz_columns(trajectory: Record, accelerations: bool = False) -> dict[str, Any]:
    """t, energy, residual, QUANTITY.NAME; with contacts their work and the events."""
    columns: dict[str, Any] = {
        "t": trajectory.t,
        "energy": trajectory.energy,
        "residual": trajectory.residual,
    }
    for quantity in ("position", "orientation", "linear_velocity", "angular_velocity"):
        for name, values in getattr(trajectory, quantity).items():
            columns[f"{quantity}.{name}"] = values
    if accelerations:
        columns |= {label: values for _, label, values in _accelerations(trajectory)}
    for name, reaction in trajectory.reaction.items():
        for part, values in reaction._asdict().items():
            columns[f"reaction.{name}.{part}"] = values
    for name, values in trajectory.contact_state.items():
        columns[f"contact_state.{name}"] = values
    if trajectory.layout.contacts:
        columns["contact_work"] = trajectory.contact_work
        for part in ("t", "contact", "kind", "impulse"):
            columns[f"events.{part}"] = np.array([getattr(e, part) for e in trajectory.events])
    return columns


def _accelerations(trajectory: Record) -> list[tuple[Quantity, str, Array]]:
    """(quantity, label, values of shape (n, 3)) of each body."""
    from rb_sim.trajectory.wrenches import accelerations

    found = accelerations(trajectory)
    return [
        (quantity, f"{quantity.name}.{name}", values[:, i])
        for quantity, values in zip(ACCELERATIONS, found, strict=True)
        for i, name in enumerate(trajectory.layout.bodies)
    ]


def to_pandas(trajectory: Record, accelerations: bool = False) -> Any:
    """One column per number: position.top.x, reaction.tip.force.z, energy."""
    pandas = _library("pandas", "a DataFrame")
    columns, units = numbers(trajectory, accelerations)
    frame = pandas.DataFrame(columns, index=pandas.Index(trajectory.t, name="t"))
    frame.attrs["units"] = units | {"t": "s"}
    return frame


def save_csv(trajectory: Record, path: Path, accelerations: bool) -> None:
    """t, then the columns of `to_pandas`, each number to its last bit; raises SinkError."""
    columns, _ = numbers(trajectory, accelerations)
    table = np.column_stack([trajectory.t, *columns.values()])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        head = ",".join(["t", *columns])
        np.savetxt(path, table, fmt="%.17g", delimiter=",", header=head, comments="")
    except OSError as error:
        raise SinkError(f"{path}: cannot be written: {error.strerror}") from None


def numbers(trajectory: Record, accelerations: bool) -> tuple[dict[str, Array], dict[str, str]]:
    """(column, unit) of every number, by QUANTITY.NAME.COMPONENT."""
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    shown = [(q, *named) for q in QUANTITIES for named in _named(trajectory, q)]
    for quantity, label, values in shown + (_accelerations(trajectory) if accelerations else []):
        names = quantity.components or ("",)
        for component, column in zip(names, np.atleast_2d(values.T), strict=True):
            key = f"{label}.{component}" if component else label
            columns[key] = column
            units[key] = quantity.unit
    return columns, units


def _named(trajectory: Record, quantity: Quantity) -> list[tuple[str, Array]]:
    """(label, values of shape (n,) or (n, components)) of each name that the quantity has."""
    values = getattr(trajectory.block, quantity.field)
    if not quantity.along:
        return [(quantity.name, values)]
    stem, _, part = quantity.name.partition(".")
    names = names_along(trajectory, quantity.along)
    ending = f".{part}" if part else ""
    return [(f"{stem}.{name}{ending}", values[:, i]) for i, name in enumerate(names)]


def to_xarray(trajectory: Record) -> Any:
    """Variables named as in pandas, dots as underscores, with units and meaning as attributes."""
    xarray = _library("xarray", "a Dataset")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"t": ("t", trajectory.t, {"units": "s"})}
    axes = {XYZ: "axis", QUATERNION: "quaternion", WRENCH: "wrench"}
    for quantity in QUANTITIES:
        dimensions = ["t"]
        if quantity.along:
            dimensions.append(quantity.along)
            coordinates[quantity.along] = list(names_along(trajectory, quantity.along))
        if quantity.components:
            dimensions.append(axes[quantity.components])
            coordinates[axes[quantity.components]] = list(quantity.components)
        attributes = {"units": quantity.unit, "long_name": quantity.meaning}
        values = getattr(trajectory.block, quantity.field)
        variables[quantity.name.replace(".", "_")] = (dimensions, values, attributes)
    return xarray.Dataset(variables, coords=coordinates)


def _library(name: str, purpose: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        raise MissingExtraError(name, "analysis", purpose) from None
