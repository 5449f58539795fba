# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The recording to fit, and the simulation with its inputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from rb_sim.accuracy.checks.check_list import CheckedSamples
from rb_sim.bags.info import held
from rb_sim.bags.resim import Inputs, blocks
from rb_sim.bags.tracks import Tracks, Wrenches
from rb_sim.bags.transforms import WORLD, carried_over, topic_of, words
from rb_sim.base.errors import RbSimError
from rb_sim.base.names import first_few
from rb_sim.mechanics.samples import Input, SampleBlock
from rb_sim.scene.schema import Scene
from rb_sim.simulation.simulation import Simulation, give


@dataclass
class Recording:
    """The motion to fit.

    inputs: commands and resets by sample, with `count` samples and `node` as in bags.resim; None
    for a foreign bag: the simulation then starts at the earliest pose, each body has its own times,
    and `commands` act at theirs.
    """

    tracks: Tracks
    pairs: dict[str, str]
    """body of the scene: name in `tracks`."""
    inputs: Inputs | None = None
    count: int = 0
    node: bool = False
    commands: tuple[Input, ...] = ()
    """commands, with times relative to the first pose."""
    notes: list[str] = field(default_factory=list)
    """lines on the wrenches used as commands."""

    @property
    def times(self) -> np.ndarray:
        """All instants with a pose of any body [s], increasing."""
        return np.unique(np.concatenate([self.tracks.bodies[n].t for n in self.pairs.values()]))

    def samples(self, body: str, made: int) -> np.ndarray:
        """Indices, among `made` simulated samples, of those at the times of a body."""
        t = self.tracks.bodies[self.pairs[body]].t
        at = np.arange(len(t)) if self.inputs is not None else np.searchsorted(self.times, t)
        return at[at < made]


def followed(simulation: Simulation, recording: Recording) -> Iterator[SampleBlock]:
    """Yield the samples of the simulation at the recorded instants, with the recorded inputs."""
    if recording.inputs is not None:
        yield from blocks(simulation, recording.inputs, recording.count, node=recording.node)
        return
    times = recording.times - recording.times[0]
    done = 0
    for given in recording.commands:
        reached = int(np.searchsorted(times, given.t, side="right"))
        if reached > done:
            yield simulation.run(at=times[done:reached], checks=False).block
            done = reached
        simulation.advance(max(0.0, given.t - simulation.time))
        give(simulation, [given])
    if done < len(times):
        yield simulation.run(at=times[done:], checks=False).block


def lost_by(scene: Scene, recording: Recording) -> tuple[str, ...]:
    """Findings of the accuracy checks in the simulation with the recorded inputs, one line each."""
    simulation = Simulation(scene)
    checked = CheckedSamples(simulation, followed(simulation, recording))
    for _ in checked:
        pass
    return tuple(map(str, checked.findings))


def pairs_of(
    tracks: Tracks, bodies: Sequence[str], match: Sequence[str]
) -> tuple[dict[str, str], list[str]]:
    """Name of the poses of each body, as matched or by name, and lines on excluded bodies.

    match: texts NAME=BODY, poses and body; the reverse order is accepted if this one does not
    match. Raises RbSimError if no body is found.
    """
    names, option = ", ".join(tracks.bodies), "--match NAME=BODY"
    given = {}
    for text in match:
        name, _, body = text.partition("=")
        if not (name in tracks.bodies and body in bodies):
            body, name = name, body
        if name not in tracks.bodies or body not in bodies:
            raise RbSimError(
                f"--match: got {text}; must be NAME=BODY, one of the poses {names}, and one of "
                f"the bodies {', '.join(bodies)}"
            )
        given[body] = name
    if given:
        return given, []
    pairs, several = tracks.pairs_for(bodies)
    if not pairs:
        raise RbSimError(
            f"{tracks.name}: its poses are of {names}; the scene's bodies are "
            f"{', '.join(bodies)}; assign them with {option}"
        )
    return pairs, [
        f"{body} is not used: its poses may be {' or '.join(found)}; say which with {option}"
        for body, found in several.items()
    ]


