# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Linear models against closed forms, differences of the motion, and python-control."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base import palette
from rb_sim.equilibrium import state_space as picture
from rb_sim.equilibrium.state_space import LinearModel

G = 9.81
M, LEVER, ACROSS, AXIAL = 1.3, 0.4, 0.05, 0.02
"""A top: mass, distance of C from the tip, moments about C."""
J = ACROSS + M * LEVER**2
THRESHOLD = math.sqrt(4.0 * J * M * G * LEVER) / AXIAL
"""Spin at which a sleeping top becomes stable: M3^2 = 4 I1 m g l (LL section 35, problem 2)."""


def top(spin: float, **more: Any) -> dict[str, Any]:
    """A symmetric top that stands on its tip and spins."""
    body = {"mass": M, "inertia": [ACROSS, ACROSS, AXIAL], "position": [0.0, 0.0, LEVER]}
    tip = {"type": "fixed_point", "body": "top", "point_B": [0.0, 0.0, -LEVER]}
    return {
        "bodies": {"top": body | {"angular_velocity": [0.0, 0.0, spin]}},
        "constraints": {"tip": tip},
        "effects": {"weight": {"type": "gravity"}} | more,
        "simulation": {"method": "rk4", "step": 1e-3},
    }


def model(scene: dict[str, Any], *arguments: Any) -> Any:
    """The linear model of a scene at the start."""
    from rb_sim import Simulation, load_scene

    return Simulation(load_scene(scene)).linearize(*arguments)


@pytest.mark.parametrize("axes", ["world", "body"])
@pytest.mark.parametrize("share", [0.5, 0.999, 1.001, 2.0])
def test_a_sleeping_top_is_stable_from_its_threshold_on(share: float, axes: str) -> None:
    """Growth sqrt(4 I1 m g l - M3^2) / 2 I1 below it, none above."""
    found = model(top(share * THRESHOLD), axes)
    below = max(0.0, 1.0 - share**2) * (AXIAL * THRESHOLD) ** 2
    growth = math.sqrt(below) / (2.0 * J)
    assert found.eigenvalues.real.max() == pytest.approx(growth, abs=1e-9)
    assert len(found.states) == 6


def test_an_inverted_pendulum_falls_at_the_root_of_m_g_l_by_its_inertia() -> None:
    at = {"point_B": [0.0, 0.0, -LEVER], "axis_B": [0.6, 0.8, 0.0]}
    hinge = {"type": "fixed_axis", "body": "top"} | at
    found = model(top(0.0) | {"constraints": {"hinge": hinge}})
    rate = math.sqrt(M * G * LEVER / J)
    np.testing.assert_allclose(found.eigenvalues, [rate, -rate], rtol=1e-13)
    assert found.states == ("top/angle_y", "top/spin_y")
    assert found.modes[0].damping == -1.0
    poles = f"eigenvalues {rate:.4g}+0j, {-rate:.4g}+0j 1/s>"
    assert repr(found).startswith("<LinearModel at t = 0 s: 2 states, ") and poles in repr(found)


def disk(lean: float, yaw: float) -> tuple[dict[str, Any], float]:
    """A disk that rolls steadily in a circle, and the square of its nutation's eigenvalue.

    Axes: e1 level, e2 up in the disk's plane, e3 its axis; beta the angle of its plane to the
    level one; w = (beta', yaw' sin beta, s).  Newton-Euler with the reaction eliminated:
    (A + m a^2) w1' = -(C + m a^2) w2 w3 + A w2^2 cot beta - m g a cos beta,
    A w2' = (C w3 - A w2 cot beta) w1,  (C + m a^2) w3' = m a^2 w1 w2.
    """
    m, a = 1.0, 0.5
    A, C = m * a * a / 4.0, m * a * a / 2.0
    beta = math.pi / 2.0 - lean
    s, c = math.sin(beta), math.cos(beta)
    w2 = yaw * s
    w3 = (A * w2**2 * c / s - m * G * a * c) / ((C + m * a * a) * w2)
    by_beta = -A * w2**2 / s**2 + m * G * a * s
    by_w2 = -(C + m * a * a) * w3 + 2.0 * A * w2 * c / s
    by_w3 = -(C + m * a * a) * w2
    square = by_beta + by_w2 * (C / A * w3 - w2 * c / s) + by_w3 * m * a * a / (C + m * a * a) * w2
    body = {
        "mass": m,
        "shape": {"type": "disk", "radius": a, "axis_B": [0.0, 0.0, 1.0]},
        "position": [0.0, 0.0, a * s],
        "orientation": {"axis": [1.0, 0.0, 0.0], "angle": beta},
        "linear_velocity": [-a * w3, 0.0, 0.0],
        "angular_velocity": [0.0, w2, w3],
    }
    floor = {"type": "rolling", "body": "disk", "normal_A": [0.0, 0.0, 1.0]}
    scene = {
        "bodies": {"disk": body},
        "constraints": {"floor": floor | {"point_A": [0.0, 0.0, 0.0]}},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"method": "rk4", "step": 1e-3},
    }
    return scene, square / (A + m * a * a)


