"""Linear models against closed forms, differences of the motion, and python-control."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.interpreted import interpreted

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
    found = interpreted(model, top(share * THRESHOLD), axes)
    below = max(0.0, 1.0 - share**2) * (AXIAL * THRESHOLD) ** 2
    growth = math.sqrt(below) / (2.0 * J)
    assert found.eigenvalues.real.max() == pytest.approx(growth, abs=1e-9)
    assert len(found.states) == 6


def test_an_inverted_pendulum_falls_at_the_root_of_m_g_l_by_its_inertia() -> None:
    at = {"point_B": [0.0, 0.0, -LEVER], "axis_B": [0.6, 0.8, 0.0]}
    hinge = {"type": "fixed_axis", "body": "top"} | at
    found = interpreted(model, top(0.0) | {"constraints": {"hinge": hinge}})
    rate = math.sqrt(M * G * LEVER / J)
    np.testing.assert_allclose(found.eigenvalues, [rate, -rate], rtol=1e-13)
    assert found.states == ("top/angle_y", "top/spin_y")
    assert found.modes[0].damping == -1.0


@pytest.mark.parametrize(("axes", "sense"), [("world", 1.0), ("body", -1.0)])
def test_angles_turn_with_the_spin_that_they_are_taken_about(axes: str, sense: float) -> None:
    """phi' = dW + W x phi in the world's axes, phi' = dw - w x phi in those of the body."""
    spin = 7.0
    rows = interpreted(model, top(spin), axes).A[:3]
    turn = sense * spin * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(rows, np.hstack([turn, np.eye(3)]), atol=1e-12)


def test_python_control_takes_the_archive(tmp_path: Any) -> None:
    control = pytest.importorskip("control")
    found = interpreted(model, top(3.0, pull={"type": "commanded_wrench", "body": "top"}))
    found.to_npz(tmp_path / "linear_model.npz")
    f = np.load(tmp_path / "linear_model.npz")
    names = {key: [str(x) for x in f[key]] for key in ("states", "inputs", "outputs")}
    plant = control.ss(f["A"], f["B"], f["C"], f["D"], **names)
    assert plant.ninputs == 6 and plant.nstates == 6
    # a torque about the vertical speeds the spin up by M / I3, and nothing else does
    at, by = names["outputs"].index("top/spin_z"), names["inputs"].index("top/torque_z")
    assert complex(plant(1j)[at, by]) == pytest.approx(1.0 / (AXIAL * 1j), rel=1e-9)


def test_what_cannot_be_linearised_is_told_in_one_line() -> None:
    from rb_sim import RbSimError

    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0.0, 0.0, 0.1]}
    scene = top(0.0) | {
        "bodies": {"ball": ball},
        "constraints": {"floor": {"type": "contact", "body": "ball"}},
    }
    with pytest.raises(RbSimError, match="has contacts"):
        interpreted(model, scene)
    with pytest.raises(RbSimError, match="axes: got 'polar'; must be 'world' or 'body'"):
        interpreted(model, top(1.0), "polar")