def recorded_by_others(
    tracks: Tracks, scene: Scene, pairs: dict[str, str], wrenches: Sequence[str] = ()
) -> Recording:
    """Recording from a foreign bag: its poses, and the wrenches commanded on the scene's bodies.

    wrenches: those that are commands, as TOPIC or BODY=TOPIC, or "none"; empty: chosen by frames
    and names. Raises RbSimError if that is ambiguous.
    """
    recording = Recording(tracks, pairs)
    times = recording.times
    acting = _Acting(tracks, scene, pairs)
    recording.notes = acting.choose(wrenches)
    recording.commands = acting.inputs(float(times[0]), float(times[-1]))
    return recording


@dataclass
class _Signal:
    """Commands of one topic for a body: times [s], wrenches (n, 6), mask of body axes."""

    t: np.ndarray
    values: np.ndarray
    own: np.ndarray


class _Acting:
    """Assignment of recorded wrenches to the scene's bodies as commands."""

    def __init__(self, tracks: Tracks, scene: Scene, pairs: dict[str, str]) -> None:
        self._tracks, self._scene = tracks, scene
        self._topics: dict[str, list[Wrenches]] = {}
        for source, wrench in tracks.reactions.items():
            self._topics.setdefault(topic_of(source), []).append(wrench)
        self._commanded = {
            str(spec.body): name  # type: ignore[attr-defined]
            for name, spec in scene.effects.items()
            if spec.commandable
        }
        """name of the commandable effect by body."""
        paired = {body: tracks.bodies[name] for body, name in pairs.items()}
        inner = {tracks.bodies[name].frame for name in tracks.composed}
        self._world = {track.frame for track in paired.values()} | set(WORLD) - inner
        self._frames = {
            body: {body, paired[body].child if body in paired else ""} - {""}
            for body in self._commanded
        }
        self._signals: dict[str, dict[str, _Signal]] = {}
        """by body and topic."""

    def choose(self, wrenches: Sequence[str]) -> list[str]:
        """Use the named, or unambiguous, wrenches; returns lines on those used and not used."""
        if wrenches and list(wrenches) != ["none"]:
            for text in wrenches:
                self._take_named(text)
        elif not wrenches:
            for topic in self._topics:
                body = None if words(topic) & set(self._scene.constraints) else self._body_of(topic)
                if body is not None:
                    self._take(body, topic)
            for body, signals in self._signals.items():
                if len(signals) > 1:
                    raise RbSimError(
                        f"{self._tracks.name}: {' and '.join(signals)} act on {body}: say which "
                        "are its commands, which add up, with --wrench TOPIC, or --wrench none"
                    )
        taken = [(topic, body) for body, signals in self._signals.items() for topic in signals]
        lines = [f"{topic} is applied to {body} as its command" for topic, body in taken]
        rest = [topic for topic in self._topics if topic not in dict(taken)]
        if rest and not wrenches:
            why = "the scene has no commanded_wrench that takes them"
            if self._commanded:
                why = "commands of a body are named with --wrench BODY=TOPIC"
            lines.append(f"its wrenches ({first_few(rest)}) are not applied: {why}")
        elif not wrenches and (
            idle := [body for body in self._commanded if body not in self._signals]
        ):
            effects = first_few([f"{self._commanded[body]} of {body}" for body in idle])
            lines.append(f"no wrench in it is a command of {effects}: zero throughout")
        return lines

    def inputs(self, start: float, end: float) -> tuple[Input, ...]:
        """Commands from `start` to `end` [s] in order; each holds until the next."""
        found = [
            given
            for body, signals in self._signals.items()
            for given in _inputs(body, _sum(body, signals), start, end)
        ]
        return tuple(sorted(found, key=lambda given: given.t))

    def _take_named(self, text: str) -> None:
        body, _, topic = text.rpartition("=")
        takers = ", ".join(self._commanded) or "none (no commanded_wrench effect)"
        if topic not in self._topics:
            known = ", ".join(self._topics) or "none, there is no WrenchStamped in the bag"
            raise RbSimError(f"--wrench {text}: the topic must be one of {known}")
        if body and body not in self._commanded:
            raise RbSimError(f"--wrench {text}: bodies that take a command: {takers}")
        found = body or self._body_of(topic)
        if found is None:
            raise RbSimError(
                f"--wrench {topic}: neither its frame nor its name identifies the body; give "
                f"BODY={topic} (bodies that take a command: {takers})"
            )
        self._take(found, topic)

    def _take(self, body: str, topic: str) -> None:
        parts = []
        for wrench in self._topics[topic]:
            values = self._in_axes_of(body, wrench)
            own = values is not None
            if values is None:
                if wrench.frame not in self._world:
                    raise RbSimError(
                        f"--wrench {body}={topic}: its frame {wrench.frame} is neither the body's "
                        "nor that of its poses, and no static transform leads to the body's"
                    )
                values = wrench.values
            parts.append((wrench.t, values, np.full(len(wrench.t), own)))
        t, values, own = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(t, kind="stable")
        signal = _Signal(t[order], values[order], own[order])
        self._signals.setdefault(body, {})[topic] = signal

    def _in_axes_of(self, body: str, wrench: Wrenches) -> np.ndarray | None:
        """Wrenches about the body's origin in its axes; None if their frame is another."""
        if wrench.frame in self._frames[body]:
            return wrench.values
        carrier = self._tracks.fixed.carrier(wrench.frame, self._frames[body])
        return None if carrier is None else carried_over(wrench.values, carrier[1])

    def _body_of(self, topic: str) -> str | None:
        """The commandable body on which all wrenches of a topic act: by frame; for wrenches in the
        world frame by the name of body or effect in the topic."""
        found = {self._of(wrench, topic) for wrench in self._topics[topic]}
        return found.pop() if len(found) == 1 else None

    def _of(self, wrench: Wrenches, topic: str) -> str | None:
        own = [body for body in self._commanded if self._in_axes_of(body, wrench) is not None]
        if own or wrench.frame not in self._world:
            return own[0] if len(own) == 1 else None
        parts = words(topic)
        named = [body for body, effect in self._commanded.items() if {body, effect} & parts]
        alone = len(self._scene.bodies) == 1
        return named[0] if len(named) == 1 else next(iter(self._commanded), None) if alone else None