@pytest.mark.parametrize(("lean", "yaw"), [(0.3, 1.2), (0.15, 0.4), (0.6, 5.0)])
def test_a_disk_rolling_in_a_circle_nutates_as_newton_and_euler_say(
    lean: float, yaw: float
) -> None:
    """Seen from axes that turn with the circle; the rest are zeros and the shift of the circle."""
    scene, square = disk(lean, yaw)
    found = model(scene, "world", yaw).eigenvalues
    nutation = np.sqrt(complex(square))
    for value in (nutation, -nutation, 1j * yaw, -1j * yaw):
        assert abs(found - value).min() < 1e-6 * abs(value)
    assert len(found) == 8
    assert np.sort(abs(found))[:4].max() < 1e-3  # a defective zero loses half of the digits


BODIES = {
    "upper": {
        "mass": 2.0,
        "inertia": [0.3, 0.2, 0.25],
        "position": [0.5, 0.0, 0.0],
        "angular_velocity": [0.2, 0.5, 1.1],
        "linear_velocity": [0.0, 0.55, -0.25],
    },
    "lower": {
        "mass": 0.7,
        "inertia": [0.05, 0.06, 0.04],
        "position": [1.4, 0.1, 0.1],
        "angular_velocity": [-0.3, 0.9, 0.4],
    },
}
SPRING = {"stiffness": 30.0, "damping": 2.0, "rest_length": 0.5, "point_A": [1.0, 2.0, -1.0]}
TWIST = {"axis_B": [0.0, 1.0, 0.0], "stiffness": 3.0, "rest_angle": 0.3}
EFFECTS = {
    "weight": {"type": "gravity"},
    "spring": {"type": "spring", "body": "lower"} | SPRING,
    "twist": {"type": "torsion_spring", "body": "lower", "parent": "upper"} | TWIST,
    "drag": {"type": "quadratic_drag", "body": "lower", "coefficient": 0.4},
    "pull": {"type": "commanded_wrench", "body": "lower"},
}
ELBOW = {"point_A": [0.5, 0.0, 0.0], "point_B": [-0.4, -0.1, -0.1]}
AXLE = {"point_B": [-0.5, 0.0, 0.0], "axis_B": [0.0, 0.6, 0.8], "floating": "none"}
JOINTS = {
    "chain": {
        "shoulder": {"type": "fixed_point", "body": "upper", "point_B": [-0.5, 0.0, 0.0]},
        "elbow": {"type": "fixed_point", "body": "lower", "parent": "upper"} | ELBOW,
    },
    # the share of the axial force between its bearings is what the least norm makes it
    "redundant axle": {
        "axle": {"type": "fixed_axis", "body": "upper"} | AXLE,
        "rod": {"type": "distance", "body": "lower", "parent": "upper", "point_A": [0.5, 0.0, 0.0]},
        "floor": {"type": "plane", "body": "lower", "normal_A": [0.0, 0.0, 1.0]},
    },
}
COMMAND = np.array([[1.0, -2.0, 0.5], [0.1, 0.2, -0.1]])


