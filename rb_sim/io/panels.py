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
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.palette import AXES, ENERGIES
from rb_sim.base.rounding import related
from rb_sim.io.contact_power import smooth_power
from rb_sim.io.messages.robot_description import JointTable
from rb_sim.io.sink import stretches
from rb_sim.mechanics.samples import centers_of_mass, origins
from rb_sim.numerics.rotations import roll_pitch_yaw, without_jumps

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


LEAST_DRAWN = 1e-17
"""Smallest value plotted on a logarithmic axis; smaller ones are drawn as this."""

ANGLES = ("roll φ", "pitch θ", "yaw ψ")
_ENERGIES = tuple(ENERGIES[name] for name in ("kinetic", "potential", "total"))
_GREY = (AXES[3],)

Values = Callable[["SampleBlock"], "Array"]
Accelerating = Callable[["SampleBlock"], "tuple[Array, Array]"]
"""Function of a block: accelerations, world axes, and angular ones, body axes, (n, bodies, 3)."""


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


def panels_of(
    scene: Scene, layout: SampleLayout, accelerations: Accelerating | None = None
) -> list[Panel]:
    """All panels, body by body, then those of the whole scene."""
    return [
        *_body_panels(layout),
        *_joint_panels(scene, layout),
        *([] if accelerations is None else _acceleration_panels(layout, _once(accelerations))),
        *_command_panels(layout),
        *_reaction_panels(layout),
        *_energy_panels(scene, layout),
    ]


def _once(of: Callable[[SampleBlock], Any]) -> Callable[[SampleBlock], Any]:
    """The function, evaluated once for all panels of a block."""
    last: list[Any] = [None, None]

    def values(block: SampleBlock) -> Any:
        if last[0] is not block:
            last[:] = block, of(block)
        return last[1]

    return values


def _vector(
    entity: str, title: str, unit: str, kind: str, body: str, values: Values, **more: Any
) -> Panel:
    """A panel of components in the colours of their axes."""
    labels = more.pop("labels", tuple("xyz"))
    return Panel(entity, title, unit, labels, AXES[: len(labels)], values, kind, body, **more)


def _column(field: str, *index: Any) -> Values:
    return lambda block: getattr(block, field)[:, *index]


def _body_panels(layout: SampleLayout) -> Iterator[Panel]:
    for i, name in enumerate(layout.bodies):
        title = f"{name}: position of the centre of mass, world"
        yield _vector(f"{name}/position", title, "m", "length", name, _column("position", i))
        title = f"{name}: roll, pitch, yaw about the world's x, y, z"
        yield _vector(f"{name}/angles", title, "°", "angle", name, Angles(i), labels=ANGLES)
        title, q = f"{name}: orientation, quaternion body to world", _column("orientation", i)
        entity, labels = f"{name}/orientation", tuple("xyzw")
        yield _vector(entity, title, "", "attitude", name, q, labels=labels)
        title, v = f"{name}: velocity of the centre of mass, world", _column("linear_velocity", i)
        yield _vector(f"{name}/velocity", title, "m/s", "speed", name, v, jumps=True)
        title, w = f"{name}: angular velocity ω, body axes", _column("angular_velocity", i)
        yield _vector(f"{name}/angular_velocity", title, "rad/s", "spin", name, w, jumps=True)


class Angles:
    """Roll, pitch and yaw of a body [°], continuous from block to block."""

    def __init__(self, body: int) -> None:
        self._body, self._last = body, None

    def __call__(self, block: SampleBlock) -> Array:
        """Roll, pitch and yaw of the next samples [°], shape (n, 3)."""
        angles = without_jumps(roll_pitch_yaw(block.orientation[:, self._body]), self._last)
        self._last = angles[-1] if len(angles) else self._last
        return np.degrees(angles)


def _joint_panels(scene: Scene, layout: SampleLayout) -> Iterator[Panel]:
    table = JointTable(scene, layout)
    of = _once(lambda block: table.values(block))
    for j, (name, unit) in enumerate(zip(table.names, table.units, strict=True)):
        what, shown, kind = "displacement", "m", "length"
        if unit == "rad":
            what, shown, kind = "angle", "°", "angle"
        factor = np.degrees(1.0) if unit == "rad" else 1.0
        title, body = f"{name}: {what} from the first sample", scene.constraints[name].body  # type: ignore[attr-defined]

        def values(block: SampleBlock, j: int = j, factor: float = factor) -> Array:
            return factor * of(block)[:, j : j + 1]

        yield Panel(f"joints/{name}", title, shown, (name,), _GREY, values, kind, body)


