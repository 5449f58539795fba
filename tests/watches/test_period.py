"""Energy that got lost makes a phase wrong in the course of time; beside elliptic functions."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from rb_sim import Simulation, load_scene
from rb_sim.finding import Finding
from rb_sim.watches.period import SUSPECT

FREQUENCY = 3.836
"""Of small swings of the rod [rad/s]: m g l/2 = m l^2/3 w^2."""
DURATION = 1e4


def rod(amplitude: float, **options: Any) -> Simulation:
    """A rod of 1 m on a hinge, let go at so much from hanging."""
    s, c = np.sin(amplitude), np.cos(amplitude)
    body = {
        "mass": 1.0,
        "inertia": [1.0 / 12.0] * 3,
        "position": [-0.5 * s, 0.0, -0.5 * c],
        "orientation": {"axis": [0, 1, 0], "angle": amplitude},
    }
    hinge = {"type": "fixed_axis", "body": "rod", "axis_B": [0, 1, 0], "point_B": [0, 0, 0.5]}
    scene = {
        "bodies": {"rod": body},
        "constraints": {"hinge": hinge},
        "effects": {"weight": {"type": "gravity", "acceleration": [0, 0, -(FREQUENCY**2) / 1.5]}},
        "simulation": {"duration": DURATION, "rate": 0.1} | options,
    }
    return Simulation(load_scene(scene), announce=None)


def exact(amplitude: float, t: np.ndarray) -> np.ndarray:
    """The angle at t: sin(x/2) = k sn(K - w t, k) with k = sin(amplitude/2)."""
    k = np.sin(0.5 * amplitude)
    return 2.0 * np.arcsin(k * ellipj(ellipk(k * k) - FREQUENCY * t, k * k)[0])


def told(simulation: Simulation) -> list[Finding]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = simulation.run()
    return [finding for finding in run.findings if finding.watch == "period"]


def error(simulation: Simulation, amplitude: float) -> float:
    """Of the angle [rad], over the run."""
    run = simulation.run(watched=False)
    q = run.orientation["rod"]
    off = 2.0 * np.arctan2(q[:, 1], q[:, 3]) - exact(amplitude, run.t)
    return float(np.abs(np.remainder(off + np.pi, 2.0 * np.pi) - np.pi).max())


LOST = [("dopri853", 1e-8, 3.0), ("dopri853", 1e-7, 2.0), ("taylor", 1e-7, 3.0)]
KEPT = [("dopri853", 1e-10, 2.0), ("dopri853", 1e-8, 1.0), ("taylor", 1e-9, 3.0)]


@pytest.mark.parametrize(("method", "tolerance", "amplitude"), LOST)
def test_a_phase_that_is_lost_is_told(method: str, tolerance: float, amplitude: float) -> None:
    """Energy is right to 1e-6 to 1e-4: silent before."""
    options = {"method": method, "tolerance": tolerance}
    assert error(rod(amplitude, **options), amplitude) > 0.5
    (found,) = told(rod(amplitude, **options))
    assert (found.figure, found.t) == (1.0, DURATION)
    assert "--certify" in found.advice


@pytest.mark.parametrize(("method", "tolerance", "amplitude"), KEPT)
def test_a_phase_that_is_right_is_not(method: str, tolerance: float, amplitude: float) -> None:
    options = {"method": method, "tolerance": tolerance}
    assert error(rod(amplitude, **options), amplitude) < 0.02
    assert not told(rod(amplitude, **options))


def test_the_figure_is_what_the_phase_misses() -> None:
    """Of velocities over the largest, where an angle of amplitude 2 misses as much of its phase."""
    options = {"method": "taylor", "tolerance": 1e-7}
    (found,) = told(rod(2.0, **options))
    assert 0.3 < found.figure / (error(rod(2.0, **options), 2.0) / 2.0) < 3.0


def test_what_swings_alike_at_any_energy_is_not() -> None:
    """A body on a spring of no length: its energy is off by 7e-5 in the end, its phase by no
    more; a pendulum's would be lost."""
    body = {"mass": 1.0, "inertia": [0.1] * 3, "position": [2.0, 0.0, 0.0]}
    spring = {"type": "spring", "body": "ball", "stiffness": 14.0}
    scene = {
        "bodies": {"ball": body},
        "effects": {"spring": spring},
        "simulation": {"duration": DURATION, "rate": 0.1, "method": "dopri853", "tolerance": 1e-4},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    run = simulation.run()
    exactly = 2.0 * np.cos(np.sqrt(14.0) * run.t)
    np.testing.assert_allclose(run.position["ball"][:, 0], exactly, atol=1e-3)
    lost = abs(run.energy[-1] - run.energy[0]) / run.energy[0]
    assert lost * simulation.steps > SUSPECT
    assert "period" not in {finding.watch for finding in run.findings}


def test_the_run_goes_on_as_if_nobody_had_asked() -> None:
    one, two = (rod(3.0, tolerance=1e-8, duration=5000.0) for _ in range(2))
    one.run(watched=False)
    with pytest.warns(UserWarning, match="period"):
        two.run()
    again = [simulation.run(duration=10.0, watched=False) for simulation in (one, two)]
    np.testing.assert_array_equal(again[0].block.orientation, again[1].block.orientation)