class Kernels:
    """The motion's own kernels, asked for accelerations and reactions beside a state."""

    def __init__(self, joints: str) -> None:
        from rb_sim import Simulation, load_scene

        options = {"method": "rk4", "step": 1e-3, "project_initial": True}
        scene = {"bodies": BODIES, "constraints": JOINTS[joints], "effects": EFFECTS}
        self.simulation = Simulation(
            load_scene(scene | {"simulation": options}), coordinates="maximal"
        )
        self.simulation.apply_wrench("lower", *COMMAND.tolist())
        self.model = self.simulation.linearize()
        row = self.simulation.sample().block
        pose = (row.position, row.orientation, row.linear_velocity, row.angular_velocity)
        self.y = np.concatenate([part[0] for part in pose], axis=1).ravel()

    def shifted(self, z: np.ndarray) -> np.ndarray:
        """The state deviated by z (positions, rotations, velocities, spins), on the manifold."""
        from rb_sim.numerics.vectors import quaternion_product, quaternion_unit, rotate, unrotate

        y, parts = self.y.copy(), z.reshape(2, 2, 2, 3)
        for i in range(2):
            k, q = 13 * i, tuple(self.y[13 * i + 3 : 13 * i + 7])
            spin = np.array(rotate(q, tuple(y[k + 10 : k + 13]))) + parts[1, i, 1]
            turned = quaternion_unit(quaternion_product((*(0.5 * parts[0, i, 1]), 1.0), q))
            y[k : k + 3] += parts[0, i, 0]
            y[k + 3 : k + 7] = turned
            y[k + 7 : k + 10] += parts[1, i, 0]
            y[k + 10 : k + 13] = unrotate(turned, tuple(spin))
        from tests.numbers import projected

        return projected(self.simulation._motion.system, 0.0, y)

    def answer(self, z: np.ndarray) -> np.ndarray:
        """Accelerations of both bodies (world axes), then force and torque of each reaction."""
        from rb_sim.equilibrium.linearize import held_at, turned_spin

        system, y = self.simulation._motion.system, self.shifted(z)
        held = held_at(system, 0.0, y)[2]
        push = turned_spin(y, 2) @ np.array(held.acceleration)
        from tests.numbers import sample_at

        count = len(self.simulation.layout.reactions)
        commanded = SimpleNamespace(
            laws=self.simulation.compiled.laws, system=system, layout=self.simulation.layout
        )
        out = sample_at(commanded, 0.0, y)
        return np.concatenate([push, out[26 : 26 + 9 * count].reshape(-1, 9)[:, :6].ravel()])

    def exact(self, of: np.ndarray, outputs: np.ndarray) -> np.ndarray:
        """Columns of the model that belong to `compared`."""
        rows = [i for i, s in enumerate(self.model.states) if "velocity" in s or "spin" in s]
        return np.vstack([of[rows], outputs[24:]])

    def compared(self, answer: np.ndarray) -> np.ndarray:
        """The accelerations that are rates of states, and the reactions."""
        names = self.model.outputs[12:24]
        chosen = [i for i, name in enumerate(names) if name in self.model.states]
        return np.concatenate([answer[chosen], answer[12:]])


def defects(joints: str) -> tuple[float, float, float]:
    """Largest difference by states and by inputs, and the size of the derivatives."""
    kernels = Kernels(joints)
    found, h = kernels.model, 1e-3
    by_state, by_input = [], []
    for z in found.C[:24].T:
        f = {k: kernels.answer(k * h * z) for k in (-2, -1, 1, 2)}
        by_state.append((8.0 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12.0 * h))
    for change in np.eye(6).reshape(6, 2, 3):
        ends = []
        for sign in (-1.0, 1.0):
            kernels.simulation.apply_wrench("lower", *(COMMAND + sign * change).tolist())
            ends.append(kernels.answer(np.zeros(24)))
        by_input.append((ends[1] - ends[0]) / 2.0)
    exact = kernels.exact(found.A, found.C), kernels.exact(found.B, found.D)
    measured = [
        np.array([kernels.compared(a) for a in answers]).T for answers in (by_state, by_input)
    ]
    size = float(abs(exact[0]).max())
    return (*(float(abs(e - m).max()) for e, m in zip(exact, measured, strict=True)), size)


@pytest.mark.parametrize("joints", list(JOINTS))
def test_accelerations_and_reactions_agree_with_differences(joints: str) -> None:
    """About a moving state, with a command in force; by every state and every input."""
    by_state, by_input, size = defects(joints)
    assert by_state < 1e-7 * size
    assert by_input < 1e-11 * size


@pytest.mark.parametrize(("axes", "sense"), [("world", 1.0), ("body", -1.0)])
def test_angles_turn_with_the_spin_that_they_are_taken_about(axes: str, sense: float) -> None:
    """phi' = dW + W x phi in the world's axes, phi' = dw - w x phi in those of the body."""
    spin = 7.0
    rows = model(top(spin), axes).A[:3]
    turn = sense * spin * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(rows, np.hstack([turn, np.eye(3)]), atol=1e-12)


