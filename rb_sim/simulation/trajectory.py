# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The record of a run: named columns over time, its tables and its views.

Tables are a numpy archive, a pandas DataFrame or an xarray Dataset; views are matplotlib figures
and the Rerun viewer.
"""

from __future__ import annotations

import base64
import io
import operator
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import (
    MissingExtraError,
    RbSimError,
    SinkError,
    check_ending,
    findings_in,
    global_error_in,
    named_if_lacking,
    tell,
)
from rb_sim.io.run_plots import Plots, save
from rb_sim.mechanics.samples import Array, concatenate
from rb_sim.numerics.rotations import roll_pitch_yaw, without_jumps
from rb_sim.simulation.record import (
    ByName,
    EventState,
    Reaction,
    Record,
    State,
    accelerations,
    effect_wrenches,
)

if TYPE_CHECKING:
    from rb_sim.io.bag.reader import BagReader
    from rb_sim.mechanics.samples import ContactEvent

NEAR = 256.0
"""Distance of a sample from an event, in roundings of the end time, up to which it is beside the
event."""


class Resultant(NamedTuple):
    """A wrench reduced to a point, world axes."""

    force: Array
    """Force [N], shape (n, 3)."""
    torque: Array
    """Torque about `point` [N m], shape (n, 3)."""
    point: Array
    """Reference point, world [m], shape (n, 3)."""


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
        parts.append(f"constraint violation {self.residual.max():.1e}")
        if self.global_error is not None:
            parts.append(f"global error {self.global_error}")
        if self.findings:
            lost = ", ".join(dict.fromkeys(finding.check for finding in self.findings))
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
        return tuple(self._beside(event) for event in self.events)

    def _beside(self, event: ContactEvent) -> EventState:
        """The event with the states of the samples just before and just after it."""
        t = self.t
        near = NEAR * np.spacing(max(abs(float(t[-1])), abs(event.t)))
        after = min(int(np.searchsorted(t, event.t, side="right")), len(t) - 1)
        before = max(int(np.searchsorted(t, event.t, side="left")) - 1, 0)
        rows = (before, after) if t[before] > 0.0 or event.t > near else (0, 0)
        if any(abs(t[row] - event.t) > near for row in rows):
            raise RbSimError(
                f"no sample lies beside the event at t = {event.t:.9g} s: "
                "Simulation.run(events=True) samples there"
            )
        return EventState(event, self.state(rows[0]), self.state(rows[1]))

    def state(self, index: int = -1) -> State:
        """State at one sample.

        Args:
            index: Number of the sample; negative: from the end.

        Raises:
            RbSimError: There is no such sample.
        """
        count = len(self)
        try:
            found = -count <= operator.index(index) < count
        except TypeError:
            found = False
        if not found:
            raise RbSimError(
                f"state: got {index!r}; must be the index of a sample, from {-count} to {count - 1}"
            )

        def rows(name: str) -> Mapping[str, Array]:
            values = getattr(self.block, name)[index].view()
            values.flags.writeable = False  # a copy of the state: a change would have no effect
            return ByName("body", {body: values[i] for i, body in enumerate(self.layout.bodies)})

        columns = ("position", "orientation", "linear_velocity", "angular_velocity")
        return State(float(self.t[index]), **{name: rows(name) for name in columns})

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

        acting = self.reaction.get(name)
        if acting is None:
            effects = effect_wrenches(self) if self.scene is not None else {}
            if name not in effects:
                known = ", ".join((*self.layout.reactions, *effects)) or "none"
                raise RbSimError(f"resultant: got {name!r}; constraints and effects: {known}")
            acting = effects[name]
        point = self._point(about, acting.anchor)
        torque = acting.torque + np.cross(acting.anchor - point, acting.force)
        return Resultant(acting.force, torque, point)

    def _point(self, about: Any, anchor: Array) -> Array:
        if about is None:
            return anchor
        if isinstance(about, str):
            if about not in self.layout.bodies:
                bodies = ", ".join(self.layout.bodies)
                raise RbSimError(f"about: got {about!r}; must be a body ({bodies}) or a point")
            return self.position[about]
        try:
            points = np.broadcast_to(np.asarray(about, dtype=float), (len(self), 3))
            if np.isfinite(points).all():
                return points
        except (TypeError, ValueError):
            pass
        allowed = "a body, 3 finite numbers, or 3 for each sample"
        raise RbSimError(f"about: got {about!r}; must be {allowed}")

    def to_npz(self, path: str | PathLike[str], *, accelerations: bool = False) -> None:
        """Write all columns to a numpy archive: t, energy, residual and QUANTITY.NAME.

        With contacts also contact_work, and events.t, .contact, .kind and .impulse (one row each).

        Args:
            path: File to write; missing folders are made.
            accelerations: Write linear and angular accelerations, too.

        Raises:
            RbSimError: The file cannot be written, or accelerations are not available.
        """

        columns: dict[str, Any] = {"t": self.t, "energy": self.energy, "residual": self.residual}
        for quantity in ("position", "orientation", "linear_velocity", "angular_velocity"):
            for name, values in getattr(self, quantity).items():
                columns[f"{quantity}.{name}"] = values
        if accelerations:
            columns |= {label: values for _, label, values in _accelerations(self)}
        for name, reaction in self.reaction.items():
            for part, values in reaction._asdict().items():
                columns[f"reaction.{name}.{part}"] = values
        for name, values in self.contact_state.items():
            columns[f"contact_state.{name}"] = values
        if self.layout.contacts:
            columns["contact_work"] = self.contact_work
            for part in ("t", "contact", "kind", "impulse"):
                columns[f"events.{part}"] = np.array([getattr(e, part) for e in self.events])
        with _writing(path):
            np.savez_compressed(path, **columns)

    def to_csv(self, path: str | PathLike[str], *, accelerations: bool = False) -> None:
        """Write t [s] and the columns of `to_pandas` as CSV with a header; SI units.

        Arguments and errors are those of `to_npz`.
        """

        columns, _ = _numbers(self, accelerations)
        table = np.column_stack([self.t, *columns.values()])
        head = ",".join(["t", *columns])
        with _writing(path):
            np.savetxt(path, table, fmt="%.17g", delimiter=",", header=head, comments="")

    def to_pandas(self, *, accelerations: bool = False) -> Any:
        """pandas DataFrame over t [s], columns QUANTITY.NAME.COMPONENT; units in its `attrs`.

        Args:
            accelerations: Linear and angular accelerations, too.

        Raises:
            RbSimError: pandas is not installed, or accelerations are not available.
        """

        pandas = _library("pandas", "a DataFrame")
        columns, units = _numbers(self, accelerations)
        frame = pandas.DataFrame(columns, index=pandas.Index(self.t, name="t"))
        frame.attrs["units"] = units | {"t": "s"}
        return frame

    def to_xarray(self) -> Any:
        """xarray Dataset with the dimensions t, body, reaction, contact and axis.

        Each variable has its unit as attribute `units`.

        Raises:
            RbSimError: xarray is not installed.
        """

        xarray = _library("xarray", "a Dataset")
        variables: dict[str, Any] = {}
        coordinates: dict[str, Any] = {"t": ("t", self.t, {"units": "s"})}
        axes: dict[Any, str] = {XYZ: "axis", QUATERNION: "quaternion", WRENCH: "wrench"}
        for quantity in QUANTITIES:
            dimensions = ["t"]
            if quantity.along:
                dimensions.append(quantity.along)
                coordinates[quantity.along] = list(_names_along(self, quantity.along))
            if quantity.components:
                dimensions.append(axes[quantity.components])
                coordinates[axes[quantity.components]] = list(quantity.components)
            attributes = {"units": quantity.unit, "long_name": quantity.meaning}
            values = getattr(self.block, quantity.field)
            variables[quantity.name.replace(".", "_")] = (dimensions, values, attributes)
        return xarray.Dataset(variables, coords=coordinates)

    @named_if_lacking()
    def plot(self, path: str | PathLike[str] | None = None) -> Pages:
        """Plot everything that changes in the run, as matplotlib figures.

        Args:
            path: PNG file to write. With many bodies there is a page for each: `path` gets the
                first, files beside it the others.

        Raises:
            RbSimError: The scene is not known, `path` does not end in .png or cannot be written.
        """

        if self.scene is None or not len(self):
            missing = "samples" if self.scene is not None else "scene"
            raise RbSimError(f"plot: the trajectory has no {missing}")
        plots = Plots(self.scene, self.layout)
        plots.add(self.block)
        pages = Pages(plots.figures())
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

        view(self, None if save is None else Path(save))


def recorded(reader: BagReader) -> Trajectory:
    """The samples of a bag recorded by rb_sim; damaged parts are listed in the reader's
    `left_out`."""
    from rb_sim.io.bag.reader import scene_as_run

    block = concatenate(reader.blocks(), reader.layout)
    try:
        scene: Any = scene_as_run(reader)
    except RbSimError:  # of another version; the bag itself has bodies and names
        scene = reader.scene
    method, error = method_text(reader.scene.simulation), global_error_in(reader.summary)
    return Trajectory(block, reader.layout, scene, method, findings_in(reader.summary), error)


def method_text(options: Any) -> str:
    """Method and its step or tolerance as text."""
    if options.step is not None:
        return f"{options.method}, step {options.step:g} s"
    if options.tolerance is not None:
        return f"{options.method}, tolerance {options.tolerance:g}"
    return str(options.method)


# Plots of a trajectory as matplotlib figures, shown in a notebook or saved.


class Pages(Mapping[str, Any]):
    """Matplotlib figures by page: "" is the first one, the others are named by a body.

    A notebook displays all of them.
    """

    def __init__(self, figures: dict[str, Any]) -> None:
        self._figures = figures

    def __getitem__(self, name: str) -> Any:
        return self._figures[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._figures)

    def __len__(self) -> int:
        return len(self._figures)

    def __repr__(self) -> str:
        bodies = [name for name in self._figures if name]
        return f"<plots: {'one page' if not bodies else 'the whole, ' + ', '.join(bodies)}>"

    def _repr_html_(self) -> str:
        return "".join(f'<img src="data:image/png;base64,{_png(f)}">' for f in self.values())

    def save(self, path: Path) -> None:
        """Write the pages as PNG: the first to `path`, those of bodies beside it; creates the
        folder.

        Raises SinkError.
        """
        check_ending(path, ".png")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SinkError(f"{path}: cannot be written: {error.strerror}") from None
        save(self._figures, path)


def _png(figure: Any) -> str:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return base64.b64encode(file.getvalue()).decode("ascii")


# Trajectory in the Rerun viewer: in a window, in a notebook, or saved as a recording.


def view(trajectory: Record, save: Path | None = None) -> None:
    """Save the run as .rrd, or show it: as a widget in a notebook, else in the viewer window.

    Raises MissingExtraError, SinkError; RbSimError for a trajectory without a scene.
    """
    if save is not None:
        check_ending(save, ".rrd")
        record(trajectory, save)
        return
    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        recording = Path(folder) / f"{getattr(trajectory.scene, 'name', 'run')}.rrd"
        record(trajectory, recording)
        if in_notebook():
            _widget(recording)
            return
        from rb_sim.io.rerun.viewer import show

        show(recording)


def record(trajectory: Record, path: Path) -> None:
    """Write the run as a Rerun recording."""
    from rb_sim.io.rerun.rerun_sink import RerunSink

    if trajectory.scene is None:
        raise RbSimError("view: the trajectory has no scene")
    sink = RerunSink(path)
    sink.open(trajectory.scene, trajectory.layout)
    try:
        sink.write(trajectory.block)
    finally:
        sink.close()


def in_notebook() -> bool:
    """Whether this runs in the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and getattr(shell, "kernel", None) is not None


