"""Samples that resolve a motion, that miss it, and that a coarse method spoils."""

from types import SimpleNamespace

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.checks.check import effort_of
from rb_sim.checks.check_list import WatchList
from rb_sim.checks.sample_integrals import Resolution

T = np.linspace(0.0, 1.0, 51)


def _block(position, velocity, spin=0.0, turn=None):
    """One body, of 1 kg and 1 kg m^2, that moves along x and y and turns about z; position,
    velocity: (N, 2)."""
    still = np.zeros((len(T), 1, 3))
    x, v, w, q = still.copy(), still.copy(), still.copy(), np.zeros((len(T), 1, 4))
    x[:, 0, :2], v[:, 0, :2], w[:, 0, 2] = position, velocity, spin
    turn = spin * T if turn is None else turn
    q[:, 0, 2], q[:, 0, 3] = np.sin(0.5 * turn), np.cos(0.5 * turn)
    columns = {"position": x, "orientation": q, "linear_velocity": v, "angular_velocity": w}
    return SimpleNamespace(t=T, momentum=v[:, 0], angular_momentum=w[:, 0], **columns)


def _resolved(block):
    resolution = Resolution()
    resolution.add(block)
    return resolution.resolved


def _circle(turns_per_sample):
    rate = turns_per_sample * 2.0 * np.pi * (len(T) - 1)
    at, along = np.cos(rate * T), np.sin(rate * T)
    return np.stack([at, along], 1), rate * np.stack([-along, at], 1)


def test_a_circle_of_a_hundred_samples_is_resolved():
    assert _resolved(_block(*_circle(0.01)))


@pytest.mark.parametrize("turns", [0.5, 1.0, 1.01, 2.0])
def test_a_circle_whose_turns_fall_between_samples_is_not(turns):
    assert not _resolved(_block(*_circle(turns)))


def test_a_spin_of_more_than_half_a_radian_between_samples_is_not():
    dt = T[1] - T[0]
    assert _resolved(_block(*_circle(0.01), spin=0.4 / dt))
    assert not _resolved(_block(*_circle(0.01), spin=0.6 / dt))


@pytest.mark.parametrize(("turns", "resolved"), [(0.05, True), (0.45, False), (1.01, False)])
def test_a_body_that_swings_to_and_fro_between_samples_by_little_is_not(turns, resolved):
    """By 0.02 rad, so that it never turns far: only its spins do not tell its attitudes."""
    rate = turns * 2.0 * np.pi * (len(T) - 1)
    swing = 0.02 * np.sin(rate * T + 0.3), 0.02 * rate * np.cos(rate * T + 0.3)
    still = np.zeros((len(T), 2))
    assert _resolved(_block(still, still, swing[1], swing[0])) is resolved


@pytest.mark.parametrize(("still", "resolved"), [(0.2, True), (0.4, False)])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_positions_that_a_coarse_method_parts_from_velocities_near_rest_are(size, still, resolved):
    """From rest, x = t^2 / 2; for a fifth of the time positions stand still, as in Euler's first
    steps: a twenty-fifth of the whole way. Of two fifths it is a sixth."""
    x = size * np.where(T < still, 0.0, 0.5 * T**2)
    assert _resolved(_block(np.stack([x, 0 * x], 1), np.stack([size * T, 0 * T], 1))) is resolved


@pytest.mark.parametrize("intervals", [200, 2000])
@pytest.mark.parametrize(("share", "resolved"), [(0.016, True), (0.024, False)])
def test_a_fiftieth_of_the_intervals_may_turn_far(intervals, share, resolved):
    """0.6 rad from sample to sample at first, then 0.1 rad; of many every fourth stands for all."""
    t = np.linspace(0.0, 1.0, intervals + 1)
    turns = np.where(np.arange(intervals) < share * intervals, 0.6, 0.1)
    angle, still = np.append(0.0, np.cumsum(turns)), np.zeros((len(t), 1, 3))
    spin, attitude = still.copy(), np.zeros((len(t), 1, 4))
    spin[:, 0, 2] = intervals * np.append(0.6, turns)
    attitude[:, 0, 2], attitude[:, 0, 3] = np.sin(0.5 * angle), np.cos(0.5 * angle)
    block = SimpleNamespace(
        t=t, position=still, orientation=attitude, linear_velocity=still, angular_velocity=spin,
        momentum=still[:, 0], angular_momentum=spin[:, 0],
    )  # fmt: skip
    resolution = Resolution()
    resolution.add(block)
    assert resolution.resolved is resolved


