# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Prescribed wrenches: constant, harmonic, tabulated over time, and commanded.

A wrench is a force at a point of the body (by default its origin) and a free torque; both are given
in world axes or in body axes, and those in body axes turn with the body.
"""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import model_validator

from rb_sim.catalogue.spec import (
    CHANGING,
    Angle,
    Changing,
    Finite,
    Name,
    Numbers,
    Place,
    Spec,
    Strength3,
    Strengths,
    Vec3,
    Vector3,
    refuse,
    refuse_at,
    wrench,
)
from rb_sim.numerics.vectors import ZERO, add, cross, rotate, scale, sin, unrotate

Axes = Literal["world", "body"]


class Wrench(Spec):
    """Constant wrench, plus an optional harmonic part."""

    type: Literal["wrench"]
    body: Name
    frame: Axes = "world"
    """axes in which the components are given."""
    point_B: Vector3 = ZERO
    """point of application of the force, from the body origin, body axes [m]."""
    force: Strength3 = ZERO
    """constant part of the force [N]."""
    torque: Strength3 = ZERO
    """constant part of the torque [N m]."""
    sine_force: Strength3 = ZERO
    """amplitude of the harmonic force [N]."""
    sine_torque: Strength3 = ZERO
    """amplitude of the harmonic torque [N m]."""
    angular_frequency: Finite = 0.0
    """angular frequency omega of the harmonic part [rad/s]."""
    phase: Angle = 0.0
    """phase of the harmonic part at t = 0 [rad]."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf F = \mathbf F_0 + \mathbf F_1 \sin(\Omega t + \phi) , \qquad
    \mathbf K = \mathbf K_0 + \mathbf K_1 \sin(\Omega t + \phi)
    $$

    `force` is $\mathbf F_0$, `sine_force` $\mathbf F_1$, `torque` $\mathbf K_0$, `sine_torque`
    $\mathbf K_1$. The force acts at `point_B`. In body axes both turn with the body.
    """

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """A row for the constant part and one for the harmonic part, each omitted if zero."""
        r_B = place.from_com(self.body, self.point_B)
        rows: list[NamedTuple] = []
        steady = WorldWrenchRow if self.frame == "world" else BodyWrenchRow
        harmonic = WorldHarmonicRow if self.frame == "world" else BodyHarmonicRow
        if self.force != ZERO or self.torque != ZERO:
            rows.append(steady(self.force, self.torque, r_B))
        if self.sine_force != ZERO or self.sine_torque != ZERO:
            rows.append(
                harmonic(self.sine_force, self.sine_torque, r_B, self.angular_frequency, self.phase)
            )
        return [(row, self.body, None) for row in rows]


class WrenchTable(Spec):
    """Wrench tabulated over time; zero before the first and after the last instant."""

    type: Literal["wrench_table"]
    body: Name
    frame: Axes = "world"
    """axes in which the components are given."""
    point_B: Vector3 = ZERO
    """point of application of the force, from the body origin, body axes [m]."""
    times: Numbers
    """increasing instants [s]."""
    forces: Strengths | None = None
    """force at each instant [N]."""
    torques: Strengths | None = None
    """torque at each instant [N m]."""
    interpolation: Literal["linear", "hold"] = "linear"
    """between two instants: linear, or held at the value of the earlier one."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf F(t) = \mathbf F_i + (\mathbf F_{i+1} - \mathbf F_i)\,\frac{t - t_i}{t_{i+1} - t_i} ,
    \qquad t_i \le t < t_{i+1}
    $$

    `interpolation: hold` keeps $\mathbf F_i$ over the interval. Torques likewise. The force acts at
    `point_B`. In body axes both turn with the body.
    """

    @model_validator(mode="after")
    def _shapes(self) -> WrenchTable:
        if any(later <= sooner for sooner, later in zip(self.times, self.times[1:], strict=False)):
            raise refuse_at((("times",), list(self.times), refuse("numbers that increase")))
        for key, rows in (("forces", self.forces), ("torques", self.torques)):
            if rows is not None and len(rows) != len(self.times):
                allowed = refuse(f"one row for each of the {len(self.times)} times")
                raise refuse_at(((key,), f"{len(rows)} rows", allowed))
        return self

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """One TableRow; omitted forces or torques are zero."""
        n = len(self.times)
        values = np.zeros((n, 6))
        values[:, :3] = self.forces or np.zeros((n, 3))
        values[:, 3:] = self.torques or np.zeros((n, 3))
        row = TableRow(
            np.array(self.times, dtype=float),
            values,
            place.from_com(self.body, self.point_B),
            self.frame == "world",
            self.interpolation == "hold",
        )
        return [(row, self.body, None)]

    def breakpoints(self) -> tuple[float, ...]:
        """Instants at which the law is not smooth [s]; no step crosses them."""
        return self.times


class CommandedWrench(Spec):
    """A wrench that a program commands while the simulation runs; zero until then."""

    type: Literal["commanded_wrench"]
    body: Name
    commandable: ClassVar[bool] = True

    EQUATION: ClassVar[str] = r"""
    $$
    (\mathbf F, \mathbf K) = \text{the last command}
    $$

    The force acts at the body origin; axes of the world or of the body.
    """

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """One CommandRow, initially zero; its forces act at the body's origin."""
        r_CO = place.from_com(self.body, ZERO)
        return [(CommandRow(ZERO, ZERO, ZERO, ZERO, r_CO), self.body, None)]


