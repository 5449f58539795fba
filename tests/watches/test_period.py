"""Energy that got lost makes a phase wrong in the course of time; beside elliptic functions."""

from __future__ import annotations

import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from rb_sim import Simulation, load_scene
from rb_sim.finding import Finding
from rb_sim.watches.bounds import Effort
from rb_sim.watches.period import SUSPECT, Missed, growth, period_found
from tests.watches.blocks import Block

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


@pytest.mark.parametrize(("step", "rate"), [(0.02, 0.1), (0.01, 1.0)])
def test_fixed_steps_that_lose_the_phase_are_told(step: float, rate: float) -> None:
    """Each follows the motion, and the energy is right to 8e-4 and 3e-5: silent before. The samples
    are one block, or so many that glances are taken at some."""
    options = {"method": "rk4", "step": step, "rate": rate}
    assert error(rod(2.0, **options), 2.0) > 0.3
    (found,) = told(rod(2.0, **options))
    assert found.t == DURATION and found.finer_step is not None
    assert error(rod(2.0, **options | {"step": found.finer_step}), 2.0) < 0.2


@pytest.mark.parametrize(
    ("method", "step", "amplitude"),
    [("rk4", 0.01, 0.3), ("gauss6", 0.05, 3.0)],
)
def test_fixed_steps_that_keep_it_are_not(method: str, step: float, amplitude: float) -> None:
    """The energy of gauss6 goes to and fro by 2e-9, and its phase hangs on that by nothing."""
    options = {"method": method, "step": step}
    assert error(rod(amplitude, **options), amplitude) < 0.02
    assert not told(rod(amplitude, **options))


@pytest.mark.parametrize("count", [10, 1000])
def test_only_an_error_that_grows_counts_in_fixed_steps(count: int) -> None:
    t = np.linspace(0.0, 1.0, count)
    even, swinging = Missed(), Missed()
    even.look(t, 3e-6 * t)
    for now in t:
        swinging.add(float(now), 3e-6 * abs(np.sin(40.0 * now)))
    assert even.grown(3e-6, 1.0) == pytest.approx(3e-6, rel=0.2)
    assert swinging.grown(2.5e-6, 1.0) == 0.0
    assert Missed().grown(3e-6, 1.0) == 0.0


@pytest.mark.parametrize(
    ("setting", "off"),
    [({"method": "dopri853", "tolerance": 1e-4}, 1e-3), ({"method": "rk4", "step": 0.015}, 0.1)],
)
def test_what_swings_alike_at_any_energy_is_not(setting: dict[str, Any], off: float) -> None:
    """A body on a spring of no length: its energy is off by 7e-5 or 2e-4 in the end, its phase by
    no more than a step misses of it; a pendulum's would be lost."""
    body = {"mass": 1.0, "inertia": [0.1] * 3, "position": [2.0, 0.0, 0.0]}
    spring = {"type": "spring", "body": "ball", "stiffness": 14.0}
    scene = {
        "bodies": {"ball": body},
        "effects": {"spring": spring},
        "simulation": {"duration": DURATION, "rate": 0.1} | setting,
    }
    simulation = Simulation(load_scene(scene), announce=None)
    run = simulation.run()
    exactly = 2.0 * np.cos(np.sqrt(14.0) * run.t)
    np.testing.assert_allclose(run.position["ball"][:, 0], exactly, atol=off)
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


def turning(span: float, samples: int, ahead: float, energy: float) -> Any:
    """Of two bodies, one that goes round at 3 m/s and 5 rad/s, `ahead` rad/s faster; one rests."""
    t = 7.0 + np.linspace(0.0, span, samples)
    angle = (5.0 + ahead) * (t - 7.0)
    speed = np.zeros((samples, 2, 3))
    speed[:, 1, 0], speed[:, 1, 2] = 3.0 * np.cos(angle), 3.0 * np.sin(angle)
    return Block(
        t,
        linear_velocity=speed,
        angular_velocity=np.zeros_like(speed),
        energy=np.linspace(energy, 2.0 * energy, samples),
    )


TWO = SimpleNamespace(
    bodies={k: SimpleNamespace(mass=1.0, inertia=np.eye(3), inertia_rank=3) for k in "ab"}
)


def test_how_fast_motions_part_for_each_joule() -> None:
    """By the angle 2e-3 t over 10 s, a part of the largest velocity as large; of 1e-2 J."""
    scene: Any = TWO
    slow, fast = turning(10.0, 101, 0.0, 4.0), turning(10.0, 101, 2e-3, 4.01)
    assert growth(scene, slow, fast, 10) == pytest.approx(2e-3 / 0.01, rel=0.02)
    assert growth(scene, fast, slow, 10) == pytest.approx(2e-3 / 0.01, rel=0.02)
    fast.linear_velocity[40:60] *= -1.0  # only how it begins and ends counts
    assert growth(scene, slow, fast, 10) == pytest.approx(2e-3 / 0.01, rel=0.02)
    assert growth(scene, slow, turning(10.0, 101, 2e-3, 4.0), 10) == 0.0
    assert growth(scene, slow, turning(10.0, 101, 0.0, 4.01), 10) == 0.0


@pytest.mark.parametrize(
    ("steps", "local", "faster", "looked"),
    [
        (60_000, 1e-8, 3e-5, 300),
        (60_000, 1e-10, 1e-5, 300),
        (60_000, 1e-3, 1e-2, 300),
        (200_000, 1e-8, 4e-5, 400),
        (40_000, 1e-8, 2e-5, 200),
    ],
)
def test_what_is_asked_of_the_motion_ahead(
    steps: int, local: float, faster: float, looked: int
) -> None:
    """A step in 200 of the run, up to 400; ten times faster than what so many steps may miss. What
    1e-3 J make of t = 1e4 s: half of t times that times 1e-3 rad/s for 1e-2 J, or 0.5."""
    asked: list[tuple[float, ...]] = []

    def ahead(*span: float) -> Any:
        asked.append(span)
        return turning(10.0, 101, 1e-3 if span[2] else 0.0, 4.01 if span[2] else 4.0)

    effort = Effort("dopri853", None, 1e-9, steps, 0, local=local, ahead=ahead)
    scene: Any = TWO
    found = period_found(scene, effort, 1e-3, 1.0, 1e4)
    span = pytest.approx(looked * 1e4 / steps)
    assert asked == [(span, 2 * looked, 0.0), (span, 2 * looked, pytest.approx(faster))]
    assert found is not None and found.figure == pytest.approx(0.5, rel=0.02)
    assert (found.t, found.bound) == (1e4, 0.1) and "below 1e-10" in found.advice
    worse = period_found(scene, effort, 1e-2, 1.0, 1e4)
    assert worse is not None and worse.figure == 1.0 and "below 2e-11" in worse.advice
    assert period_found(scene, effort, 1.9e-4, 1.0, 1e4) is None  # 0.095
    asked.clear()
    suspect = SUSPECT / steps
    assert period_found(scene, effort, 0.99e3 * suspect, 1e3, 1e4) is None and not asked
    period_found(scene, effort, 1.01e3 * suspect, 1e3, 1e4)
    assert asked
    for blind in (
        effort._replace(ahead=None),
        effort._replace(steps=39_999),
    ):
        assert period_found(scene, blind, 1e-3, 1.0, 1e4) is None
    assert period_found(scene, effort, 1e-3, 0.0, 1e4) is None
    nothing = effort._replace(ahead=lambda *span: None)
    assert period_found(scene, nothing, 1e-3, 1.0, 1e4) is None
