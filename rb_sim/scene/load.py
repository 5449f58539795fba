# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Load and validate scenes from files and mappings; all errors of a scene form one SceneError of
one line."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.base.errors import SceneError, SceneWarning
from rb_sim.base.names import one_of, ros_name
from rb_sim.scene import yaml_reader
from rb_sim.scene.listing import find_scene
from rb_sim.scene.schema import (
    FIXED_STEP_METHODS,
    TOLERANCE_METHODS,
    Body,
    Scene,
    SimulationOptions,
    StaticsScene,
)
from rb_sim.scene.yaml_reader import render, scene_error, validated

# Warnings about valid values that often mean something else, one line each.


SHOWN = 12
"""Most names listed in one line."""

DENSEST = 3e5
"""Density [kg/m^3] above which a mass is probably given in grams: osmium has 2.3e4, water in grams
1e6."""

LIGHTEST = 3e-5
"""Density [kg/m^3] below which lengths are probably given in millimetres: aerogel has 0.2, osmium
2.3e-5 kg/mm^3."""

ANGLES = {"phase", "rest_angle"}
"""Keys of effects that hold an angle [rad]."""

STRENGTHS = {
    "acceleration", "coefficient", "damping", "force", "sine_force", "sine_torque", "stiffness",
    "torque",
}  # fmt: skip
"""Keys of effects to which their forces are proportional, or which are the forces."""

STEEPEST = 10.0
"""Coefficient of friction above which an angle in degrees is likelier: tan of 84 degrees; rubber on
rough ground has up to 4."""

FAR_FROM_UNIT = 1e-2
"""Deviation of a quaternion's length from 1 that rounding to two digits does not explain."""


def habits(data: Mapping[str, Any], scene: Scene) -> Iterator[str]:
    """Warnings for values that may be misread: key, value, its meaning, and how to write the other
    one."""
    for name in scene.bodies:
        given = data["bodies"][name]
        written = given.get("orientation") if isinstance(given, Mapping) else None
        if isinstance(written, (list, tuple)) and len(written) == 4:
            yield from _quaternion(f"bodies.{name}.orientation", [float(x) for x in written])
        elif isinstance(written, Mapping):
            yield from _angle(f"bodies.{name}.orientation.angle", written.get("angle"))
        yield from _density(name, scene.bodies[name])
        yield from _spread(name, scene.bodies[name])
    for part in ("effects", "loads"):
        for name, given in (data.get(part) or {}).items():
            for key in ANGLES & given.keys() if isinstance(given, Mapping) else ():
                yield from _angle(f"{part}.{name}.{key}", given[key])
    for name, effect in scene.effects.items():
        yield from _silent_wave(f"effects.{name}.angular_frequency", effect)
        yield from _idle(f"effects.{name}", effect)
        yield from _upwards(f"effects.{name}.acceleration", effect, scene)
    for name, spec in scene.constraints.items():
        yield from _plane(f"constraints.{name}.surface", spec, scene)
        yield from _steep(f"constraints.{name}.friction", spec)
    if scene.at_rest:
        return
    called = {name: ros_name(name) for name in (*scene.bodies, *scene.constraints)}
    if others := [f"{name} -> {to}" for name, to in called.items() if name != to]:
        more = f", and {len(others) - SHOWN} more" if len(others) > SHOWN else ""
        yield f"names in ROS topics, frames and joints: {', '.join(others[:SHOWN])}{more}"
    still = not any(any(b.linear_velocity + b.angular_velocity) for b in scene.bodies.values())
    resisting = ("linear_drag", "quadratic_drag", "angular_damping")  # unless the medium flows
    pushed = any(
        effect.type not in resisting or any(getattr(effect, "medium_velocity", ()))
        for effect in scene.effects.values()
    )
    driven = any(
        getattr(spec, "rate", 0.0) or getattr(spec, "motion", None) is not None
        for spec in scene.constraints.values()
    )
    if still and not pushed and not driven:
        yield (
            f"nothing moves: the scene has no effects{' but drag' if scene.effects else ''} and no "
            "body has a velocity; for gravity add effects: {weight: {type: gravity}}"
        )


