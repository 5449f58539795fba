# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the node and the process of its logs tell each other: each a pickle behind its length.

Begin, then Rows and Blocks of samples and States, then End, to the process; Opened, Said, Count and
Finished back.
"""

from __future__ import annotations

import pickle
import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.mechanics.samples import block_of

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import (
        Array,
        ContactEvent,
        Input,
        SampleBlock,
        SampleLayout,
        SampleRow,
    )
    from rb_sim.scene.schema import Scene

LENGTH = struct.Struct("<Q")


class Plan(NamedTuple):
    """What is to be written."""

    folder: Path
    overwrite: bool
    """replace what is there."""
    namespace: str
    bag: bool
    recording: bool
    plots: bool
    start_ns: int
    run: dict[str, Any]
    """settings that the bag carries."""
    split: dict[str, float | None]
    """where the bag is split, as BagSink has it."""
    accelerations: bool = False
    """record BODY/accel."""
    odometry: bool = False
    """record BODY/odometry."""


class Begin(NamedTuple):
    """First frame."""

    plan: Plan
    scene: Scene
    layout: SampleLayout


class Rows(NamedTuple):
    """Samples as SampleRow has them, n of them in one piece."""

    t: Array
    """[s], shape (n,)."""
    rows: Array
    """shape (n, width)."""
    command: Array
    """shape (n, M, 6)."""
    events: tuple[ContactEvent, ...]
    inputs: tuple[Input, ...]

    def block(self, layout: SampleLayout) -> SampleBlock:
        """The samples by name."""
        block = block_of(self.t, self.rows, layout, self.command)
        return replace(block, events=self.events, inputs=self.inputs)


class Block(NamedTuple):
    """Samples by name already."""

    samples: SampleBlock

    def block(self, _: SampleLayout) -> SampleBlock:
        """The samples."""
        return self.samples


class State(NamedTuple):
    """State of the node from the samples so far on."""

    state: str


class End(NamedTuple):
    """Last frame."""

    summary: dict[str, Any] | None


class Opened(NamedTuple):
    """Answer to Begin; error: why a log cannot be begun, or ""."""

    error: str


class Said(NamedTuple):
    """A line for the user."""

    line: str


class Count(NamedTuple):
    """How the logs stand."""

    written: int
    """samples taken so far."""
    lost: dict[str, int]
    """samples that a log lost, by its name."""
    failures: dict[str, str]


class Finished(NamedTuple):
    """The log of this name is complete."""

    name: str


def rows_of(samples: Sequence[SampleRow]) -> Rows:
    """Samples in time order, in one piece."""
    return Rows(
        np.array([one.t for one in samples]),
        np.array([one.row for one in samples]),
        np.array([one.command for one in samples]),
        tuple(event for one in samples for event in one.events),
        tuple(g._replace(index=k) for k, one in enumerate(samples) for g in one.inputs),
    )


def frame(message: Any) -> bytes:
    """A message as it goes over the pipe."""
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(data)) + data


def take_frame(buffer: bytearray) -> Any:
    """The first message in the buffer, taken off it; None if it is not whole."""
    if len(buffer) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack_from(buffer)
    end = LENGTH.size + length
    if len(buffer) < end:
        return None
    message = pickle.loads(bytes(buffer[LENGTH.size : end]))
    del buffer[:end]
    return message