def _widget(recording: Path) -> None:
    """Show the recording as a Rerun widget in a notebook."""
    from importlib.util import find_spec

    if find_spec("rerun_notebook") is None:
        raise MissingExtraError("rerun-notebook", "notebook", "a viewer in a notebook")
    import rerun

    stream = rerun.RecordingStream("rb_sim")
    stream.log_file_from_path(recording)
    stream.notebook_show(width=1200, height=700)


class Quantity(NamedTuple):
    """A field of a SampleBlock as a column of tables. along: axis of the layout, or "" for none."""

    name: str
    field: str
    along: str
    components: tuple[str, ...]
    unit: str
    meaning: str


XYZ, QUATERNION, NONE = ("x", "y", "z"), ("x", "y", "z", "w"), ()
WRENCH = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")

QUANTITIES = (
    Quantity("position", "position", "body", XYZ, "m", "centre of mass, world"),
    Quantity("orientation", "orientation", "body", QUATERNION, "1", "quaternion, body to world"),
    Quantity(
        "linear_velocity", "linear_velocity", "body", XYZ, "m/s", "of the centre of mass, world"
    ),
    Quantity("angular_velocity", "angular_velocity", "body", XYZ, "rad/s", "body axes"),
    Quantity("reaction.force", "reaction_force", "reaction", XYZ, "N", "on the body, world axes"),
    Quantity("reaction.torque", "reaction_torque", "reaction", XYZ, "N m", "about the anchor"),
    Quantity("reaction.anchor", "anchor", "reaction", XYZ, "m", "anchor or contact point, world"),
    Quantity("command", "command", "commanded", WRENCH, "N, N m", "about the body origin, world"),
    Quantity("contact_state", "contact_state", "contact", NONE, "1", "0 open, 1 slip, 2 stick"),
    Quantity("momentum", "momentum", "", XYZ, "kg m/s", "total, world"),
    Quantity("angular_momentum", "angular_momentum", "", XYZ, "kg m^2/s", "about the world origin"),
    Quantity("kinetic_energy", "kinetic_energy", "", NONE, "J", "of all bodies"),
    Quantity("potential_energy", "potential_energy", "", NONE, "J", "of the conservative effects"),
    Quantity("energy", "energy", "", NONE, "J", "kinetic plus potential"),
    Quantity("power", "power", "", NONE, "W", "of the forces without potential"),
    Quantity("contact_work", "contact_work", "", NONE, "J", "of all contacts since the start"),
    Quantity("residual", "residual", "", NONE, "1", "of the scene's scale"),
)


