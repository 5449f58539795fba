# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Compiled packing of all messages of a sample into one buffer.

A message of fixed layout is a template with numbers to fill in. The templates of all topics are
concatenated with aligned doubles, so that the numbers of one or many samples are copied at once,
without Python code per field.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from rb_sim.io.messages.cdr import HEADER, NANO, Codec
from rb_sim.io.messages.topic_names import NAMESPACE
from rb_sim.mechanics.samples import (
    block_of,
    empty_block,
    row_width,
    rows_of,
)
from rb_sim.numerics.kernels import entry

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout


# Compiled kernels.


def pack_row(
    row, command, centers, linear, energy, source, numbers, chosen, doubles, stamps, whole, rest
):
    """Fill `source` from a sample row and the commands, then the doubles of the messages from it.

    row: sample as the kernel writes it, shape (width,). command: world axes, shape (6 M,). centers:
    r_OC, shape (N, 3). linear: (from, to) of numbers copied unchanged, shape (L, 2): from >= 0 is
    an index of the row, -1 - from one of the command. energy: columns of the total and its two
    parts. source: columns as in `columns_of`. numbers, chosen: indices of the doubles, and the
    source columns copied there. stamps: indices of the seconds in the buffer as 32-bit integers;
    `whole` [s] is written there and `rest` [ns] behind it.

    The results equal those of rb_sim.numerics.rotations to the last bit.
    """
    bodies = len(centers)
    p, v, w = 2, 2 + 7 * bodies, 2 + 10 * bodies
    q = 2 + 3 * bodies
    moved = False
    for k in range(bodies):
        for i in range(3):
            moved = moved or centers[k, i] != 0.0
    for k in range(bodies):
        at = 13 * k
        x, y, z, s = row[at + 3], row[at + 4], row[at + 5], row[at + 6]
        scale = 2.0 / (((x * x + y * y) + z * z) + s * s)
        a, b, c = row[at + 10], row[at + 11], row[at + 12]
        tx, ty, tz = scale * (y * c - z * b), scale * (z * a - x * c), scale * (x * b - y * a)
        wx = (a + s * tx) + (y * tz - z * ty)
        wy = (b + s * ty) + (z * tx - x * tz)
        wz = (c + s * tz) + (x * ty - y * tx)
        rx = ry = rz = 0.0
        for i in range(3):
            source[p + 3 * k + i] = row[at + i]
            source[v + 3 * k + i] = row[at + 7 + i]
        if moved:
            a, b, c = centers[k, 0], centers[k, 1], centers[k, 2]
            tx, ty, tz = scale * (y * c - z * b), scale * (z * a - x * c), scale * (x * b - y * a)
            rx = (a + s * tx) + (y * tz - z * ty)
            ry = (b + s * ty) + (z * tx - x * tz)
            rz = (c + s * tz) + (x * ty - y * tx)
            source[p + 3 * k] -= rx
            source[p + 3 * k + 1] -= ry
            source[p + 3 * k + 2] -= rz
            source[v + 3 * k] -= wy * rz - wz * ry
            source[v + 3 * k + 1] -= wz * rx - wx * rz
            source[v + 3 * k + 2] -= wx * ry - wy * rx
        source[w + 3 * k] = wx
        source[w + 3 * k + 1] = wy
        source[w + 3 * k + 2] = wz
        for i in range(4):
            source[q + 4 * k + i] = row[at + 3 + i]
    for i in range(len(linear)):
        come = linear[i, 0]
        source[linear[i, 1]] = row[come] if come >= 0 else command[-1 - come]
    source[energy[0]] = source[energy[1]] + source[energy[2]]
    for i in range(len(numbers)):
        doubles[numbers[i]] = source[chosen[i]]
    integers = doubles.view(np.int32)
    for i in range(len(stamps)):
        integers[stamps[i]] = whole
        integers[stamps[i] + 1] = rest


@entry
def pack_rows(
    rows, commands, centers, linear, energy, source, numbers, chosen, doubles, stamps, times
):
    """Apply pack_row to each row: doubles (n, size), times (seconds, rest) (n, 2)."""
    for k in range(len(rows)):
        pack_row(
            rows[k],
            commands[k],
            centers,
            linear,
            energy,
            source,
            numbers,
            chosen,
            doubles[k],
            stamps,
            times[k, 0],
            times[k, 1],
        )


def stamps_of(block: SampleBlock) -> NDArray[Any]:
    """Stamps of the samples [ns], shape (n,)."""
    return np.rint(block.t * NANO).astype(np.int64)


class MessageTable(Protocol):
    """Messages of every sample that are not in the table of topics."""

    latched: bool

    @property
    def topics(self) -> Sequence[tuple[str, str]]:
        """(name, ROS type) of each topic."""
        ...

    def rows(self, block: SampleBlock) -> list[NDArray[np.uint8]]:
        """Messages of the next samples as bytes, an array of shape (n, length) for each topic."""
        ...


CONSTANTS = (0.0, 1.0)
"""First columns of the source: constants in messages."""
NO_ROTATION = (0, 0, 0, 1)
"""Columns of the identity quaternion."""
FIELDS = (
    "reaction_force",
    "reaction_torque",
    "anchor",
    "command",
    "kinetic_energy",
    "potential_energy",
    "power",
    "residual",
    "contact_work",
)
"""Fields of a block in the source, after the motion of the body origins and the energy."""


class Topic(NamedTuple):
    """One topic.

    name: relative to the node's name, or absolute with a leading slash. columns: source column of
    each double in its messages (see `columns_of`).
    """

    name: str
    ros_type: str
    codec: Codec
    columns: Sequence[int] = ()

    def full_name(self, namespace: str = NAMESPACE) -> str:
        """Absolute topic name for a node named `namespace`."""
        return self.name if self.name.startswith("/") else f"{namespace}/{self.name}"