def _quaternion(key: str, q: list[float]) -> Iterator[str]:
    if q[0] != 0.0 and q[3] == 0.0:
        axis, w_first = (render([float(f"{x:.6g}") for x in of]) for of in (q[:3], q[1:] + q[:1]))
        yield (
            f"{key}: {render(q)} is half a turn about {axis}, since the order is [x, y, z, w]; if "
            f"w is meant to be first use {w_first}, for half a turn {{axis: {axis}, angle: 180 "
            "deg}"
        )
    elif abs(math.hypot(*q) - 1.0) > FAR_FROM_UNIT:
        yield (
            f"{key}: the quaternion has length {math.hypot(*q):.4g} and is scaled to 1; for an "
            "angle about an axis use {axis: [x, y, z], angle: 30 deg}"
        )


def _angle(key: str, angle: Any) -> Iterator[str]:
    """Warn of a whole number above half a turn: it is likely in degrees, not radians."""
    if isinstance(angle, (int, float)) and abs(angle) > math.pi and angle == round(angle):
        yield (
            f"{key}: {angle:g} is in radians ({math.degrees(angle):.4g} degrees); use "
            f"{angle:g} deg "
            f"for degrees, or {angle:g} rad to confirm radians"
        )


def _density(name: str, body: Body) -> Iterator[str]:
    """Warn of a mass that no solid has within the radius of the body's shape."""
    reach = 0.0 if body.shape is None else body.shape.reach
    known = reach > 0.0 and body.mass > 0.0  # bodies at rest may be without a mass
    density = body.mass / (4.0 / 3.0 * math.pi * reach**3) if known else 1.0
    about = f"bodies.{name}.mass: {body.mass:g} kg within a radius of {reach:.3g} m is"
    if density > DENSEST:
        yield (
            f"{about} denser than any solid; masses are in kg (from grams: "
            f"{1e-3 * body.mass:g}), lengths in m"
        )
    if density < LIGHTEST:
        yield f"{about} lighter than any solid; lengths are in m (from mm: {1e-3 * reach:.3g})"


def _spread(name: str, body: Body) -> Iterator[str]:
    """Warn of an inertia that no mass within the body's shape has."""
    if body.shape is None or body.given_inertia is None:
        return
    reach = body.shape.reach + math.dist(body.shape.center_B, body.center_of_mass)
    most = float(np.linalg.eigvalsh(np.array(body.inertia)).max())
    if most > body.mass * reach**2:
        yield (
            f"bodies.{name}.inertia: {most:g} kg m^2 is more than {body.mass:g} kg within a radius "
            f"of {reach:.3g} m can have ({body.mass * reach**2:.3g}); leave it out for that of the "
            "shape with uniform density"
        )


def _idle(key: str, effect: Any) -> Iterator[str]:
    """Warn of an effect all of whose strengths are zero."""
    strengths = [name for name in type(effect).model_fields if name in STRENGTHS]
    if strengths and not any(map(np.any, (getattr(effect, name) for name in strengths))):
        are = "are all" if len(strengths) > 1 else "is"
        yield f"{key}: does nothing: {', '.join(strengths)} {are} zero"


def _upwards(key: str, effect: Any, scene: Scene) -> Iterator[str]:
    """Warn of a weight that pulls away from every plane of the world that bodies touch."""
    surfaces: list[Any] = [
        getattr(spec, "surface", None)
        for spec in scene.constraints.values()
        if getattr(spec, "parent", None) is None
    ]
    planes = [np.array(of.normal) for of in surfaces if getattr(of, "type", "") == "plane"]
    if effect.type == "gravity" and planes:
        g = np.array(effect.acceleration)
        if all(normal @ g > 0.0 for normal in planes):
            down = render([-x + 0.0 for x in effect.acceleration])
            yield (
                f"{key}: {render(list(effect.acceleration))} points out of the planes of all "
                f"contacts, so that nothing rests on them; use {down}, or reverse their normals"
            )