def _command_panels(layout: SampleLayout) -> Iterator[Panel]:
    for i, name in enumerate(layout.commanded):
        for unit, kind, part, about in (
            ("N", "force", slice(3), ", world axes"),
            ("N m", "torque", slice(3, 6), " about the body origin, world axes"),
        ):
            entity, title = f"command/{name}/{kind}", f"{name}: commanded {kind}{about}"
            yield _vector(entity, title, unit, kind, name, _column("command", i, part), held=True)


def _acceleration_panels(layout: SampleLayout, of: Accelerating) -> Iterator[Panel]:
    for i, name in enumerate(layout.bodies):
        for k, (unit, kind, what) in enumerate((
            ("m/s²", "acceleration", "acceleration of the centre of mass, world"),
            ("rad/s²", "turning", "angular acceleration, body axes"),
        )):  # fmt: skip

            def values(block: SampleBlock, k: int = k, i: int = i) -> Array:
                return of(block)[k][:, i]

            yield _vector(f"{name}/{kind}", f"{name}: {what}", unit, kind, name, values, jumps=True)


def _reaction_panels(layout: SampleLayout) -> Iterator[Panel]:
    for k, name in enumerate(layout.reactions):
        body, entity = layout.reaction_bodies[k], f"reactions/{name}"
        contact = layout.contacts.index(name) if name in layout.contacts else None
        title, values = (
            f"{name}: reaction force on {body}, world axes",
            _column("reaction_force", k),
        )
        more = {"jumps": True, "contact": contact}
        yield _vector(f"{entity}/force", title, "N", "force", body, values, **more)
        about = "the centre of mass" if f"{name}/2" in layout.reactions else "its anchor"
        title, values = f"{name}: reaction torque about {about}", _column("reaction_torque", k)
        yield _vector(f"{entity}/torque", title, "N m", "torque", body, values, jumps=True)


def _energy_panels(scene: Scene, layout: SampleLayout) -> Iterator[Panel]:
    labels = ("kinetic", "potential", "total")
    yield Panel("energy", "energy", "J", labels, _ENERGIES, _energies, "energy", jumps=True)
    labels, colors = ("E − E(0)", "work"), (ENERGIES["total"], ENERGIES["work"])
    title, of = "energy change, work of forces without potential", "balance"
    yield Panel(of, title, "J", labels, colors, Balance(scene, layout), "energy", jumps=True)
    title, power = "power of forces without potential", _column("power", None)
    yield Panel("power", title, "W", ("power",), _GREY, power, "power", jumps=True)
    title = "worst violation of a constraint, relative to the scene's scale"
    labels = ("residual",)
    yield Panel("residual", title, "", labels, _GREY, _residual, "residual", logarithmic=True)


class Balance:
    """Energy change since the first sample and work done; restart at a reset or set state.

    Work of contacts is taken from the samples; the rest by the trapezoidal rule between changes of
    commands: a command acts from a sample on, but that sample still has the preceding one, so that
    the interval begins with the power P + (f' - f) v_O + (tau' - tau) w, with the new command.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._scene, self._layout = scene, layout
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        self._commanded = [layout.bodies.index(name) for name in layout.commanded]
        self._begin()

    def _begin(self) -> None:
        self._first = self._last = None
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
        motion: Any = origins(block, self._center_of_mass) if self._commanded else block
        speeds = np.concatenate([motion.linear_velocity, motion.angular_velocity], axis=2)
        power = smooth_power(block, self._scene, self._layout)
        own: Any = block.t, power, block.command, speeds[:, self._commanded]
        last = self._last or [column[0] for column in own]
        if self._first is None:
            self._first = np.array([block.energy[0], block.contact_work[0]])
        t, begun, command, speed = (
            np.concatenate([[before], column[:-1]])
            for before, column in zip(last, own, strict=True)
        )
        new = sorted({given.index for given in block.inputs if given.body and not given.state})
        begun[new] += np.sum((block.command - command)[new] * speed[new], axis=(1, 2))
        steps = np.maximum(0.0, block.t - t)  # also where time goes back
        work = self._work + np.cumsum(steps * 0.5 * (power + begun))
        self._last, self._work = [column[-1] for column in own], float(work[-1])
        return np.c_[block.energy, work + block.contact_work] - self._first


def _energies(block: SampleBlock) -> Array:
    return np.c_[block.kinetic_energy, block.potential_energy, block.energy]


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
