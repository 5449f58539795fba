"""What a fit follows, and the simulation that goes the same way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rb_sim.bags.resim import Inputs, blocks
from rb_sim.bags.tracks import Tracks
from rb_sim.checks.check_list import Watched
from rb_sim.mechanics.samples import SampleBlock
from rb_sim.scene.schema import Scene
from rb_sim.simulation.simulation import Simulation


@dataclass
class Recording:
    """What is to be followed.

    inputs: commands and resets by sample, with `count` samples and `node` as of bags.resim; or
    None, where only the poses are known: the simulation starts at the earliest of them, and each
    body has times of its own.
    """

    tracks: Tracks
    pairs: dict[str, str]
    """body of the scene: name in `tracks`."""
    inputs: Inputs | None = None
    count: int = 0
    node: bool = False

    @property
    def times(self) -> np.ndarray:
        """All instants at which a body was seen [s], increasing."""
        return np.unique(np.concatenate([self.tracks.bodies[n].t for n in self.pairs.values()]))

    def samples(self, body: str, made: int) -> np.ndarray:
        """Which of `made` simulated samples are at the times of a body, in their order."""
        t = self.tracks.bodies[self.pairs[body]].t
        at = np.arange(len(t)) if self.inputs is not None else np.searchsorted(self.times, t)
        return at[at < made]


def followed(simulation: Simulation, recording: Recording) -> Iterator[SampleBlock]:
    """The samples of the simulation at the instants of the recording, with its inputs."""
    if recording.inputs is not None:
        yield from blocks(simulation, recording.inputs, recording.count, node=recording.node)
        return
    times = recording.times
    yield simulation.run(at=times - times[0], watched=False).block


def lost_by(scene: Scene, recording: Recording) -> tuple[str, ...]:
    """What watches see of lost accuracy in the motion of the scene that follows the recording, a
    line each."""
    simulation = Simulation(scene)
    watched = Watched(simulation, followed(simulation, recording))
    for _ in watched:
        pass
    return tuple(map(str, watched.findings))
