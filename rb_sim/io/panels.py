# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Panels of curves with which a run is plotted, and their reference magnitudes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.palette import AXES, ENERGIES
from rb_sim.base.rounding import related
from rb_sim.io.contact_power import smooth_power
from rb_sim.io.messages.robot_description import JointTable
from rb_sim.io.sink import stretches
from rb_sim.mechanics.samples import centers_of_mass, origins
from rb_sim.numerics.rotations import roll_pitch_yaw, rotate, without_jumps

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Jumps of the power of commands at the instants at which they change.
#
# A command acts from a sample on, but that sample still contains the preceding one. So the power at
# the beginning of a sample interval is P(t_k) + (f' - f) v_O + (tau' - tau) w, with the new command
# f', tau'.


class _Shown(NamedTuple):
    """Values of the M commanded bodies at the samples, shape (n, M, ...), world axes."""

    command: Array
    orientation: Array
    motion: Array
    """velocity of the origin and angular velocity, six components."""


class CommandJumps:
    """Jumps of the power of commands, for successive blocks of a run."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        self._commanded = layout.commanded
        self._bodies = [layout.bodies.index(name) for name in layout.commanded]
        self._last: _Shown | None = None

    def __call__(self, block: SampleBlock) -> Array:
        """Jump of the power [W] at the start of the interval before each sample, (n,)."""
        jumps = np.zeros(len(block))
        if not self._commanded or not len(block):
            return jumps
        shown = self._shown(block)
        before = shown if self._last is None else _behind(self._last, shown)
        given = {(one.index, one.body): one for one in block.inputs if one.body and not one.state}
        for (k, body), one in given.items():
            row, m = k - (self._last is None), self._commanded.index(body)
            if row < 0:  # given before the first sample
                continue
            wrench = np.array([one.force, one.torque])
            if one.frame == "body":
                wrench = rotate(before.orientation[row, m], wrench)
            jumps[k] += (wrench.ravel() - before.command[row, m]) @ before.motion[row, m]
        self._last = _Shown(*(part[-1:] for part in shown))
        return jumps

    def _shown(self, block: SampleBlock) -> _Shown:
        motion = origins(block, self._center_of_mass)
        speeds = np.concatenate([motion.linear_velocity, motion.angular_velocity], axis=2)
        return _Shown(block.command, block.orientation[:, self._bodies], speeds[:, self._bodies])


def _behind(last: _Shown, shown: _Shown) -> _Shown:
    return _Shown(*(np.concatenate(parts) for parts in zip(last, shown, strict=True)))


LEAST_DRAWN = 1e-17
"""Smallest value plotted on a logarithmic axis; smaller ones are drawn as this."""

_ENERGIES = tuple(ENERGIES[name] for name in ("kinetic", "potential", "total"))


class Panel(NamedTuple):
    """One pair of axes in plots.png and in a recording. values: function of a block, shape (n,
    number of labels)."""

    entity: str
    """path below `plots` in a recording."""
    title: str
    """title without unit."""
    unit: str
    labels: tuple[str, ...]
    colors: tuple[str, ...]
    values: Callable[[SampleBlock], Array]
    kind: str
    """kind of quantity, see `scales`."""
    body: str | None = None
    """body on whose page it is; None: the page of the whole scene."""
    logarithmic: bool = False
    contact: int | None = None
    """index of the contact point whose state is shown below the curves."""
    jumps: bool = False
    """whether it may jump at changes of contact."""
    held: bool = False
    """whether a value holds since the preceding sample, instead of linear interpolation."""

    @property
    def heading(self) -> str:
        """Title with unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


Accelerating = Callable[["SampleBlock"], "tuple[Array, Array]"]
"""Function of a block: accelerations, world axes, and angular ones, body axes, (n, bodies, 3)."""


def panels_of(
    scene: Scene, layout: SampleLayout, accelerations: Accelerating | None = None
) -> list[Panel]:
    """All panels, body by body, then those of the whole scene."""
    return [
        *_body_panels(layout),
        *_joint_panels(scene, layout),
        *([] if accelerations is None else _acceleration_panels(layout, accelerations)),
        *_command_panels(layout),
        *_reaction_panels(layout),
        *_energy_panels(scene, layout),
    ]


