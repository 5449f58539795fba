"""All messages of a sample in one buffer, filled by two assignments.

A message of fixed layout is a template with numbers to fill in. Here the templates of all topics
stand one behind the other, each where its doubles are aligned, so that the numbers of a sample, or
of many, go to their places in one indexed assignment; Python does nothing per field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.engine.samples import SampleBlock, empty_block
from rb_sim.sinks.cdr import HEADER, NANO
from rb_sim.sinks.frames import Origins, origins

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rb_sim.engine.samples import Array, SampleLayout
    from rb_sim.sinks.topics import Topic

CONSTANTS = (0.0, 1.0)
"""The first columns of the source: numbers that a topic takes from no sample."""
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
"""Of a block, in the source, behind the motion of the body origins and the energy."""


class Packer:
    """Packs the messages of `topics`. center_of_mass: r_OC of each body, shape (N, 3)."""

    def __init__(
        self, topics: Sequence[Topic], layout: SampleLayout, center_of_mass: Array
    ) -> None:
        self._center_of_mass = center_of_mass
        self._constants = np.array([CONSTANTS])
        self._bounds: list[tuple[int, int]] = []
        numbers: list[NDArray[Any]] = []
        octets, stamps, template = [], [], bytearray()
        for topic in topics:
            start = _aligned(len(template))
            template += bytes(start - len(template)) + topic.codec.template
            self._bounds.append((start, len(template)))
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
        self._source = _columns(topics, layout)

    def pack(self, block: SampleBlock, stamps: NDArray[Any]) -> list[list[bytes]]:
        """The messages of each sample, in the order of the topics. stamps: [ns], shape (n,)."""
        n, size = len(block), len(self._template)
        if n == 0:
            return []
        buffer = np.empty((n, size), dtype=np.uint8)
        buffer[:] = self._template
        source = _source(block, origins(block, self._center_of_mass), self._constants)
        buffer.view(np.float64)[:, self._numbers] = source[:, self._source]
        if len(self._octets):
            buffer[:, self._octets] = block.contact_state
        seconds = buffer.view(np.int32)
        whole, rest = np.divmod(stamps[:, None], NANO)
        seconds[:, self._seconds] = whole
        seconds[:, self._seconds + 1] = rest
        data, bounds = buffer.tobytes(), self._bounds
        return [[data[at + a : at + b] for a, b in bounds] for at in range(0, n * size, size)]


def _aligned(end: int) -> int:
    """The next start of a message whose fields, behind its header, are aligned in the buffer."""
    return end + (-end - len(HEADER)) % 8


def _source(block: SampleBlock, motion: Origins, constants: Array) -> Array:
    """The numbers of each sample, shape (n, columns)."""
    n = len(block)
    parts = [
        np.broadcast_to(constants, (n, len(CONSTANTS))),
        motion.position,
        block.orientation,
        motion.linear_velocity,
        motion.angular_velocity,
        block.energy,
        *(getattr(block, name) for name in FIELDS),
    ]
    return np.concatenate([part.reshape(n, -1) for part in parts], axis=1)


def _columns(topics: Sequence[Topic], layout: SampleLayout) -> NDArray[Any]:
    """The column of the source from which each number of the messages comes.

    Found by asking the topics for their values of a sample whose numbers are those of the columns.
    """
    block = empty_block(1, layout)
    shape = block.position.shape
    motion = Origins(np.zeros(shape), np.zeros(shape), np.zeros(shape))
    column = len(CONSTANTS)
    arrays: dict[str, Any] = {}

    def numbered(array: Array) -> Array:
        nonlocal column
        column += array.size
        return np.arange(column - array.size, column, dtype=float).reshape(array.shape)

    position, arrays["orientation"] = numbered(motion.position), numbered(block.orientation)
    motion = Origins(position, numbered(motion.linear_velocity), numbered(motion.angular_velocity))
    arrays["energy"] = numbered(block.energy)
    arrays |= {name: numbered(getattr(block, name)) for name in FIELDS}
    energy = arrays.pop("energy")
    marked = _Marked(**vars(replace(block, **arrays)))
    object.__setattr__(marked, "_energy", energy)
    found = [
        topic.values(marked, motion).reshape(-1)
        for topic in topics
        if all(kind == "d" for _, kind, _ in topic.codec.numbers)
    ]
    return np.concatenate([np.empty(0), *found]).astype(np.intp)


class _Marked(SampleBlock):
    """A block whose energy is a number of its own, not a sum."""

    @property
    def energy(self) -> Array:
        return self._energy  # type: ignore[attr-defined]