def test_python_control_takes_the_archive(tmp_path: Any) -> None:
    control = pytest.importorskip("control")
    found = model(top(3.0, pull={"type": "commanded_wrench", "body": "top"}))
    found.to_npz(tmp_path / "linear_model.npz")
    f = np.load(tmp_path / "linear_model.npz")
    names = {key: [str(x) for x in f[key]] for key in ("states", "inputs", "outputs")}
    plant = control.ss(f["A"], f["B"], f["C"], f["D"], **names)
    assert plant.ninputs == 6 and plant.nstates == 6
    # a torque about the vertical speeds the spin up by M / I3, and nothing else does
    at, by = names["outputs"].index("top/spin_z"), names["inputs"].index("top/torque_z")
    assert complex(plant(1j)[at, by]) == pytest.approx(1.0 / (AXIAL * 1j), rel=1e-9)


def test_what_cannot_be_linearised_is_reported_in_one_line() -> None:
    from rb_sim import RbSimError

    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0.0, 0.0, 0.1]}
    scene = top(0.0) | {
        "bodies": {"ball": ball},
        "constraints": {"floor": {"type": "contact", "body": "ball"}},
    }
    with pytest.raises(RbSimError, match="has contacts"):
        model(scene)
    with pytest.raises(RbSimError, match="axes: got 'polar'; must be 'world' or 'body'"):
        model(top(1.0), "polar")


def test_quadratic_drag_at_rest_has_no_slope() -> None:
    """A ball about to fall through air: x'' = F / m alone, all eigenvalues are zero."""
    air = {"type": "quadratic_drag", "body": "ball", "coefficient": 0.5}
    scene = {"bodies": {"ball": {"mass": 1.0, "inertia": [0.1] * 3}}, "effects": {"air": air}}
    found = model(scene, "world", 0.0)
    assert np.isfinite(found.A).all()
    np.testing.assert_array_equal(found.eigenvalues, np.zeros(12))


def cart_pole(first: str, drag: float = 0.0) -> dict[str, Any]:
    """A point-like bob below a cart on a rail without friction; `first`: the body named first."""
    bodies = {
        "cart": {"mass": 2.0, "inertia": [1.0, 1.0, 1.0]},
        "bob": {"mass": 1.0, "inertia": [1e-9, 1e-9, 1e-9], "position": [0.0, 0.0, -0.5]},
    }
    rail = {"type": "line", "direction": [1.0, 0.0, 0.0]}
    hinge = {"type": "fixed_axis", "body": "bob", "parent": "cart", "axis_B": [0.0, 1.0, 0.0]}
    weight = {"weight": {"type": "gravity"}}
    slow = {"slow": {"type": "linear_drag", "body": "cart", "coefficient": drag}} if drag else {}
    return {
        "bodies": {first: bodies[first]} | bodies,
        "constraints": {
            "rail": {"type": "translation", "body": "cart", "guide": rail},
            "hinge": hinge | {"point_B": [0.0, 0.0, 0.5]},
        },
        "effects": weight | slow,
        "simulation": {"method": "rk4", "step": 1e-3},
    }


@pytest.mark.parametrize("first", ["cart", "bob"])
def test_a_double_zero_is_two_modes_and_states_are_of_the_body_named_first(first: str) -> None:
    """lambda = 0, 0, +- i sqrt((M + m) g / (M l))."""
    found = model(cart_pole(first))
    assert found.states[0] == f"{first}/position_x"
    swing = math.sqrt(3.0 / 2.0 * G / 0.5)
    values = sorted(found.eigenvalues, key=lambda value: (value.imag, value.real))
    np.testing.assert_allclose(values, [-1j * swing, 0.0, 0.0, 1j * swing], rtol=1e-7, atol=1e-12)
    zero = [mode for mode in found.modes if mode.real == mode.imaginary == 0.0]
    assert len(zero) == 2 and len(found.modes) == 3
    assert zero[0].state != zero[1].state


