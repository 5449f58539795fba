"""Cases that engines get wrong: a right answer or a plain refusal, never a silent wrong one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ellipk

from rb_sim.base.errors import RbSimError
from tests.one_body_scenes import JOINTS
from tests.runs import trajectory

G = 9.81
DOWN = {"type": "gravity", "acceleration": [0.0, 0.0, -G]}


def test_unstable_axis_flips_with_the_right_period() -> None:
    """Dzhanibekov: T = 4 K(k) sqrt(I1 I2 I3 / ((I3 - I2)(M^2 - 2 E I1))) for M^2 > 2 E I2."""
    i1, i2, i3 = 1.0, 2.0, 3.0
    w = np.array([0.01, 5.0, 0.01])
    inertia = np.array([i1, i2, i3])
    e2, m2 = float(inertia @ w**2), float(inertia**2 @ w**2)
    if m2 < e2 * i2:
        i1, i3 = i3, i1
    k2 = (i2 - i1) * (e2 * i3 - m2) / ((i3 - i2) * (m2 - e2 * i1))
    period = 4.0 * ellipk(k2) * math.sqrt(i1 * i2 * i3 / ((i3 - i2) * (m2 - e2 * i1)))
    body = {"mass": 1.0, "inertia": inertia.tolist(), "angular_velocity": w.tolist()}
    run = trajectory(
        {"bodies": {"nut": body}}, duration=3.0 * period, rate=4.0 / period, tolerance=1e-13
    )
    spin = run.angular_velocity[:, 0]
    assert_allclose(spin[4::4], [w] * 3, atol=1e-7)
    assert_allclose(spin[2::4, 1], -5.0, rtol=1e-4)
    assert_allclose(run.energy, run.energy[0], rtol=1e-12)


def test_fast_top_precesses() -> None:
    """Spin 220 rad/s: steady precession I3 w3 p - I1 p^2 cos(theta) = m g l at every instant."""
    m, arm, i1, i3, tilt, p = 0.5, 0.08, 4e-4, 6.25e-4, 0.6, 3.0
    i1_O = i1 + m * arm * arm
    spin = (m * G * arm + i1_O * p * p * math.cos(tilt)) / (i3 * p)
    assert spin > 200.0
    w = [0.0, p * math.sin(tilt), spin]
    top = {
        "mass": m,
        "inertia": [i1, i1, i3],
        "center_of_mass": [0.0, 0.0, arm],
        "orientation": {"axis": [1.0, 0.0, 0.0], "angle": tilt},
        "angular_velocity": w,
    }
    scene = {
        "bodies": {"top": top},
        "constraints": {"tip": {"type": "fixed_point", "body": "top"}},
        "effects": {"weight": DOWN},
    }
    run = trajectory(scene, duration=0.5, rate=20.0, tolerance=1e-13)
    angle = p * run.t
    s = arm * math.sin(tilt)
    expected = np.stack([s * np.sin(angle), -s * np.cos(angle)], axis=-1)
    assert_allclose(run.position[:, 0, :2], expected, atol=1e-11)
    assert_allclose(run.position[:, 0, 2], arm * math.cos(tilt), atol=1e-12)


def test_inertia_ratio() -> None:
    """1 : 1e6 symmetric body: the spin precesses at (I3 - I1)/I1 w3 in the body, exactly."""
    i1, i3, w3 = 1e-6, 1.0000005e-6 * 1.9, 50.0
    body = {"mass": 1.0, "inertia": [i1, i1, i3], "angular_velocity": [0.3, 0.0, w3]}
    run = trajectory({"bodies": {"b": body}}, duration=1.0, rate=20.0, tolerance=1e-13)
    angle = (i3 - i1) / i1 * w3 * run.t
    expected = np.stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.0 * angle + w3], axis=-1)
    assert_allclose(run.angular_velocity[:, 0], expected, atol=1e-10)


def test_needle_keeps_its_spin() -> None:
    """Axial inertia 1e-9 of the transverse one: w3 stays constant, the energy too."""
    body = {
        "mass": 1.0,
        "inertia": [0.1, 0.1, 1e-10],
        "orientation": {"axis": [1.0, 0.0, 0.0], "angle": 1.2},
        "center_of_mass": [0.0, 0.0, -0.5],
        "angular_velocity": [0.0, 2.0, 7.0],
    }
    scene = {
        "bodies": {"rod": body},
        "constraints": {"hinge": {"type": "fixed_point", "body": "rod"}},
        "effects": {"weight": DOWN},
    }
    for coordinates in ("auto", "maximal"):
        run = trajectory(scene, coordinates, duration=1.0, rate=20.0, tolerance=1e-12)
        assert_allclose(run.angular_velocity[:, 0, 2], 7.0, rtol=1e-6)
        assert_allclose(run.energy, run.energy[0], atol=1e-9)


@pytest.mark.parametrize("stiffness", [1e6, 1e10])
def test_stiff_spring(stiffness: float) -> None:
    """x = x0 cos(w t) - sag through fifty periods."""
    omega = math.sqrt(stiffness)
    scene = {
        "bodies": {"bob": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [1e-3, 0, 0]}},
        "effects": {"spring": {"type": "spring", "body": "bob", "stiffness": stiffness}},
    }
    end = 20.0 * 2.0 * math.pi / omega
    run = trajectory(scene, duration=end, rate=10.0 / end, tolerance=1e-14)
    expected = 1e-3 * np.cos(omega * run.t)
    assert_allclose(run.position[:, 0, 0], expected, atol=1e-3 * 1e-8)


def test_disk_passes_close_to_flat() -> None:
    """A disk that falls with little spin rises again and keeps its energy through the spike."""
    shape = {"type": "disk", "radius": 0.2}
    body = {
        "mass": 1.0,
        "shape": shape,
        "position": [0.0, 0.0, 0.19],
        "orientation": {"axis": [1.0, 0.0, 0.0], "angle": 1.2},
        "angular_velocity": [0.0, 0.1, 0.05],
    }
    scene = {
        "bodies": {"disk": body},
        "constraints": {"floor": {"type": "rolling", "body": "disk"}},
        "effects": {"weight": DOWN},
        "simulation": {"project_initial": True},
    }
    run = trajectory(scene, duration=1.0, rate=200.0, tolerance=1e-13)
    height = run.position[:, 0, 2]
    lowest = int(height.argmin())
    assert height[lowest] < 0.02
    assert height[lowest:].max() > 0.15
    assert_allclose(run.energy, run.energy[0], rtol=1e-10)
    assert run.residual.max() <= 1e-12


def outcome(mapping: Any, coordinates: str, options: dict[str, Any]) -> Any:
    """The run's samples, or the message of the refusal."""
    from rb_sim import Simulation, load_scene

    own = {key: value for key, value in mapping["simulation"].items() if key != "tolerance"}
    scene = load_scene(mapping | {"simulation": own | options})
    try:
        return Simulation(scene, coordinates=coordinates).run().block
    except RbSimError as error:
        return str(error)
    except ZeroDivisionError:  # plain Python raises where compiled code gets infinity, then NaN
        return f"step {options['step']:g} s is too large for {options['method']}"


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize("method", ["euler", "rk4", "dopri853", "gauss6"])
@pytest.mark.parametrize("step", [0.5, 20.0])
@pytest.mark.usefixtures("no_advice")
def test_absurd_steps(method: str, step: float, coordinates: str) -> None:
    """A fixed step of several turns: refused by name, or finite and on the joint."""
    options = {"method": method, "step": step, "duration": 40.0, "rate": 0.5}
    for name in ("free", "fixed_point", "rolling disk"):
        got = outcome(JOINTS[name], coordinates, options)
        if isinstance(got, str):
            assert f"step {step:g} s is too large for {method}" in got
            continue
        for column in (got.position, got.orientation, got.linear_velocity, got.reaction_force):
            assert np.isfinite(column).all()
        assert got.residual.max() <= 1e-12 * max(1.0, np.abs(got.position).max())


def test_adaptive_method_is_right_however_seldom_it_is_asked() -> None:
    """One sample at the end equals that of a run with many."""
    options = {"tolerance": 1e-12, "duration": 4.0}
    once = outcome(JOINTS["fixed_point"], "auto", options | {"rate": 0.25})
    often = outcome(JOINTS["fixed_point"], "auto", options | {"rate": 50.0})
    assert_allclose(once.position[-1], often.position[-1], atol=1e-15)
    assert_allclose(once.reaction_force[-1], often.reaction_force[-1], atol=1e-12)
