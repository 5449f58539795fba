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
from typing import Any, Literal, get_type_hints

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SceneError
from rb_sim.catalogue.spec import CENTRAL, WORLD, BodyState, Inertial, potential, wrench
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.moving import floats, random_state
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


# Prescribed wrenches at one instant: force and torque about C by hand, in both axes.


Axes = Literal["world", "body"]
AXES: tuple[Axes, ...] = ("world", "body")
CENTRE, POINT = np.array([0.04, -0.03, 0.05]), np.array([0.1, 0.2, -0.3])
STATE = BodyState((0.4, 0.1, -0.2), (0.5, -0.1, 0.7, 0.5), (1.0, 2.0, -0.5), (3.0, -2.0, 1.0))
STATE = STATE._replace(q_WB=tuple((np.array(STATE.q_WB) / np.linalg.norm(STATE.q_WB)).tolist()))
TURN = Rotation.from_quat(STATE.q_WB)
BODY = Inertial(1.6, (0.3, 0.4, 0.5, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
FORCE, TORQUE = np.array([1.0, -2.0, 1.5]), np.array([0.1, 0.2, -0.15])
TIMES = [0.1, 0.3, 0.7]
FORCES = np.array([[1.0, 0.5, 2.0], [3.0, -3.0, 1.0], [-1.0, 1.0, 0.5]])
TORQUES = np.array([[0.1, -0.4, 0.6], [0.5, 0.2, -0.1], [0.3, 0.7, 0.2]])


def rows_of(effect: dict[str, Any]) -> list[Any]:
    body = {"mass": 1.6, "inertia": [0.3, 0.4, 0.5], "center_of_mass": CENTRE.tolist()}
    effect = effect | {"body": "b"}
    scene = {"bodies": {"b": body}, "effects": {"e": effect}}
    compiled = compile_scene(load_scene(scene), coordinates="maximal")
    return [placed.row for placed in compiled.system.effects]


def total(rows: list[Any], t: float) -> np.ndarray:
    """[force, world axes; torque about C, axes of the body]."""
    acting = [np.concatenate(wrench(row, t, BODY, STATE, WORLD)) for row in rows]
    return np.sum(acting, axis=0)


def by_hand(force: np.ndarray, torque: np.ndarray, axes: Axes, point: np.ndarray) -> np.ndarray:
    """K + r x F about C of a force at a point of the body."""
    if axes == "world":
        force, torque = TURN.inv().apply(force), TURN.inv().apply(torque)
    return np.concatenate([TURN.apply(force), torque + np.cross(point - CENTRE, force)])


@pytest.mark.parametrize("axes", AXES)
def test_constant_and_harmonic_parts(axes: Axes) -> None:
    own = {"type": "wrench", "frame": axes, "point_B": POINT.tolist()}
    steady = {"force": FORCE.tolist(), "torque": TORQUE.tolist()}
    waves = {"sine_force": FORCES[0].tolist(), "sine_torque": TORQUES[0].tolist()}
    waves |= {"angular_frequency": 7.0, "phase": 0.3}
    share = np.sin(7.0 * 0.25 + 0.3)
    for given, force, torque in (
        (steady, FORCE, TORQUE),
        (waves, share * FORCES[0], share * TORQUES[0]),
        (steady | waves, FORCE + share * FORCES[0], TORQUE + share * TORQUES[0]),
        ({"force": FORCE.tolist()}, FORCE, np.zeros(3)),
        ({"torque": TORQUE.tolist()}, np.zeros(3), TORQUE),
        (waves | {"sine_force": [0.0] * 3}, np.zeros(3), share * TORQUES[0]),
        (waves | {"sine_torque": [0.0] * 3}, share * FORCES[0], np.zeros(3)),
    ):
        expected = by_hand(force, torque, axes, POINT)
        assert_allclose(total(rows_of(own | given), 0.25), expected, atol=1e-14)


INSTANTS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 0.71)


def in_table(values: np.ndarray, t: float, interpolation: str) -> np.ndarray:
    if not TIMES[0] <= t <= TIMES[-1]:
        return np.zeros(3)
    if interpolation == "hold":
        return values[int(np.sum(np.array(TIMES) <= t)) - 1]
    return np.array([np.interp(t, TIMES, column) for column in values.T])


@pytest.mark.parametrize("interpolation", ["linear", "hold"])
@pytest.mark.parametrize("axes", AXES)
def test_a_table(axes: Axes, interpolation: str) -> None:
    table = {"type": "wrench_table", "frame": axes, "interpolation": interpolation}
    table |= {"times": TIMES, "point_B": POINT.tolist()}
    table |= {"forces": FORCES.tolist(), "torques": TORQUES.tolist()}
    (row,) = rows_of(table)
    for t in INSTANTS:
        force, torque = (in_table(values, t, interpolation) for values in (FORCES, TORQUES))
        expected = by_hand(force, torque, axes, POINT)
        assert_allclose(total([row], t), expected, atol=1e-14)


# Torsion springs between two bodies that are turned at the start and turn: angle, torque, energy.
#
# Their balance is in tests/properties/test_between_bodies, their swing alone in test_effects.


AXIS = np.array([2.0, 3.0, 6.0]) / 7.0
STIFFNESS, DAMPING, REST = 0.8, 0.3, 0.4
STARTS = {"a": {"axis": [0.3, -0.5, 0.8], "angle": 0.9}, "b": {"axis": [1, 0.2, 0], "angle": -1.7}}
BODY_TORSION = Inertial(1.0, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def rows(parent: bool, **law: float) -> list[Any]:
    solid = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    bodies = {name: solid | {"orientation": turn} for name, turn in STARTS.items()}
    spring = {"type": "torsion_spring", "body": "b", "axis_B": AXIS.tolist()} | law
    scene = {"bodies": bodies, "effects": {"s": spring | ({"parent": "a"} if parent else {})}}
    compiled = compile_scene(load_scene(scene), coordinates="maximal")
    return [placed.row for placed in compiled.system.effects]


def start(name: str) -> Rotation:
    axis = np.array(STARTS[name]["axis"], dtype=float)
    return Rotation.from_rotvec(STARTS[name]["angle"] * axis / np.linalg.norm(axis))


def states(parent: bool, turned: Rotation, sign: float) -> tuple[Any, Any]:
    """The body turned by `turned`, body axes, from its pose at the start as its parent carries it,
    which has turned since; sign: of the quaternion, which means the same."""
    rng = np.random.default_rng(1)
    B, A = random_state(rng), random_state(rng) if parent else WORLD
    carried = Rotation.from_quat(A.q_WB) * (start("a").inv() if parent else Rotation.identity())
    q = (carried * start("b") * turned).as_quat()
    return B._replace(q_WB=floats(sign * q)), A


ANGLES = (-4.0, -math.pi + 0.01, -1.0, 0.0, 0.7, 2.5, math.pi - 0.01, 4.5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("parent", [False, True])
@pytest.mark.parametrize("angle", ANGLES)
def test_a_turn_about_its_axis(angle: float, parent: bool, sign: float) -> None:
    """-k (theta - theta0) along the axis, theta from -pi to pi where no turn was counted yet."""
    (row,) = rows(parent, stiffness=STIFFNESS, rest_angle=REST)
    B, A = states(parent, Rotation.from_rotvec(angle * AXIS), sign)
    wound = (angle + math.pi) % (2.0 * math.pi) - math.pi - REST
    force, torque = wrench(row, 0.0, BODY_TORSION, B, A)
    assert force == (0.0, 0.0, 0.0)
    assert_allclose(torque, -STIFFNESS * wound * AXIS, atol=1e-12)
    energy = potential(row, 0.0, BODY_TORSION, B, A)
    assert energy == pytest.approx(0.5 * STIFFNESS * wound**2, abs=1e-12)


@pytest.mark.parametrize("parent", [False, True])
def test_a_damper_takes_the_relative_spin_about_the_axis(parent: bool) -> None:
    (row,) = rows(parent, damping=DAMPING)
    B, A = states(parent, Rotation.from_rotvec([0.3, 1.0, -0.4]), 1.0)
    spins = [Rotation.from_quat(S.q_WB).apply(S.w_WB_B) for S in (B, A)]
    relative = Rotation.from_quat(B.q_WB).inv().apply(spins[0] - spins[1])
    force, torque = wrench(row, 0.0, BODY_TORSION, B, A)
    assert force == (0.0, 0.0, 0.0)
    assert_allclose(torque, -DAMPING * (relative @ AXIS) * AXIS, atol=1e-14)


SPIN, MOMENT = 12.0, 0.2
"""A wheel on a torsion spring that winds it by 1.2 turns and back, I_3 [kg m^2]."""
FREQUENCY = math.sqrt(STIFFNESS * 0.625 / MOMENT)
KINDS = {
    "reduced": {},
    "maximal": {"other": {"mass": 1.0, "inertia": [0.1] * 3, "position": [9.0, 0.0, 0.0]}},
    "contact": {"ball": {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}},
    "tables": {f"b{k}": {"mass": 1.0, "inertia": [0.1] * 3} for k in range(12)},
}


def wound(kind: str, rate: float = 20.0, **options: Any) -> Simulation:
    """The wheel beside nothing, another body, a ball on a floor, or a dozen bodies."""
    wheel = {"mass": 1.0, "inertia": [0.1, 0.15, MOMENT], "angular_velocity": [0.0, 0.0, SPIN]}
    spring = {"type": "torsion_spring", "body": "wheel", "axis_B": [0.0, 0.0, 1.0]}
    axle = {"type": "fixed_axis", "body": "wheel", "axis_B": [0.0, 0.0, 1.0]}
    scene: dict[str, Any] = {
        "bodies": {"wheel": wheel} | KINDS[kind],
        "constraints": {"axle": axle},
        "effects": {"spring": spring | {"stiffness": FREQUENCY**2 * MOMENT}},
        "simulation": {"duration": 6.0, "rate": rate} | options,
    }
    if kind == "contact":
        scene["bodies"]["ball"] |= {"position": [3.0, 0.0, 0.1]}
        scene["constraints"]["floor"] = {"type": "contact", "body": "ball"}
        weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81], "bodies": ["ball"]}
        scene["effects"]["weight"] = weight
    return Simulation(load_scene(scene), announce=None)


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        *((kind, {"method": "dopri853", "tolerance": 1e-10}) for kind in KINDS),
        *((kind, {"method": "rk4", "step": 1e-3}) for kind in ("reduced", "maximal", "contact")),
        *((kind, {"method": "taylor", "tolerance": 1e-10}) for kind in ("reduced", "maximal")),
        ("reduced", {"method": "radau5", "tolerance": 1e-9}),
        ("contact", {"method": "time_stepping", "step": 1e-3}),
    ],
)
def test_a_spring_winds_beyond_half_a_turn(kind: str, options: Any) -> None:
    """w = w0 cos(W t) and U = I w0^2 sin^2(W t) / 2, with samples that are turns apart."""
    run = wound(kind, 2.0, **options).run()
    bound = 1e-3 if options["method"] == "time_stepping" else 1e-7
    spin = run.angular_velocity["wheel"][:, 2]
    assert_allclose(spin, SPIN * np.cos(FREQUENCY * run.t), atol=SPIN * bound)
    energy = 0.5 * MOMENT * (SPIN * np.sin(FREQUENCY * run.t)) ** 2
    assert_allclose(run.block.potential_energy - run.block.potential_energy[0], energy, atol=1e-2)
    assert run.findings == ()


