# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The record of a run: named columns over time, and what can be made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.diagnostic import findings_in, global_error_in, tell
from rb_sim.base.errors import RbSimError, named_if_lacking
from rb_sim.mechanics.samples import Array, concatenate
from rb_sim.numerics.rotations import roll_pitch_yaw, without_jumps
from rb_sim.trajectory.record import (
    ByName,
    EventState,
    Reaction,
    Record,
    State,
    beside,
    state_of,
)
from rb_sim.trajectory.wrenches import Resultant, accelerations, effect_wrenches, resultant

if TYPE_CHECKING:
    from rb_sim.io.bag.reader import BagReader
    from rb_sim.trajectory.views import Pages


class Trajectory(Record):
    """Samples of a run, by name of body, constraint or contact.

    `position`, `reaction` and the like map names to arrays whose first axis is time. SI units,
    world axes unless stated; quaternions are [x, y, z, w], body to world.
    """

    @classmethod
    def from_bag(cls, bag: str | PathLike[str]) -> Trajectory:
        """Read the samples of a bag that rb_sim recorded.

        The scene is that of the run, with its options. A UserWarning names damaged parts and
        their times, an AccuracyWarning each accuracy check that failed in the run.

        Args:
            bag: Folder of the bag or .mcap file.

        Raises:
            RbSimError: The bag does not exist, is not finished, or was not recorded by rb_sim.
        """
        from rb_sim.io.bag.reader import BagReader

        reader = BagReader(Path(bag))
        run = recorded(reader)
        tell(reader.left_out, run.findings, stacklevel=2)
        return cls(run.block, run.layout, run.scene, run.method, run.findings, run.global_error)

    def __repr__(self) -> str:
        name = f" of {self.scene.name}" if self.scene is not None else ""
        bodies = ", ".join(self.layout.bodies)
        if not len(self):
            return f"<Trajectory{name}: {bodies}; no samples>"
        count = "1 sample" if len(self) == 1 else f"{len(self)} samples"
        end = "" if len(self) == 1 else f" to {self.t[-1]:g}"
        parts = [bodies, f"{count}, t = {self.t[0]:g}{end} s", self.method]
        if self.layout.contacts:
            events = len(self.events)
            parts.append("1 contact event" if events == 1 else f"{events} contact events")
        parts.append(f"worst residual {self.residual.max():.1e}")
        if self.global_error is not None:
            parts.append(f"global error {self.global_error}")
        if self.findings:
            lost = ", ".join(dict.fromkeys(finding.watch for finding in self.findings))
            parts.append(f"accuracy lost ({lost})")
        return f"<Trajectory{name}: {'; '.join(part for part in parts if part)}>"

    @property
    def euler_angles(self) -> Mapping[str, Array]:
        """Roll, pitch, yaw of each body [rad], shape (n, 3), as in ROS.

        The body is turned by roll about the world's x, then by pitch about its y, then by yaw about
        its z. The angles are continuous, as in plots: of the two triples of an attitude each sample
        has the one nearer to the sample before, and whole turns are counted, so that all three may
        go beyond half a turn (pitch beyond a quarter) if samples are less than half a turn apart.
        At pitch +-pi/2 only the sum or difference of roll and yaw is determined.
        """

        return self._by_body(without_jumps(roll_pitch_yaw(self.block.orientation)))

    @property
    def linear_acceleration(self) -> Mapping[str, Array]:
        """Acceleration of each body's centre of mass, world [m/s^2], shape (n, 3).

        Computed from effects and reactions by Newton's equation, without the jumps of impacts.

        Raises:
            RbSimError: The scene is not known, or the method is time_stepping.
        """

        return self._by_body(accelerations(self).linear)

    @property
    def angular_acceleration(self) -> Mapping[str, Array]:
        """Angular acceleration of each body, body axes [rad/s^2], shape (n, 3).

        Computed by Euler's equations; otherwise as `linear_acceleration`.
        """

        return self._by_body(accelerations(self).angular)

    @property
    def effect(self) -> Mapping[str, Reaction]:
        """Wrench of each effect on its body, about the centre of mass, world axes, (n, 3) each.

        The name is that of the effect, or EFFECT/BODY if it acts on several bodies (a parent gets
        the opposite).

        Raises:
            RbSimError: The scene is not known.
        """

        return ByName("effect", effect_wrenches(self))

    @property
    def at_events(self) -> tuple[EventState, ...]:
        """States just before and just after each event of a `run(events=True)`.

        An event at the very start has the initial state on both sides.

        Raises:
            RbSimError: The run has no samples just before and after its events.
        """
        return tuple(beside(self, event) for event in self.events)

    def state(self, index: int = -1) -> State:
        """State at one sample.

        Args:
            index: Number of the sample; negative: from the end.

        Raises:
            RbSimError: There is no such sample.
        """
        return state_of(self, index)

    def resultant(self, name: str, about: str | Sequence[float] | Array | None = None) -> Resultant:
        """Wrench of a constraint or effect on its body about another point, world axes.

        The torque about P is M + (anchor - P) x F.

        Args:
            name: Constraint or effect.
            about: Body (its centre of mass), point of the world [m], shape (3,) or (n, 3), or None
                for the anchor itself.

        Raises:
            RbSimError: The name or the body does not exist, or the point is not finite.
        """

        return resultant(self, name, about)

    def to_npz(self, path: str | PathLike[str], *, accelerations: bool = False) -> None:
        """Write all columns to a numpy archive: t, energy, residual and QUANTITY.NAME.

        With contacts also contact_work, and events.t, .contact, .kind and .impulse (one row each).

        Args:
            path: File to write; missing folders are made.
            accelerations: Write linear and angular accelerations, too.

        Raises:
            RbSimError: The file cannot be written, or accelerations are not available.
        """
        from rb_sim.trajectory.tables import save_npz

        save_npz(self, Path(path), accelerations)

    def to_csv(self, path: str | PathLike[str], *, accelerations: bool = False) -> None:
        """Write t [s] and the columns of `to_pandas` as CSV with a header; SI units.

        Arguments and errors are those of `to_npz`.
        """
        from rb_sim.trajectory.tables import save_csv

        save_csv(self, Path(path), accelerations)

    def to_pandas(self, *, accelerations: bool = False) -> Any:
        """pandas DataFrame over t [s], columns QUANTITY.NAME.COMPONENT; units in its `attrs`.

        Args:
            accelerations: Linear and angular accelerations, too.

        Raises:
            RbSimError: pandas is not installed, or accelerations are not available.
        """
        from rb_sim.trajectory.tables import to_pandas

        return to_pandas(self, accelerations)

    def to_xarray(self) -> Any:
        """xarray Dataset with the dimensions t, body, reaction, contact and axis.

        Each variable has its unit as attribute `units`.

        Raises:
            RbSimError: xarray is not installed.
        """
        from rb_sim.trajectory.tables import to_xarray

        return to_xarray(self)

    @named_if_lacking()
    def plot(self, path: str | PathLike[str] | None = None) -> Pages:
        """Plot everything that changes in the run, as matplotlib figures.

        Args:
            path: PNG file to write. With many bodies there is a page for each: `path` gets the
                first, files beside it the others.

        Raises:
            RbSimError: The scene is not known, `path` does not end in .png or cannot be written.
        """
        from rb_sim.trajectory.views import pages_of

        pages = pages_of(self)
        if path is not None:
            pages.save(Path(path))
        return pages

    @named_if_lacking()
    def view(self, save: str | PathLike[str] | None = None) -> None:
        """Show the run in the Rerun viewer (in a notebook: in its cell), or save the recording.

        Args:
            save: .rrd file to write instead of opening the viewer.

        Raises:
            RbSimError: rerun-sdk is not installed, there is no screen, `save` does not end in .rrd
                or cannot be written.
        """
        from rb_sim.trajectory.views import view

        view(self, None if save is None else Path(save))


def recorded(reader: BagReader) -> Trajectory:
    """The samples of a bag of rb_sim; what is broken in it stands in the reader's `left_out`."""
    from rb_sim.io.bag.as_run import scene_as_run

    block = concatenate(reader.blocks(), reader.layout)
    try:
        scene: Any = scene_as_run(reader)
    except RbSimError:  # a newer or older version's; bodies and names are in the bag
        scene = reader.scene
    method, error = method_text(reader.scene.simulation), global_error_in(reader.summary)
    return Trajectory(block, reader.layout, scene, method, findings_in(reader.summary), error)


def method_text(options: Any) -> str:
    """Method and its step or tolerance, in words."""
    if options.step is not None:
        return f"{options.method}, step {options.step:g} s"
    if options.tolerance is not None:
        return f"{options.method}, tolerance {options.tolerance:g}"
    return str(options.method)