@pytest.mark.parametrize("first", ["crank", "rocker"])
def test_the_states_of_a_loop_are_of_the_body_named_first(first: str) -> None:
    """A parallelogram: an angle of one leg gives all others."""
    leg = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    up = {"orientation": {"axis": [0, 1, 0], "angle": -math.pi / 2}}
    bodies = {
        "crank": leg | up,
        "coupler": leg | {"position": [0.5, 0.0, 0.3]},
        "rocker": leg | up | {"position": [1.0, 0.0, 0.0]},
    }
    hinge = {"type": "fixed_axis", "axis_B": [0, 1, 0]}
    onto = hinge | {"body": "coupler", "point_A": [0.3, 0, 0]}
    constraints = {
        "left": hinge | {"body": "crank"},
        "right": hinge | {"body": "rocker", "point_A": [1, 0, 0]},
        "on_left": onto | {"parent": "crank", "point_B": [-0.5, 0, 0]},
        "on_right": onto | {"parent": "rocker", "point_B": [0.5, 0, 0]},
    }
    found = model(
        {
            "bodies": {first: bodies[first]} | bodies,
            "constraints": constraints,
            "effects": {"weight": {"type": "gravity"}},
        }
    )
    assert found.states == (f"{first}/angle_y", f"{first}/spin_y")


@pytest.mark.parametrize("spin", [1.03, 96.7])
@pytest.mark.parametrize("inertia", [[1.0, 1.0, 1.0], [1.0, 2.0, 2.9]])
def test_a_free_body_that_spins_about_a_stable_axis_does_not_grow(
    inertia: list[float], spin: float
) -> None:
    """In axes that turn with it, i w is a double eigenvalue of its free flight, with one mode."""
    body = {"mass": 1.0, "inertia": inertia, "orientation": [0.3, -0.5, 0.1, 0.8]}
    body["orientation"] = (np.array(body["orientation"]) / math.sqrt(0.99)).tolist()
    body["angular_velocity"] = [0.0, 0.0, spin]
    found = model({"bodies": {"b": body}}, "body")
    values = found.eigenvalues
    np.testing.assert_array_equal(values.real, 0.0)
    np.testing.assert_allclose(np.sort(np.abs(values.imag))[-4:], spin, rtol=1e-6)


def test_a_slow_growth_is_no_rounding() -> None:
    """The upright pendulum under a pull of 1e-8 g grows at sqrt(1e-8 m g l / J)."""
    rod = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [0.0, 0.0, 1.0]}
    scene = {
        "bodies": {"rod": rod, "other": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}},
        "constraints": {
            "hinge": {"type": "fixed_axis", "body": "rod", "axis_B": [0, 1, 0]}
            | {"point_B": [0, 0, -1.0]}
        },
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0, 0, -1e-8 * G], "bodies": ["rod"]},
            "spring": {"type": "spring", "body": "other", "stiffness": 100.0},
        },
    }
    fastest = model(scene).eigenvalues[0]
    np.testing.assert_allclose(fastest, math.sqrt(1e-8 * G / 2.0), rtol=1e-3)


def test_a_real_mode_has_no_frequency() -> None:
    """A cart that drag brings to rest: lambda = 0 and about -c / (M + m)."""
    found = model(cart_pole("cart", drag=0.3))
    for mode in found.modes:
        assert math.isnan(mode.frequency) is (mode.imaginary == 0.0)
    assert [mode.imaginary > 0.0 for mode in found.modes].count(False) == 2


OSCILLATOR = {
    "bodies": {"bob": {"mass": 2.0, "inertia": [1.0, 1.0, 1.0], "position": [0.0, 0.0, 0.0]}},
    "constraints": {
        "rail": {"type": "translation", "body": "bob",
                 "guide": {"type": "line", "direction": [1.0, 0.0, 0.0]}}
    },
    "effects": {
        "spring": {"type": "spring", "body": "bob", "point_A": [1.0, 0.0, 0.0],
                   "stiffness": 50.0, "damping": 4.0, "rest_length": 1.0},
        "drive": {"type": "commanded_wrench", "body": "bob"},
    },
    "simulation": {"method": "rk4", "step": 1e-3},
}  # fmt: skip


