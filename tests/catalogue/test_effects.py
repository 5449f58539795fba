# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every effect on a free body against its closed form."""

from __future__ import annotations

import math
import re
from typing import Any, get_type_hints

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import load_scene
from rb_sim.base.errors import SceneError
from rb_sim.catalogue.effects import SPECS
from rb_sim.catalogue.types import CENTRAL, WORLD, BodyState, Inertial, wrench
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.runs import trajectory

MASS, INERTIA = 1.6, 0.3
TIGHT = 1e-10


def run(effects: dict[str, Any], duration: float = 1.0, **body: Any) -> Any:
    own = {"mass": MASS, "inertia": [INERTIA, INERTIA, INERTIA]} | body
    effects = {name: {"body": "b"} | effect for name, effect in effects.items()}
    if "gravity" in effects:
        effects["gravity"].pop("body")
    scene = {"bodies": {"b": own}, "effects": effects}
    return trajectory(scene, duration=duration, rate=20.0, tolerance=1e-13)


def test_gravity_is_a_parabola() -> None:
    g = np.array([0.4, -0.2, -9.7])
    got = run({"gravity": {"type": "gravity", "acceleration": g.tolist()}})
    assert_allclose(got.position[:, 0], 0.5 * got.t[:, None] ** 2 * g, atol=TIGHT)


def test_linear_drag_decays_towards_the_wind() -> None:
    wind, c = np.array([1.0, 0.0, -0.5]), 0.9
    drag = {"type": "linear_drag", "coefficient": c, "medium_velocity": wind.tolist()}
    got = run({"drag": drag}, linear_velocity=[0.0, 3.0, 0.0])
    decay = np.exp(-c / MASS * got.t)[:, None]
    expected = wind + (np.array([0.0, 3.0, 0.0]) - wind) * decay
    assert_allclose(got.linear_velocity[:, 0], expected, atol=TIGHT)


def test_quadratic_drag_reaches_its_terminal_speed() -> None:
    c, g = 0.5, 9.81
    terminal = math.sqrt(MASS * g / c)
    got = run(
        {
            "gravity": {"type": "gravity", "acceleration": [0.0, 0.0, -g]},
            "drag": {"type": "quadratic_drag", "coefficient": c},
        },
        duration=3.0,
    )
    expected = -terminal * np.tanh(g * got.t / terminal)
    assert_allclose(got.linear_velocity[:, 0, 2], expected, atol=TIGHT)


def test_angular_damping_decays() -> None:
    c, w = 0.2, np.array([1.0, -2.0, 0.5])
    got = run({"d": {"type": "angular_damping", "coefficient": c}}, angular_velocity=w.tolist())
    assert_allclose(
        got.angular_velocity[:, 0], w * np.exp(-c / INERTIA * got.t)[:, None], atol=TIGHT
    )


def test_spring_with_damper_rings_down() -> None:
    """Along its own line: x = l0 + a e^(-b t) (cos w t + b/w sin w t)."""
    k, c, rest, stretch = 50.0, 1.2, 0.7, 0.2
    spring = {"type": "spring", "stiffness": k, "damping": c, "rest_length": rest}
    got = run({"s": spring}, position=[rest + stretch, 0.0, 0.0])
    b = 0.5 * c / MASS
    w = math.sqrt(k / MASS - b * b)
    ring = np.exp(-b * got.t) * (np.cos(w * got.t) + b / w * np.sin(w * got.t))
    assert_allclose(got.position[:, 0, 0], rest + stretch * ring, atol=TIGHT)


def test_torsion_spring_swings_about_its_rest_angle() -> None:
    k, rest = 3.0, 0.4
    spring = {"type": "torsion_spring", "axis_B": [0.0, 0.6, 0.8], "stiffness": k}
    got = run({"s": spring | {"rest_angle": rest}})
    w = math.sqrt(k / INERTIA)
    angle = rest * (1.0 - np.cos(w * got.t))
    expected = np.outer(np.sin(0.5 * angle), [0.0, 0.6, 0.8])
    assert_allclose(got.orientation[:, 0, :3], expected, atol=TIGHT)
    assert_allclose(got.energy, got.energy[0], atol=TIGHT)


def test_harmonic_wrench() -> None:
    """a = A sin(w t + phi) / m twice integrated."""
    w, phi, amplitude = 7.0, 0.3, 2.0
    push = {"type": "wrench", "sine_force": [amplitude, 0.0, 0.0], "angular_frequency": w}
    got = run({"p": push | {"phase": phi}})
    drift = math.cos(phi) * w * got.t + math.sin(phi) - np.sin(w * got.t + phi)
    assert_allclose(got.position[:, 0, 0], amplitude / (MASS * w * w) * drift, atol=TIGHT)