def columns_of(layout: SampleLayout) -> SimpleNamespace:
    """Columns of the source: `position`, `velocity` and `spin` (N, 3), world axes, and
    `orientation` (N, 4) of the body frames, `energy`, and the FIELDS of a block."""
    block, n = empty_block(1, layout), len(layout.bodies)
    shapes = {"position": (n, 3), "orientation": (n, 4), "velocity": (n, 3), "spin": (n, 3)}
    shapes |= {"energy": (1,)} | {name: getattr(block, name).shape[1:] or (1,) for name in FIELDS}
    found, column = SimpleNamespace(), len(CONSTANTS)
    for name, shape in shapes.items():
        size = prod(shape)
        setattr(found, name, np.arange(column, column + size).reshape(shape))
        column += size
    return found


class Packer:
    """Packs messages of `topics`. center_of_mass: r_OC of each body, body axes, (N, 3) [m]."""

    def __init__(
        self, topics: Sequence[Topic], layout: SampleLayout, center_of_mass: Array
    ) -> None:
        self._center_of_mass = center_of_mass
        self.bounds: list[tuple[int, int]] = []
        numbers: list[NDArray[Any]] = []
        octets, stamps, template = [], [], bytearray()
        for topic in topics:
            start = _aligned(len(template))
            template += bytes(start - len(template)) + topic.codec.template
            self.bounds.append((start, len(template)))
            stamps += [start + offset for offset in topic.codec.stamps]
            for offset, kind, length in topic.codec.numbers:
                if kind == "d":
                    numbers.append((start + offset) // 8 + np.arange(length))
                else:
                    octets.append(start + offset)
        template += bytes(-len(template) % 8)
        self._template = np.frombuffer(bytes(template), dtype=np.uint8)
        self._numbers = np.concatenate([np.empty(0, dtype=np.intp), *numbers])
        self._octets = np.array(octets, dtype=np.intp)
        self._seconds = np.array(stamps, dtype=np.intp) // 4
        columns = [topic.columns for topic in topics]
        self._source = np.concatenate([np.empty(0), *columns]).astype(np.intp)
        self._linear, self._energy = _linear(layout)
        self._columns = np.zeros(int(self._linear[:, 1].max()) + 1)
        self._columns[: len(CONSTANTS)] = CONSTANTS
        self._states = row_width(layout) - len(layout.contacts)

    def pack_rows(self, rows: Array, commands: Array, stamps: Sequence[int]) -> list[list[bytes]]:
        """The messages of each sample, in the order of the topics.

        rows: as the kernel writes them, shape (n, width). commands: world axes, shape (n, M, 6).
        stamps: [ns], shape (n,).
        """
        return self._cut(self._filled(rows, commands, np.array(stamps)))

    def _filled(self, rows: Array, commands: Array, stamps: NDArray[Any]) -> NDArray[np.uint8]:
        """The messages of each sample in one row, shape (n, size)."""
        n = len(rows)
        buffer = np.empty((n, len(self._template)), dtype=np.uint8)
        buffer[:] = self._template
        pack_rows(
            np.ascontiguousarray(rows),
            np.ascontiguousarray(commands.reshape(n, -1)),
            self._center_of_mass,
            self._linear,
            self._energy,
            self._columns,
            self._numbers,
            self._source,
            buffer.view(np.float64),
            self._seconds,
            np.stack(np.divmod(stamps, NANO), axis=1),
        )
        if len(self._octets):
            buffer[:, self._octets] = rows[:, self._states :]
        return buffer

    def pack(self, block: SampleBlock, stamps: NDArray[Any]) -> list[list[bytes]]:
        """The messages of each sample, in the order of the topics. stamps: [ns], shape (n,)."""
        return self._cut(self.fill(block, stamps)) if len(block) else []

    def fill(self, block: SampleBlock, stamps: NDArray[Any]) -> NDArray[np.uint8]:
        """The messages of each sample, shape (n, size); `bounds` are their positions in a row."""
        return self._filled(rows_of(block), block.command, stamps)

    def _cut(self, buffer: NDArray[np.uint8]) -> list[list[bytes]]:
        """The messages in each row of the buffer, as bytes."""
        (n, size), bounds, data = buffer.shape, self.bounds, buffer.tobytes()
        return [[data[at + a : at + b] for a, b in bounds] for at in range(0, n * size, size)]


def _aligned(end: int) -> int:
    """Start of the next message that aligns its fields, behind its header, in the buffer."""
    return end + (-end - len(HEADER)) % 8


def _linear(layout: SampleLayout) -> tuple[NDArray[Any], NDArray[Any]]:
    """(from, to) of the numbers copied unchanged from a row or a command to the source, shape (L,
    2); and the columns of the energy and its two parts.

    Found by reading the fields of a sample whose values are their own indices.
    """
    columns = columns_of(layout)
    row = np.arange(float(row_width(layout)))[None]
    command = -1.0 - np.arange(6.0 * len(layout.commanded)).reshape(1, -1, 6)
    block = block_of(np.zeros(1), row, layout, command)
    moves = [
        np.stack([getattr(block, name).reshape(-1), getattr(columns, name).reshape(-1)], axis=1)
        for name in FIELDS
        if name != "contact_work" or layout.contacts
    ]
    energy = [*columns.energy, *columns.kinetic_energy, *columns.potential_energy]
    return np.concatenate(moves).astype(np.int64), np.array(energy, dtype=np.int64)