class WorldWrenchRow(NamedTuple):
    """Constant wrench in world axes, at the point r_B from the centre of mass."""

    force_W: Vec3
    torque_W: Vec3
    r_B: Vec3


class BodyWrenchRow(NamedTuple):
    """Constant wrench in body axes, at the point r_B from the centre of mass."""

    force_B: Vec3
    torque_B: Vec3
    r_B: Vec3


class WorldHarmonicRow(NamedTuple):
    """Harmonic wrench in world axes, at the point r_B from the centre of mass."""

    force_W: Vec3
    torque_W: Vec3
    r_B: Vec3
    angular_frequency: float
    phase: float


class BodyHarmonicRow(NamedTuple):
    """Harmonic wrench in body axes, at the point r_B from the centre of mass."""

    force_B: Vec3
    torque_B: Vec3
    r_B: Vec3
    angular_frequency: float
    phase: float


class TableRow(NamedTuple):
    """Wrench tabulated over time, linear between its instants or held, at the point r_B."""

    times: np.ndarray
    """instants [s], shape (n,)."""
    values: np.ndarray
    """[force, torque], shape (n, 6)."""
    r_B: Vec3
    in_world: bool
    hold: bool


class CommandRow(NamedTuple):
    """The last command: a wrench in world axes plus one in body axes, at the body origin."""

    force_W: Vec3
    torque_W: Vec3
    force_B: Vec3
    torque_B: Vec3
    r_B: Vec3
    """vector from the centre of mass to the body origin, body axes [m]."""


@wrench.register(WorldWrenchRow)
def world_wrench(row, t, body, B, A):
    """A constant force at r_B and a constant torque, both fixed in the world."""
    force_B = unrotate(B.q_WB, row.force_W)
    return row.force_W, add(unrotate(B.q_WB, row.torque_W), cross(row.r_B, force_B))


@wrench.register(BodyWrenchRow)
def body_wrench(row, t, body, B, A):
    """A constant force at r_B and a constant torque, both turning with the body."""
    return rotate(B.q_WB, row.force_B), add(row.torque_B, cross(row.r_B, row.force_B))


@wrench.register(WorldHarmonicRow)
def world_harmonic(row, t, body, B, A):
    """Force and torque fixed in the world, times sin(omega t + phase)."""
    s = sin(row.angular_frequency * t + row.phase)
    force = scale(s, row.force_W)
    torque = unrotate(B.q_WB, scale(s, row.torque_W))
    return force, add(torque, cross(row.r_B, unrotate(B.q_WB, force)))


@wrench.register(BodyHarmonicRow)
def body_harmonic(row, t, body, B, A):
    """Force and torque that turn with the body, times sin(omega t + phase)."""
    s = sin(row.angular_frequency * t + row.phase)
    force = scale(s, row.force_B)
    return rotate(B.q_WB, force), add(scale(s, row.torque_B), cross(row.r_B, force))