def test_a_jump_in_one_interval_of_fifty_says_nothing_of_the_others():
    """However much of the way it is."""
    x = np.where(T > 0.5, 0.5, 0.0)
    assert _resolved(_block(np.stack([x, 0 * x], 1), np.zeros((len(T), 2))))
    x = np.where(T > 0.5, 0.5, 0.0) + np.where(T > 0.7, 0.5, 0.0)
    assert not _resolved(_block(np.stack([x, 0 * x], 1), np.zeros((len(T), 2))))


def test_a_turn_between_samples_is_resolved_up_to_half_a_radian():
    dt = T[1] - T[0]
    for turn, resolved in ((0.4, True), (0.6, False)):
        resolution = Resolution()
        resolution.add(_block(*_circle(0.01), spin=turn / dt))
        assert resolution.resolved == resolved


def test_a_body_thrown_back_within_one_interval_shows_what_its_samples_miss():
    """At 1 m/s against a wall and back: its velocity changes by 2 m/s in one interval of 50, where
    its way is not the mean of the velocities."""
    position = np.stack([np.minimum(T, 1.21 - T), 0.0 * T], 1)
    velocity = np.stack([np.where(T < 0.605, 1.0, -1.0), 0.0 * T], 1)
    resolution = Resolution()
    resolution.add(_block(position, velocity))
    assert resolution.resolved
    assert resolution.unseen == pytest.approx([2.0, 0.0])


def test_rounding_of_what_is_held_at_rest_hides_nothing():
    """A body whose whole way is its rounding, beside one whose positions a coarse method parts from
    its velocities: Euler's gain of 9 % of the energy of a fall stayed untold there."""
    x = np.where(T < 0.2, 0.0, 0.5 * T**2)
    falls = _block(np.stack([x, 0 * x], 1), np.stack([T, 0 * T], 1))
    rounding = 1e-16 * np.random.default_rng(1).standard_normal((len(T), 2))
    held = _block(0.3 + rounding, rounding, turn=rounding[:, 0])
    columns = ("position", "orientation", "linear_velocity", "angular_velocity")
    both = {name: np.append(getattr(held, name), getattr(falls, name), 1) for name in columns}
    momenta = {"momentum": falls.momentum, "angular_momentum": falls.angular_momentum}
    assert _resolved(SimpleNamespace(t=T, **both, **momenta))


@pytest.mark.parametrize("dragged", ["bob", "other", ""])
def test_a_drag_on_another_body_does_not_hide_energy_that_is_lost(dragged: str) -> None:
    """radau5 at 1.2 rad a step takes a fifth of the energy of a spring; samples two thirds of a
    period apart say nothing of what a drag on its own body would take."""
    frequency = 400.0
    spring = {"type": "spring", "body": "bob", "stiffness": frequency**2, "point_A": [0, 0, 0]}
    effects = {"spring": spring | {"rest_length": 0.0}}
    if dragged:
        effects["oil"] = {"type": "quadratic_drag", "body": dragged, "coefficient": 1e-3}
    body = {"mass": 1.0, "inertia": [0.1] * 3}
    bodies = {
        "bob": body | {"position": [0.01, 0.0, 0.0]},
        "other": body | {"position": [0.0, 1.0, 0.0], "linear_velocity": [1.0, 0.0, 0.0]},
    }
    options = {"method": "radau5", "step": 1.2 / frequency, "duration": 0.5, "rate": 100.0}
    scene = load_scene({"bodies": bodies, "effects": effects, "simulation": options})
    simulation = Simulation(scene, announce=None)
    watches = WatchList(simulation.scene, simulation.layout)
    for block in simulation.blocks(options["duration"], options["rate"]):
        watches.add(block, effort_of(simulation))
    energy = watches.ledger.energy()
    assert energy is not None and energy["relative"] > 0.1
    told = "energy" in [finding.watch for finding in watches.findings]
    assert told == (dragged != "bob")