def _body_panels(layout: SampleLayout) -> Iterator[Panel]:
    for i, name in enumerate(layout.bodies):
        title = f"{name}: position of the centre of mass, world"
        yield _xyz(f"{name}/position", title, "m", "position", i, "length", name)
        title = f"{name}: roll, pitch, yaw about the world's x, y, z"
        yield Panel(f"{name}/angles", title, "°", ANGLES, AXES[:3], Angles(i), "angle", name)
        title = f"{name}: orientation, quaternion body to world"
        column, labels = _column("orientation", i), tuple("xyzw")
        yield Panel(f"{name}/orientation", title, "", labels, AXES, column, "attitude", name)
        title = f"{name}: velocity of the centre of mass, world"
        entity = f"{name}/velocity"
        yield _xyz(entity, title, "m/s", "linear_velocity", i, "speed", name, jumps=True)
        title = f"{name}: angular velocity ω, body axes"
        entity = f"{name}/angular_velocity"
        yield _xyz(entity, title, "rad/s", "angular_velocity", i, "spin", name, jumps=True)


ANGLES = ("roll φ", "pitch θ", "yaw ψ")


class Angles:
    """Roll, pitch and yaw of a body [°], continuous from block to block."""

    def __init__(self, body: int) -> None:
        self._body, self._last = body, None

    def __call__(self, block: SampleBlock) -> Array:
        """Roll, pitch and yaw of the next samples [°], shape (n, 3)."""
        angles = without_jumps(roll_pitch_yaw(block.orientation[:, self._body]), self._last)
        self._last = angles[-1] if len(angles) else self._last
        return np.degrees(angles)


class Joints:
    """Positions of the joints of a scene [°, m], with their names, units and bodies."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._table = JointTable(scene, layout)
        self.names, self.units = self._table.names, self._table.units
        self.bodies = [scene.constraints[name].body for name in self.names]  # type: ignore[attr-defined]
        self._found: tuple[Any, Any] = None, ()

    def __call__(self, block: SampleBlock, j: int) -> Array:
        """Position of joint j, shape (n, 1); cached for the block."""
        if self._found[0] is not block:
            positions = self._table.values(block)[:, : len(self.names)]
            angular = [unit == "rad" for unit in self.units]
            positions[:, angular] = np.degrees(positions[:, angular])
            self._found = block, positions
        return self._found[1][:, j : j + 1]


def _joint_panels(scene: Scene, layout: SampleLayout) -> Iterator[Panel]:
    joints = Joints(scene, layout)
    for j, (name, unit, body) in enumerate(
        zip(joints.names, joints.units, joints.bodies, strict=True)
    ):
        what, shown, kind = (
            ("angle", "°", "angle") if unit == "rad" else ("displacement", "m", "length")
        )
        title, values = f"{name}: {what} from the first sample", partial(joints, j=j)
        yield Panel(f"joints/{name}", title, shown, (name,), (AXES[3],), values, kind, body)


def _command_panels(layout: SampleLayout) -> Iterator[Panel]:
    for i, name in enumerate(layout.commanded):
        about = {"force": ", world axes", "torque": " about the body origin, world axes"}
        parts = (("N", "force", slice(3)), ("N m", "torque", slice(3, 6)))
        for unit, kind, part in parts:
            columns = partial(_commanded, i=i, part=part)
            entity, title = f"command/{name}/{kind}", f"{name}: commanded {kind}{about[kind]}"
            labels, colors = tuple("xyz"), AXES[:3]
            yield Panel(entity, title, unit, labels, colors, columns, kind, name, held=True)


def _commanded(block: SampleBlock, i: int, part: slice) -> Array:
    return block.command[:, i, part]


def _acceleration_panels(layout: SampleLayout, of: Accelerating) -> Iterator[Panel]:
    found: list[Any] = [None, ()]

    def part(which: int, i: int) -> Callable[[SampleBlock], Array]:
        def values(block: SampleBlock) -> Array:
            if found[0] is not block:  # computed once for all panels
                found[:] = block, of(block)
            return found[1][which][:, i]

        return values

    kinds = (
        ("m/s²", "acceleration", "acceleration of the centre of mass, world"),
        ("rad/s²", "turning", "angular acceleration, body axes"),
    )
    for i, name in enumerate(layout.bodies):
        for k, (unit, kind, what) in enumerate(kinds):
            labels, colors, values = tuple("xyz"), AXES[:3], part(k, i)
            title = f"{name}: {what}"
            yield Panel(
                f"{name}/{kind}", title, unit, labels, colors, values, kind, name, jumps=True
            )


def _reaction_panels(layout: SampleLayout) -> Iterator[Panel]:
    for k, name in enumerate(layout.reactions):
        body = layout.reaction_bodies[k]
        c = layout.contacts.index(name) if name in layout.contacts else None
        title = f"{name}: reaction force on {body}, world axes"
        force = _xyz(
            f"reactions/{name}/force", title, "N", "reaction_force", k, "force", body, jumps=True
        )
        yield force._replace(contact=c)
        about = "the centre of mass" if f"{name}/2" in layout.reactions else "its anchor"
        title = f"{name}: reaction torque about {about}"
        yield _xyz(
            f"reactions/{name}/torque",
            title,
            "N m",
            "reaction_torque",
            k,
            "torque",
            body,
            jumps=True,
        )


def _energy_panels(scene: Scene, layout: SampleLayout) -> Iterator[Panel]:
    labels = ("kinetic", "potential", "total")
    yield Panel("energy", "energy", "J", labels, _ENERGIES, _energies, "energy", jumps=True)
    labels, colors = ("E − E(0)", "work"), (ENERGIES["total"], ENERGIES["work"])
    title, of = "energy change, work of forces without potential", "balance"
    yield Panel(of, title, "J", labels, colors, Balance(scene, layout), "energy", jumps=True)
    title, grey = "power of forces without potential", (AXES[3],)
    yield Panel("power", title, "W", ("power",), grey, _power, "power", jumps=True)
    title = "worst violation of a constraint, relative to the scene's scale"
    labels = ("residual",)
    yield Panel("residual", title, "", labels, grey, _residual, "residual", logarithmic=True)


class Balance:
    """Energy change since the first sample and work done; restart at a reset or set state.

    Work of contacts is taken from the samples; the rest by the trapezoidal rule between changes of
    commands.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._scene, self._layout = scene, layout
        self._begin()

    def _begin(self) -> None:
        self._jumps = CommandJumps(self._scene, self._layout)
        self._first_contact_work = 0.0
        self._first: float | None = None
        self._last: tuple[float, float] | None = None
        self._work = 0.0

    def __call__(self, block: SampleBlock) -> Array:
        """Change of energy and work of the next samples [J], shape (n, 2)."""
        found = [np.empty((0, 2))]
        for part, given in stretches(block):
            if given is not None:
                self._begin()
            if len(part):
                found.append(self._of(part))
        return np.concatenate(found)

    def _of(self, block: SampleBlock) -> Array:
        if self._first is None:
            self._first = float(block.energy[0])
            self._first_contact_work = float(block.contact_work[0])
        power = smooth_power(block, self._scene, self._layout)
        t0, p0 = self._last or (float(block.t[0]), float(power[0]))
        steps = np.maximum(0.0, np.diff(block.t, prepend=t0))  # also where time goes back
        begun = np.concatenate([[p0], power[:-1]]) + self._jumps(block)
        means = 0.5 * (power + begun)
        work = self._work + np.cumsum(steps * means)
        self._last, self._work = (float(block.t[-1]), float(power[-1])), float(work[-1])
        contacts = block.contact_work - self._first_contact_work
        return np.c_[block.energy - self._first, work + contacts]