ACCELERATIONS = (
    Quantity("linear_acceleration", "", "body", XYZ, "m/s^2", "of the centre of mass, world"),
    Quantity("angular_acceleration", "", "body", XYZ, "rad/s^2", "rate of w, body axes"),
)
"""Quantities computed from a block on request."""


def _names_along(trajectory: Record, along: str) -> tuple[str, ...]:
    """Names on an axis of the layout: bodies, reactions, commanded, contacts."""
    layout = trajectory.layout
    axes = {
        "body": layout.bodies,
        "reaction": layout.reactions,
        "commanded": layout.commanded,
        "contact": layout.contacts,
    }
    return axes[along]


@contextmanager
def _writing(path: str | PathLike[str]) -> Iterator[None]:
    """Context that writes a file: makes its folder, turns errors into a SinkError."""
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise SinkError(f"{path}: cannot be written: {error.strerror}") from None


def _accelerations(trajectory: Record) -> list[tuple[Quantity, str, Array]]:
    """(quantity, label, values of shape (n, 3)) of each body."""
    from rb_sim.simulation.record import accelerations

    found = accelerations(trajectory)
    return [
        (quantity, f"{quantity.name}.{name}", values[:, i])
        for quantity, values in zip(ACCELERATIONS, found, strict=True)
        for i, name in enumerate(trajectory.layout.bodies)
    ]


def _numbers(trajectory: Record, accelerations: bool) -> tuple[dict[str, Array], dict[str, str]]:
    """(columns, units) of all quantities, by QUANTITY.NAME.COMPONENT."""
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    shown = [(q, *named) for q in QUANTITIES for named in _named(trajectory, q)]
    for quantity, label, values in shown + (_accelerations(trajectory) if accelerations else []):
        names = quantity.components or ("",)
        for component, column in zip(names, np.atleast_2d(values.T), strict=True):
            key = f"{label}.{component}" if component else label
            columns[key] = column
            units[key] = quantity.unit
    return columns, units


def _named(trajectory: Record, quantity: Quantity) -> list[tuple[str, Array]]:
    """(label, values of shape (n,) or (n, components)) for each name of the quantity."""
    values = getattr(trajectory.block, quantity.field)
    if not quantity.along:
        return [(quantity.name, values)]
    stem, _, part = quantity.name.partition(".")
    names = _names_along(trajectory, quantity.along)
    ending = f".{part}" if part else ""
    return [(f"{stem}.{name}{ending}", values[:, i]) for i, name in enumerate(names)]


def _library(name: str, purpose: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        raise MissingExtraError(name, "analysis", purpose) from None