@pytest.mark.parametrize("kind", ["reduced", "contact"])
def test_turns_stay_counted_over_a_command_and_in_a_run_that_goes_on(kind: str) -> None:
    """Each begins a new grid of steps; at 0.7 s the spring is wound by 4 rad and more."""
    simulation = wound(kind)
    first = simulation.run(0.7)
    assert SPIN / FREQUENCY * math.sin(FREQUENCY * 0.7) > 4.0
    rest = simulation.run(5.3)
    t = np.append(first.t, rest.t)
    spin = np.append(first.angular_velocity["wheel"], rest.angular_velocity["wheel"], 0)[:, 2]
    assert_allclose(spin, SPIN * np.cos(FREQUENCY * t), atol=1e-6)
    if kind == "reduced":  # in contact no second run goes on from another one
        assert rest.global_error is not None and rest.global_error.relative < 1e-6


def test_the_linear_model_of_a_wound_spring_is_that_about_where_it_is() -> None:
    """The same stiffness about any angle, and the torque of all turns."""
    simulation = wound("reduced")
    simulation.run(0.7, checks=False)
    values = simulation.linearize().eigenvalues
    assert_allclose(np.abs(values).max(), FREQUENCY, rtol=1e-6)


def test_a_reset_counts_anew() -> None:
    simulation = wound("reduced")
    first = simulation.run(1.0, checks=False)
    simulation.reset()
    again = simulation.run(1.0, checks=False)
    assert_allclose(again.angular_velocity["wheel"], first.angular_velocity["wheel"], atol=1e-15)