def test_tabulated_wrench() -> None:
    """The change of momentum is the area under the table, whatever the steps."""
    table = {
        "type": "wrench_table",
        "times": [0.1, 0.333, 0.7],
        "forces": [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
    }
    area = {"linear": 0.233 * 2.0 + 0.367 * 1.0, "hold": 0.233 * 1.0 + 0.367 * 3.0}
    for interpolation, expected in area.items():
        got = run({"t": table | {"interpolation": interpolation}})
        assert_allclose(MASS * got.linear_velocity[-1, 0, 0], expected, atol=1e-12)
        assert_allclose(got.linear_velocity[got.t < 0.1], 0.0)


def test_wrench_in_body_axes_turns_with_the_body() -> None:
    """A body that spins at w under a force fixed in it moves on a circle's arc of velocity."""
    w, f = 4.0, 1.5
    push = {"type": "wrench", "frame": "body", "force": [f, 0.0, 0.0]}
    got = run({"p": push}, angular_velocity=[0.0, 0.0, w])
    turned = np.stack([np.sin(w * got.t), 1.0 - np.cos(w * got.t)], axis=-1)
    assert_allclose(got.linear_velocity[:, 0, :2], f / (MASS * w) * turned, atol=TIGHT)


def test_the_catalogue_says_which_forces_are_central() -> None:
    assert {"gravity", "linear_drag", "quadratic_drag"} < set(SPECS)
    rows = {"GravityRow", "LinearDragRow", "QuadraticDragRow"}
    assert {kind.__name__ for kind in CENTRAL} >= rows


@pytest.mark.parametrize("kind", sorted(CENTRAL, key=lambda kind: kind.__name__))
def test_a_central_force_has_no_torque_and_does_not_see_the_body_turn(kind: Any) -> None:
    fields = get_type_hints(kind).values()
    values = [0.7 if field is float else (0.3, -1.2, 0.5) for field in fields]
    body = Inertial(MASS, (1.0, 2.0, 2.7, 0.1, 0.2, 0.3), (0.1, 0.2, 0.3))
    p, v = (0.4, 0.1, -0.2), (1.0, 2.0, -0.5)
    still = BodyState(p, (0.0, 0.0, 0.0, 1.0), v, (0.0, 0.0, 0.0))
    turned = BodyState(p, (0.5, -0.5, 0.5, 0.5), v, (3.0, -2.0, 1.0))
    force, torque = wrench(kind(*values), 0.3, body, still, WORLD)
    assert torque == (0.0, 0.0, 0.0) and force != torque
    assert wrench(kind(*values), 0.3, body, turned, WORLD) == (force, torque)


@pytest.mark.parametrize(
    ("effect", "place"),
    [
        ({"type": "wrench", "force": [0, 0, 1e101]}, "force[2]"),
        ({"type": "wrench", "sine_torque": [0, -1e155, 0]}, "sine_torque[1]"),
        ({"type": "wrench_table", "times": [0, 1], "forces": [[0, 0, 0], [1e160, 0, 0]]}, "[0]"),
        ({"type": "gravity", "acceleration": [0, 0, -1e155]}, "acceleration[2]"),
    ],
)
def test_what_overflows_when_it_is_squared_is_refused(effect: dict[str, Any], place: str) -> None:
    """Contacts went on as if nothing pushed; a command of that size is refused, too."""
    on = {} if effect["type"] == "gravity" else {"body": "a"}
    scene = {"bodies": {"a": {"mass": 1.0, "inertia": [1, 1, 1]}}, "effects": {"e": effect | on}}
    with pytest.raises(
        SceneError, match=rf"{re.escape(place)}: got .* must be a number [<>]= -?1e"
    ):
        load_scene(scene)


@pytest.mark.parametrize("law", [{"stiffness": 100.0}, {"damping": 1.0}], ids=str)
@pytest.mark.parametrize("apart", [0.0, 1e-16])
def test_a_spring_whose_ends_coincide_is_refused_if_it_has_a_rest_length(
    law: dict[str, float], apart: float
) -> None:
    """Its force points nowhere: every method told that its step is too large."""
    spring = {"type": "spring", "body": "b", "point_A": [0.0, 0.0, 1.0 + apart]} | law
    body = {"mass": 1.0, "inertia": [1.0] * 3, "position": [0.0, 0.0, 1.0]}
    scene = {"bodies": {"b": body}, "effects": {"rope": spring | {"rest_length": 0.5}}}
    with pytest.raises(SceneError, match=r"effects.rope: its ends coincide at the start"):
        compile_scene(scene_from_mapping(scene))
    scene["effects"]["rope"] = spring
    compile_scene(scene_from_mapping(scene))
