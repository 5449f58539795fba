"""The record of a run: named columns over time, and what can be made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.diagnostic import findings_in, global_error_in, tell
from rb_sim.base.errors import RbSimError
from rb_sim.mechanics.samples import Array, concatenate
from rb_sim.numerics.rotations import roll_pitch_yaw
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
    """Samples of a run by name. SI units, quaternions [x, y, z, w] body to world.

    `position`, `reaction` and the like map names to arrays whose first axis is time.
    """

    @classmethod
    def from_bag(cls, bag: str | PathLike[str]) -> Trajectory:
        """The samples of a bag that rb_sim recorded: a folder or an .mcap file.

        The scene is that of the run, with its options. A UserWarning names damaged parts and
        their times, an AccuracyWarning each accuracy check that failed in the run.
        Raises SinkError with one line: missing, unfinished, not recorded by rb_sim.
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
        """Roll, pitch, yaw [rad], shape (n, 3) each, as in ROS: the body is turned by roll about
        the world's x, then by pitch about its y, then by yaw about its z.

        Roll and yaw count whole turns if samples are less than half a turn apart. At pitch +-pi/2
        only their sum or difference is determined.
        """

        return self._by_body(np.unwrap(roll_pitch_yaw(self.block.orientation), axis=0))

    @property
    def linear_acceleration(self) -> Mapping[str, Array]:
        """Of the centre of mass, world [m/s^2], shape (n, 3) each; computed on request.

        From Newton's equation with effects and reactions; an impact's jump is not in it. Raises
        RbSimError where the scene is not known, and for method time_stepping.
        """

        return self._by_body(accelerations(self).linear)

    @property
    def angular_acceleration(self) -> Mapping[str, Array]:
        """Rate of the angular velocity's components, body frame [rad/s^2], shape (n, 3) each.

        From Euler's equations; else as `linear_acceleration`.
        """

        return self._by_body(accelerations(self).angular)

    @property
    def effect(self) -> Mapping[str, Reaction]:
        """Wrench of each effect on each body, about its centre of mass: NAME, or NAME/BODY.

        NAME/BODY where the effect acts on several bodies (a parent gets the opposite). The laws
        are evaluated at the samples; raises RbSimError if the scene is not known.
        """

        return ByName("effect", effect_wrenches(self))

    @property
    def at_events(self) -> tuple[EventState, ...]:
        """States just before and just after each event of a `run(events=True)`.

        An event at the very start has the initial state on both sides. Raises RbSimError if there
        are no samples just before and after the events.
        """
        return tuple(beside(self, event) for event in self.events)

    def state(self, index: int = -1) -> State:
        """The state at sample `index`; negative: from the end. Raises RbSimError if there is no
        such sample.
        """
        return state_of(self, index)

    def resultant(self, name: str, about: str | Sequence[float] | Array | None = None) -> Resultant:
        """The wrench of a constraint (or effect) on its body, reduced to another point.

        The torque about P is M + (anchor - P) x F.
        about: a body (its centre of mass), a world point of 3 numbers or one per sample [m], or
        None for the anchor itself.
        Raises RbSimError for a name or a point that does not exist.
        """

        return resultant(self, name, about)

    def to_npz(self, path: str | PathLike[str], *, accelerations: bool = False) -> None:
        """Write all columns to a numpy archive: t, energy, residual and QUANTITY.NAME.

        With contacts also contact_work, and events.t, .contact, .kind and .impulse (one row each).
        accelerations: linear and angular ones, too; raises RbSimError as they do. Folders are
        made; SinkError where it cannot be written.
        """
        from rb_sim.trajectory.tables import save_npz

        save_npz(self, Path(path), accelerations)

    def to_csv(self, path: str | PathLike[str], *, accelerations: bool = False) -> None:
        """Write t [s] and the columns of `to_pandas` as CSV with a header; SI units.

        accelerations, errors: as in `to_npz`.
        """
        from rb_sim.trajectory.tables import save_csv

        save_csv(self, Path(path), accelerations)

    def to_pandas(self, *, accelerations: bool = False) -> Any:
        """A pandas DataFrame over t [s], columns QUANTITY.NAME.COMPONENT; units in its `attrs`.

        accelerations: as in `to_npz`. Raises MissingExtraError without pandas.
        """
        from rb_sim.trajectory.tables import to_pandas

        return to_pandas(self, accelerations)

    def to_xarray(self) -> Any:
        """An xarray Dataset with the dimensions t, body, reaction, contact and axis.

        Each variable has its units. Raises MissingExtraError without xarray.
        """
        from rb_sim.trajectory.tables import to_xarray

        return to_xarray(self)

    def plot(self, path: str | PathLike[str] | None = None) -> Pages:
        """The plots of the run, as matplotlib figures; also written to `path` (PNG) if given.

        One page, or with many bodies one for each: `path` gets the first, files beside it the rest.
        Raises RbSimError where the scene is not known, SinkError where it cannot write.
        """
        from rb_sim.trajectory.views import pages_of

        pages = pages_of(self)
        if path is not None:
            pages.save(Path(path))
        return pages

    def view(self, save: str | PathLike[str] | None = None) -> None:
        """Show the run in the Rerun viewer, in a notebook inside of it; or save it as .rrd.

        Raises MissingExtraError without rerun-sdk; SinkError without a screen.
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