def test_the_bode_plot_is_the_response_of_the_oscillator() -> None:
    """x / f = 1 / (k - m w^2 + i c w); poles at -c / 2 m +- i sqrt(k / m - (c / 2 m)^2)."""
    found = model(OSCILLATOR)
    figure = picture.bode("oscillator", found)
    assert figure is not None
    magnitude, angle = figure.axes
    (line,) = magnitude.get_lines()
    at = np.array(line.get_xdata())
    exact = 1.0 / (50.0 - 2.0 * at**2 + 4.0j * at)
    assert line.get_label() == "bob/position_x" and at.min() < 0.6 and at.max() > 45.0
    np.testing.assert_allclose(line.get_ydata(), np.abs(exact), rtol=1e-9)
    (line,) = angle.get_lines()
    np.testing.assert_allclose(line.get_ydata(), np.degrees(np.angle(exact)), atol=1e-7)
    marks = [line for line in picture.poles("x", found).axes[0].get_lines()
             if line.get_marker() == "x"]  # fmt: skip
    seen = sorted((float(m.get_xdata()[0]), float(m.get_ydata()[0])) for m in marks)
    np.testing.assert_allclose(seen, [(-1.0, -math.sqrt(24.0)), (-1.0, math.sqrt(24.0))], rtol=1e-6)


def test_without_inputs_there_is_no_bode_plot_and_growing_poles_are_marked() -> None:
    at = {"point_B": [0.0, 0.0, -LEVER], "axis_B": [0.0, 1.0, 0.0]}
    hinge = {"type": "fixed_axis", "body": "top"} | at
    found = model(top(0.0) | {"constraints": {"hinge": hinge}})
    assert picture.bode("x", found) is None
    (axes,) = picture.poles("x", found, is_steady=False).axes
    colours = {line.get_xdata()[0] > 0.0: line.get_color()
               for line in axes.get_lines() if line.get_marker() == "x"}  # fmt: skip
    assert colours == {True: palette.BAD, False: palette.GOOD}
    assert "this instant only" in axes.get_title(loc="left")


# Linear models of scenes that are held more than they need be, against closed forms.


LEAF, MASSES, MOMENTS, STIFFNESS = 0.8, (3.0, 2.0), (0.16, 0.11), (40.0, 15.0)


def model_of_redundant(at: float = 0.0, **scene: Any) -> LinearModel:
    """Of the scene at that time."""
    simulation = Simulation(load_scene(scene), announce=None)
    if at:
        simulation.advance(at)
    return simulation.linearize()


def hinges(leaf: str, parent: str | None) -> dict[str, Any]:
    """Three of a leaf, one above the other: ten of fifteen lines too many."""
    axis = {"type": "fixed_axis", "body": leaf, "axis_B": [0, 0, 1], "bearing_distance": 0.1}
    axis |= {"parent": parent} if parent else {}
    heights = (-0.5, 0.0, 0.7)
    points = [{"point_B": [-0.5 * LEAF, 0, z]} for z in heights]
    return {f"{leaf}{k}": axis | point for k, point in enumerate(points)}


@pytest.mark.parametrize("at", [0.0, 0.5])
def test_a_folding_door_on_three_hinges_each_swings_as_two_rods_do(at: float) -> None:
    """det(K - w^2 M) = 0 with the springs of its hinges; at rest it stays where it is."""
    bodies, joints, springs = {}, {}, {}
    for k, (leaf, parent) in enumerate((("a", None), ("b", "a"))):
        inertia = [0.1, 0.12, MOMENTS[k]]
        place = [(k + 0.5) * LEAF, 0, 0]
        bodies[leaf] = {"mass": MASSES[k], "inertia": inertia, "position": place}
        joints |= hinges(leaf, parent)
        spring = {"type": "torsion_spring", "body": leaf, "axis_B": [0, 0, 1]}
        springs[leaf] = (
            spring | {"stiffness": STIFFNESS[k]} | ({"parent": parent} if parent else {})
        )
    found = model_of_redundant(at, bodies=bodies, constraints=joints, effects=springs)
    (m1, m2), (j1, j2), (k1, k2) = MASSES, MOMENTS, STIFFNESS
    mixed = 0.5 * m2 * LEAF**2
    first, second = j1 + 0.25 * m1 * LEAF**2 + m2 * LEAF**2, j2 + 0.25 * m2 * LEAF**2
    masses = np.array([[first, mixed], [mixed, second]])
    squared = np.linalg.eigvals(np.linalg.solve(masses, [[k1 + k2, -k2], [-k2, k2]]))
    assert len(found.states) == 4
    np.testing.assert_allclose(np.real(found.eigenvalues), 0.0, atol=1e-9)
    pairs = np.sort(np.abs(np.imag(found.eigenvalues)))
    np.testing.assert_allclose(pairs, np.sort(np.repeat(np.sqrt(squared), 2)), rtol=1e-9)
