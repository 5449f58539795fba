"""The record of a run: named columns over time."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from rb_sim.engine.samples import Array, ContactEvent, SampleBlock, SampleLayout


class Reaction(NamedTuple):
    """Reaction BY the constraint ON the body, world axes."""

    force: Array
    """[N], shape (n, 3)."""
    torque: Array
    """about the anchor or contact point [N m], shape (n, 3)."""
    anchor: Array
    """that point, world [m], shape (n, 3)."""


class Trajectory:
    """Samples of a run by name. SI units, quaternions [x, y, z, w] body to world."""

    def __init__(self, block: SampleBlock, layout: SampleLayout) -> None:
        self.block = block
        self.layout = layout

    def __len__(self) -> int:
        return len(self.block)

    def _by_body(self, values: Array) -> Mapping[str, Array]:
        return {name: values[:, i] for i, name in enumerate(self.layout.bodies)}

    @property
    def t(self) -> Array:
        """Simulated time [s], shape (n,)."""
        return self.block.t

    @property
    def position(self) -> Mapping[str, Array]:
        """Centre of mass, world [m], shape (n, 3) each."""
        return self._by_body(self.block.position)

    @property
    def orientation(self) -> Mapping[str, Array]:
        """Unit quaternion [x, y, z, w], body to world, shape (n, 4) each."""
        return self._by_body(self.block.orientation)

    @property
    def linear_velocity(self) -> Mapping[str, Array]:
        """Of the centre of mass, world [m/s], shape (n, 3) each."""
        return self._by_body(self.block.linear_velocity)

    @property
    def angular_velocity(self) -> Mapping[str, Array]:
        """Body frame [rad/s], shape (n, 3) each."""
        return self._by_body(self.block.angular_velocity)

    @property
    def reaction(self) -> Mapping[str, Reaction]:
        """Reaction of each constraint; NAME/A and NAME/B are the bearings of a fixed axis."""
        b = self.block
        return {
            name: Reaction(b.reaction_force[:, i], b.reaction_torque[:, i], b.anchor[:, i])
            for i, name in enumerate(self.layout.reactions)
        }

    @property
    def contact_state(self) -> Mapping[str, Array]:
        """State of each point of contact: 0 open, 1 slip, 2 stick or roll, shape (n,) each."""
        return {name: self.block.contact_state[:, c] for c, name in enumerate(self.layout.contacts)}

    @property
    def contact_work(self) -> Array:
        """Work of all contacts since the start, impacts included [J], shape (n,)."""
        return self.block.contact_work

    @property
    def events(self) -> tuple[ContactEvent, ...]:
        """What happened to the contacts, in order of time."""
        return self.block.events

    @property
    def energy(self) -> Array:
        """Kinetic plus potential energy [J], shape (n,)."""
        return self.block.energy

    @property
    def residual(self) -> Array:
        """Worst violation of a constraint, relative to the scene's scale, shape (n,)."""
        return self.block.residual

    def to_npz(self, path: str | PathLike[str]) -> None:
        """Write all columns to a numpy archive: t, energy, residual and QUANTITY.NAME.

        With contacts also contact_work, and events.t, .contact, .kind and .impulse (one row each).
        """
        columns: dict[str, Any] = {"t": self.t, "energy": self.energy, "residual": self.residual}
        for quantity in ("position", "orientation", "linear_velocity", "angular_velocity"):
            for name, values in getattr(self, quantity).items():
                columns[f"{quantity}.{name}"] = values
        for name, reaction in self.reaction.items():
            for part, values in reaction._asdict().items():
                columns[f"reaction.{name}.{part}"] = values
        for name, values in self.contact_state.items():
            columns[f"contact_state.{name}"] = values
        if self.layout.contacts:
            columns["contact_work"] = self.contact_work
            for part in ("t", "contact", "kind", "impulse"):
                columns[f"events.{part}"] = np.array([getattr(e, part) for e in self.events])
        np.savez_compressed(path, **columns)