def _steep(key: str, spec: Any) -> Iterator[str]:
    """Warn of a coefficient of friction that is likely an angle in degrees."""
    law = getattr(spec, "friction", None)
    name = {"coulomb": "static", "regularised": "coefficient"}.get(getattr(law, "type", ""))
    if name is not None:
        ratio = getattr(law, name)
        if ratio >= STEEPEST:
            angle = f"{ratio:g} degrees: {math.tan(math.radians(ratio)):.3g}; " * (ratio < 90.0)
            yield (
                f"{key}.{name}: {ratio:g} is a ratio of forces, above that of any surface "
                f"({angle}no slip at all: {{type: rough}})"
            )


def _silent_wave(key: str, effect: Any) -> Iterator[str]:
    """Warn of a harmonic force that is zero at all times."""
    waves = (*getattr(effect, "sine_force", ()), *getattr(effect, "sine_torque", ()))
    if any(waves) and effect.angular_frequency == effect.phase == 0.0:
        yield f"{key}: is 0, so that the harmonic part is zero; must be given [rad/s]"


def _plane(key: str, spec: Any, scene: Scene) -> Iterator[str]:
    """A contact with a body that has a shape, which is not named."""
    parent = scene.bodies.get(getattr(spec, "parent", None) or "")
    if spec.type == "contact" and parent is not None and parent.shape is not None:
        if "surface" not in spec.model_fields_set:
            yield (
                f"{key}: not given, so that the support is the endless plane z = 0 through the "
                f"origin of {spec.parent!r}; for its shape use surface: {{type: shape}}, for the "
                "plane surface: {type: plane}"
            )


OVERRIDES = ("duration", "method", "rate", "step", "tolerance")
"""Keys of `simulation` that a caller may override."""

IN_MEMORY = "<scene>"
"""Name in place of a file for a scene made in memory."""


def load_scene(source: str | PathLike[str] | Mapping[str, Any], **overrides: Any) -> Scene:
    """Load and check a scene.

    Args:
        source: Scene file, name of a shipped scene (`rb_sim.scenes()` lists them), mapping, or
            YAML text of several lines.
        overrides: `method`, `step` [s], `tolerance`, `duration` [s] or `rate` [Hz] instead of the
            scene's own; None leaves them. A step drops the scene's tolerance and the other way
            round; a method drops whichever of the two it cannot use.

    Raises:
        SceneError: The scene is not valid; the text names file, key, value and the allowed values.
    """
    if isinstance(source, Mapping) or (isinstance(source, str) and "\n" in source):
        return scene_from_mapping(source, **overrides)
    if not isinstance(source, (str, PathLike)):
        allowed = "a file, the name of a shipped scene, YAML text or a mapping"
        raise SceneError(f"got {source!r:.80}; must be {allowed}", key="scene")
    path = _path_of(source)
    text = yaml_reader.read_text(path)
    data = yaml_reader.parse(text, str(path))
    return _build(data, text, path.stem, str(path), overrides)


def load_statics(
    source: str | PathLike[str] | Mapping[str, Any],
    *,
    name: str = "statics",
    file: str = IN_MEMORY,
) -> StaticsScene:
    """Load and check a scene of bodies at rest, whose mass and inertia may be omitted.

    Args:
        source: As in `load_scene`.
        name: What a scene of a mapping is called.
        file: What its errors call it.

    Raises:
        SceneError: The scene is not valid; the text names file, key, value and the allowed values.
    """
    if isinstance(source, Mapping):
        plain = _plain(source, file)
        text = partial(yaml_reader.write, plain)
        scene = _build(plain, text, name, file, {}, kind=StaticsScene)
    else:
        path = _path_of(source)
        text = yaml_reader.read_text(path)
        data = yaml_reader.parse(text, str(path))
        scene = _build(data, text, path.stem, str(path), {}, kind=StaticsScene)
    assert isinstance(scene, StaticsScene)
    return scene


def is_statics(path: Path) -> bool:
    """Whether a file is a scene of bodies at rest: it has supports or loads.

    Raises SceneError if it is not a YAML file.
    """
    data = yaml_reader.parse(yaml_reader.read_text(path), str(path))
    return isinstance(data, Mapping) and _has_short_form(data)