def _xyz(
    entity: str, title: str, unit: str, field: str, index: int, kind: str, body: str, **more: Any
) -> Panel:
    values, labels = _column(field, index), tuple("xyz")
    return Panel(entity, title, unit, labels, AXES[:3], values, kind, body, **more)


def _column(field: str, index: int) -> Callable[[SampleBlock], Array]:
    return lambda block: getattr(block, field)[:, index]


def _energies(block: SampleBlock) -> Array:
    return np.c_[block.kinetic_energy, block.potential_energy, block.energy]


def _power(block: SampleBlock) -> Array:
    return block.power[:, None]


def _residual(block: SampleBlock) -> Array:
    return np.maximum(block.residual, LEAST_DRAWN)[:, None]


def scales(scene: Scene, panels: list[Panel], values: list[Array]) -> dict[str, float]:
    """Reference magnitude of each kind of quantity in this run.

    values: of each panel, shape (n, labels).
    """
    reaches = [body.shape.reach for body in scene.bodies.values() if body.shape is not None]
    size = {"length": max(reaches, default=0.0), "energy": 0.0}
    for panel, rows in zip(panels, values, strict=True):
        finite = np.where(np.isfinite(rows), rows, 0.0)
        if not finite.size:
            continue
        if panel.kind == "length":
            largest = float(np.ptp(finite, axis=0).max())
        elif panel.kind == "energy":
            largest = max(*np.ptp(finite, axis=0).tolist(), float(np.abs(finite[:, 0]).max()))
        else:
            largest = float(np.abs(finite).max())
        size[panel.kind] = max(size.get(panel.kind, 0.0), largest)
    return related(size | {"attitude": 1.0, "angle": 180.0, "residual": 1.0}, size["length"])
