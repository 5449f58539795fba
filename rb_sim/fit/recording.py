"""What a fit follows, and the simulation that goes the same way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rb_sim.bags.resim import Inputs, blocks
from rb_sim.bags.tracks import Tracks
from rb_sim.engine.samples import SampleBlock
from rb_sim.simulation import Simulation


@dataclass
class Recording:
    """What is to be followed.

    inputs: commands and resets by sample, with `count` samples and `node` as of bags.resim; or
    None, where only the poses are known: the simulation starts at the first of them.
    """

    tracks: Tracks
    pairs: dict[str, str]
    """body of the scene: name in `tracks`."""
    inputs: Inputs | None = None
    count: int = 0
    node: bool = False


def followed(simulation: Simulation, recording: Recording) -> Iterator[SampleBlock]:
    """The samples of the simulation at the instants of the recording, with its inputs."""
    if recording.inputs is not None:
        yield from blocks(simulation, recording.inputs, recording.count, node=recording.node)
        return
    first = recording.tracks.bodies[next(iter(recording.pairs.values()))]
    yield simulation.run(at=first.t - first.t[0]).block