def _has_short_form(data: Mapping[str, Any]) -> bool:
    return "supports" in data or "loads" in data


def _at_rest(data: Mapping[str, Any]) -> bool:
    """Whether data that is no scene of motion is one of bodies at rest."""
    if not _has_short_form(data):
        return False
    try:
        validated(StaticsScene, data, IN_MEMORY)
    except SceneError:
        return False
    return True


def _path_of(source: str | PathLike[str]) -> Path:
    """Path of a scene: a name without a suffix that is not a file is that of a shipped scene."""
    path = Path(source)
    if isinstance(source, str) and path.name == source and not path.suffix and not path.exists():
        return find_scene(source)
    return path


def scene_from_mapping(
    data: Mapping[str, Any] | str, *, name: str = "scene", file: str = IN_MEMORY, **overrides: Any
) -> Scene:
    """Scene from a mapping (numpy arrays and scalars allowed) or YAML text; as `load_scene`.

    name, file: names of the scene, also in its errors.
    """
    if isinstance(data, str):
        return _build(yaml_reader.parse(data, file), data, name, file, overrides)
    plain = _plain(data, file)
    return _build(plain, partial(yaml_reader.write, plain), name, file, overrides)


def scene_from_plain(
    data: Mapping[str, Any],
    *,
    name: str = "scene",
    file: str = IN_MEMORY,
    text: Callable[[], str] | None = None,
    **overrides: Any,
) -> Scene:
    """As `scene_from_mapping`, for data that a program made: YAML types only, no warnings about
    values.

    Bodies, constraints and effects may be validated specs, which are not validated again; `text`
    writes the YAML then.
    """
    text_of = text or partial(yaml_reader.write, data)
    return _build(data, text_of, name, file, overrides, by_hand=False)


def as_run_text(scene: Scene) -> str:
    """The scene as YAML text with the values of `simulation` as run, overrides included.

    The text of the scene itself if that text cannot be parsed.
    """
    options = scene.simulation.model_dump(mode="json", exclude_none=True)
    try:
        data = yaml_reader.parse(scene.text, scene.file)
    except SceneError:
        return scene.text
    return yaml_reader.write({**data, "simulation": options}) if data else scene.text


def _build(
    data: Any,
    text: str | Callable[[], str],
    name: str,
    file: str,
    overrides: Mapping[str, Any],
    by_hand: bool = True,
    kind: type[Scene] = Scene,
) -> Scene:
    if not isinstance(data, Mapping):
        message = f"got {render(data)}; a scene must be a mapping with bodies"
        raise scene_error(message, (), file)
    try:
        scene = validated(kind, data, file).from_source(name, file, text)
    except SceneError as error:
        if kind is Scene and _at_rest(data):
            raise scene_error(
                f"is for rb_sim statics only: {error.key}: {error.message}", (), file
            ) from None
        raise
    for line in habits(data, scene) if by_hand else ():
        warnings.warn(f"{scene.file}: {line}", SceneWarning, stacklevel=4)
    given = {key: _plain(value, file) for key, value in overrides.items() if value is not None}
    if not given:
        return scene
    options = _overridden(data.get("simulation") or {}, given)
    return scene.model_copy(update={"simulation": options})


def _overridden(own: Mapping[str, Any], given: dict[str, Any]) -> SimulationOptions:
    """The scene's `own` simulation values, replaced by the `given` ones; errors name no file."""
    for key in given:
        if key not in OVERRIDES:
            message = f"unknown option; must be {one_of(key, OVERRIDES)}"
            raise scene_error(message, (key,), "")
    merged = {key: value for key, value in own.items() if key not in _dropped(given)} | given
    return validated(SimulationOptions, merged, "")


def _dropped(given: Mapping[str, Any]) -> set[str]:
    """Keys of the scene that conflict with the given ones."""
    dropped = set()
    if "step" in given or given.get("method") in FIXED_STEP_METHODS:
        dropped.add("tolerance")
    if "tolerance" in given or given.get("method") in TOLERANCE_METHODS:
        dropped.add("step")
    return dropped