@wrench.register(TableRow)
def table_wrench(row, t, body, B, A):
    """The table at t: linear between instants, or held at the earlier one; zero outside."""
    n = row.times.shape[0]
    if t < row.times[0] or t > row.times[n - 1]:
        return ZERO, ZERO
    i = np.searchsorted(row.times, t, side="right") - 1
    j = min(i + 1, n - 1)
    s = 0.0
    if not row.hold and j > i:
        s = (t - row.times[i]) / (row.times[j] - row.times[i])
    a, b = row.values[i], row.values[j]
    force = (a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2]))
    torque = (a[3] + s * (b[3] - a[3]), a[4] + s * (b[4] - a[4]), a[5] + s * (b[5] - a[5]))
    if row.in_world:
        torque_B = add(unrotate(B.q_WB, torque), cross(row.r_B, unrotate(B.q_WB, force)))
        return force, torque_B
    return rotate(B.q_WB, force), add(torque, cross(row.r_B, force))


class SegmentRow(NamedTuple):
    """A table between two of its instants, as traced laws see it.

    Its constants stand in the same order as in TableRow, so that scenes with other values share a
    law.
    """

    span: tuple
    """begin and end of the interval [s]."""
    values: tuple
    """(force, torque) at begin and at end."""
    r_B: Vec3
    in_world: bool


@wrench.register(SegmentRow)
def segment_wrench(row, t, body, B, A):
    """The values at both ends of the segment, interpolated linearly at t."""
    begin, end = row.span
    s = (t - begin) / (end - begin)
    value = tuple(a + s * (b - a) for a, b in zip(*row.values, strict=True))
    force, torque = value[:3], value[3:]
    if row.in_world:
        torque_B = add(unrotate(B.q_WB, torque), cross(row.r_B, unrotate(B.q_WB, force)))
        return force, torque_B
    return rotate(B.q_WB, force), add(torque, cross(row.r_B, force))


def segment_at(row: TableRow, t: float, onwards: bool) -> tuple[float, ...]:
    """(begin, end, values at begin, values at end) of the table from t on; onwards: for steps that
    start at t, not for the instant t alone."""
    times, last = row.times, len(row.times) - 1
    nothing = (t, t + 1.0, *((0.0,) * 12))
    if t < times[0] or t > times[last] or (t == times[last] and onwards):
        return nothing
    i = min(int(np.searchsorted(times, t, side="right")) - 1, last)
    if i == last:
        return (t, t + 1.0, *row.values[i].tolist(), *row.values[i].tolist())
    end = row.values[i] if row.hold else row.values[i + 1]
    return (times[i], times[i + 1], *row.values[i].tolist(), *end.tolist())


def segment_of(row: TableRow, inputs: tuple) -> SegmentRow:
    """The row as a traced law takes it, from its inputs."""
    return SegmentRow(inputs[:2], (inputs[2:8], inputs[8:14]), row.r_B, row.in_world)


CHANGING[TableRow] = Changing(14, segment_at, segment_of)


@wrench.register(CommandRow)
def commanded(row, t, body, B, A):
    """The sum of the wrenches commanded in world axes and in body axes, taken about C."""
    force_B = add(unrotate(B.q_WB, row.force_W), row.force_B)
    force_W = add(row.force_W, rotate(B.q_WB, row.force_B))
    torque_B = add(unrotate(B.q_WB, row.torque_W), row.torque_B)
    return force_W, add(torque_B, cross(row.r_B, force_B))


def command_at(row: CommandRow, t: float, onwards: bool) -> tuple[float, ...]:
    """The 12 components of the command."""
    return (*row.force_W, *row.torque_W, *row.force_B, *row.torque_B)


def command_of(row: CommandRow, inputs: tuple) -> CommandRow:
    """The row as a traced law takes it, from its inputs."""
    return CommandRow(inputs[0:3], inputs[3:6], inputs[6:9], inputs[9:12], row.r_B)


CHANGING[CommandRow] = Changing(12, command_at, command_of)