def _sum(body: str, signals: dict[str, _Signal]) -> _Signal:
    """Sum of the commands on a body. Raises RbSimError if their axes differ."""
    parts = list(signals.values())
    if len(parts) == 1:
        return parts[0]
    own = np.concatenate([signal.own for signal in parts])
    if own.any() != own.all():
        raise RbSimError(
            f"--wrench: {' and '.join(signals)} act on {body} in the world's axes and in its own; "
            "must be in the same"
        )
    t = np.unique(np.concatenate([signal.t for signal in parts]))
    total = np.sum([held(t, signal.t, signal.values) for signal in parts], axis=0)
    return _Signal(t, total, np.full(len(t), own[0]))


def _inputs(body: str, signal: _Signal, start: float, end: float) -> Iterable[Input]:
    """Commands of a signal, without repetitions."""
    t = np.maximum(signal.t - start, 0.0)
    first = max(0, int(np.searchsorted(signal.t, start, side="right")) - 1)
    before = None
    for k in range(first, int(np.searchsorted(signal.t, end))):
        fx, fy, fz, kx, ky, kz = signal.values[k].tolist()
        now = "body" if signal.own[k] else "world", (fx, fy, fz), (kx, ky, kz)
        if now != before:
            yield Input(0, float(t[k]), body, *now)
        before = now