def _plain(value: Any, file: str, path: tuple[str | int, ...] = ()) -> Any:
    """`value` in YAML types; refuses other types, keys that are not text, and nesting that is too
    deep."""
    if isinstance(value, np.generic):
        value = value.item()
    elif isinstance(value, np.ndarray):
        value = value.tolist()
    if len(path) > yaml_reader.MAX_DEPTH:
        limit = yaml_reader.MAX_DEPTH
        raise scene_error(f"is nested deeper than {limit} levels", path[:4], file)
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        return math.inf if value > 0 else -math.inf  # as a number in YAML; the models refuse it
    if value is None or isinstance(value, (str, int, float)):
        return value
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise scene_error(f"got the key {render(key)}; must be text", path, file)
        return {str(key): _plain(entry, file, (*path, key)) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry, file, (*path, i)) for i, entry in enumerate(value)]
    allowed = "a number, text, true or false, a list or a mapping"
    raise scene_error(f"got {render(value)}; must be {allowed}", path, file)


# SceneBuilder: a scene in code, entry by entry, as the mapping that `load_scene` takes.


class SceneBuilder:
    """Builds a scene entry by entry; each call returns the builder, so that calls can be chained.

    Keys and values are those of a scene file; `build` checks them.

    Args:
        name: Name of the scene, also in its errors.
        description: One line of text, shown by `rb_sim scenes`.

    Raises:
        SceneError: By `body`, `constraint` and `effect`: the name is taken.
    """

    def __init__(self, name: str = "scene", description: str = "") -> None:
        self._name = name
        self._data: dict[str, Any] = {"bodies": {}, "constraints": {}, "effects": {}}
        if description:
            self._data["description"] = description

    def __repr__(self) -> str:
        parts = [
            f"{section}: {', '.join(self._data[section])}"
            for section in ("bodies", "constraints", "effects")
            if self._data[section]
        ]
        return f"<SceneBuilder {self._name}: {'; '.join(parts) or 'nothing yet'}>"

    def body(self, name: str, **values: Any) -> SceneBuilder:
        """Add a body.

        Args:
            name: Name of the body.
            values: Keys of a body in a scene file: `mass` [kg], `shape` or `inertia` [kg m^2],
                initial pose and velocities.
        """
        return self._put("bodies", name, values)

    def constraint(self, name: str, type: str, **values: Any) -> SceneBuilder:  # noqa: A002
        """Add a constraint.

        Args:
            name: Name of the constraint and of its reaction.
            type: Type of constraint, e.g. "fixed_point".
            values: Keys of that type in a scene file, `body` among them.
        """
        return self._put("constraints", name, {"type": type, **values})

    def effect(self, name: str, type: str, **values: Any) -> SceneBuilder:  # noqa: A002
        """Add an effect.

        Args:
            name: Name of the effect.
            type: Type of effect, e.g. "gravity".
            values: Keys of that type in a scene file.
        """
        return self._put("effects", name, {"type": type, **values})

    def simulate(self, **values: Any) -> SceneBuilder:
        """Set `duration` [s], `rate` [Hz], `method`, `step` [s] or `tolerance` of the scene."""
        self._data["simulation"] = {**self._data.get("simulation", {}), **values}
        return self

    def as_dict(self) -> dict[str, Any]:
        """The scene as a mapping that `load_scene` takes; it is not checked."""
        return {key: value for key, value in self._data.items() if value}

    def as_yaml(self) -> str:
        """The scene as text of a scene file (YAML), checked as by `build`."""
        return self.build().text

    def build(self, **overrides: Any) -> Scene:
        """Check the scene and return it.

        Args:
            overrides: Values of `simulate` that replace those given before.

        Raises:
            SceneError: The scene is not valid; the text names key, value and the allowed values.
        """
        return scene_from_mapping(self.as_dict(), name=self._name, file=self._name, **overrides)

    def _put(self, section: str, name: str, entry: dict[str, Any]) -> SceneBuilder:
        if name in self._data[section]:
            raise SceneError("is given twice", key=f"{section}.{name}", file=self._name)
        self._data[section][name] = entry
        return self
