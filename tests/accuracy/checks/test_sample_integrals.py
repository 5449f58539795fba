# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Integrals over samples against closed forms, and whether samples resolve a motion."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.accuracy.checks.check import Effort, effort_of
from rb_sim.accuracy.checks.check_list import UNCERTAINTIES, CheckList
from rb_sim.accuracy.checks.sample_integrals import Quadrature, Resolution

RNG = np.random.default_rng(38)


def integrals(t, f, cuts):
    """Integral, how far it may be wrong, and that of the size."""
    rule = Quadrature(f.shape[1])
    for part in np.split(np.arange(len(t)), cuts):
        rule.add(t[part], f[part])
        rule.total()
    return rule.total()


def integral(t, f, cuts):
    return integrals(t, f, cuts)[0]


@pytest.mark.parametrize("n", [4, 5, 6, 40])
def test_cubic_is_exact_on_any_grid(n):
    t = np.cumsum(RNG.uniform(0.5, 1.5, n))
    f = np.c_[np.ones(n), t**3 - 2.0 * t]
    want = [t[-1] - t[0], (t[-1] ** 4 - t[0] ** 4) / 4.0 - t[-1] ** 2 + t[0] ** 2]
    np.testing.assert_allclose(integral(t, f, []), want, rtol=1e-13)


@pytest.mark.parametrize("cuts", [[1], [1, 2, 3, 4, 5], [10, 11, 40], [49]])
def test_blocks_do_not_matter(cuts):
    t = np.linspace(0.0, 1.0, 50)
    f = np.c_[np.exp(t), np.cos(5.0 * t)]
    np.testing.assert_allclose(integral(t, f, cuts), integral(t, f, []), rtol=1e-14)
    got, whole = (integrals(t, f, c) for c in (cuts, []))
    np.testing.assert_allclose(got, whole, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("size", [1, 2, 3, 7, 100])
def test_what_is_left_out_parts_two_pieces(size):
    """Cubics that jump at 0.303 and at the sample 0.5: what is left of both is exact."""
    t = np.linspace(0.0, 1.0, 41)
    f = np.where(t < 0.303, t**3, np.where(t < 0.5, 2.0 - t, 5.0 * t**2))[:, None]
    out = np.isin(np.arange(41), np.searchsorted(t, [0.303, 0.5]))
    rule = Quadrature(1)
    for first in range(0, 41, size):
        part = slice(first, first + size)
        rule.add(t[part], f[part], out[part])
        rule.total()
    got, uncertainty, _ = rule.total()
    want = 0.3**4 / 4 + (2.0 * 0.15 - (0.475**2 - 0.325**2) / 2) + 5.0 * (1.0 - 0.125) / 3
    assert got[0] == pytest.approx(want, rel=1e-13)
    assert uncertainty[0] < 1e-4


def test_two_samples_are_in_doubt_altogether():
    """A node looks at what it has so far: a fast top was told to lose momentum after one step."""
    t = np.array([0.0, 0.002])
    total, uncertainty, _ = integrals(t, np.cos(300.0 * t)[:, None], [])
    assert abs(total - np.sin(300.0 * 0.002) / 300.0) <= uncertainty


@pytest.mark.parametrize("n", [3, 4, 9, 40])
def test_asking_in_between_changes_neither_integral_nor_doubt(n):
    """A watch asks after every block; what it took along for the last sample stayed in the half,
    so that of three samples none was in doubt."""
    t = np.linspace(0.0, 1.0, n) ** 2
    f = np.exp(-3.0 * t)[:, None]
    whole, asked = Quadrature(1), Quadrature(1)
    whole.add(t, f)
    for i in range(n):
        asked.add(t[i : i + 1], f[i : i + 1])
        asked.total()
    np.testing.assert_allclose(asked.total(), whole.total(), rtol=1e-12, atol=1e-14)
    assert whole.total()[1] > 1e-9


@pytest.mark.parametrize("cuts", [(), (150,), (99, 100, 101, 260)])
def test_a_gap_is_in_doubt_altogether(cuts) -> None:
    """Half the samples have it as all of them do: by them alone it would be known to 1e-4 of it."""
    t = np.arange(400) * 0.01
    t[100:] += 2.0
    f = np.cos(3.0 * t)[:, None]
    quadrature = Quadrature(1)
    for part in np.split(np.arange(400), cuts):
        quadrature.add(t[part], f[part])
        quadrature.total()
    total, uncertainty, _ = quadrature.total()
    error = abs(total[0] - (np.sin(3.0 * t[-1]) / 3.0))
    assert 0.01 < error < uncertainty[0]
    whole = 0.5 * 2.01 * (abs(f[99, 0]) + abs(f[100, 0]))
    assert uncertainty[0] == pytest.approx(whole, rel=0.2)


def test_short_intervals_beside_events_make_no_gaps_of_the_others() -> None:
    t = np.sort(np.concatenate([np.arange(100) * 0.01, np.arange(1000) * 1e-7 + 0.305]))
    quadrature = Quadrature(1)
    quadrature.add(t, np.cos(3.0 * t)[:, None])
    total, uncertainty, _ = quadrature.total()
    assert abs(total[0] - np.sin(3.0 * t[-1]) / 3.0) < 1e-6 and uncertainty[0] < 1e-5


@pytest.mark.parametrize("decay", np.geomspace(1e-4, 0.1, 13))
def test_what_decays_between_two_samples_is_in_doubt(decay: float) -> None:
    """The power of a drag that stops a body in a millisecond, sampled every 10 ms; every other
    sample left out may change nothing by chance."""
    t = np.linspace(0.0, 0.5, 51)
    rule = Quadrature(1)
    rule.add(t, np.exp(-t / decay)[:, None])
    got, uncertainty, _ = rule.total()
    error = abs(got[0] - decay * (1.0 - np.exp(-0.5 / decay)))
    assert error <= UNCERTAINTIES * uncertainty[0] + 1e-15


# Samples that resolve a motion, that miss it, and that a coarse method spoils.


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
    return SimpleNamespace(t=T, **columns)


def _resolved(block):
    """Whether all intervals are; a tenth or less of them where the motion is not."""
    share = Resolution().missed(block)[1:].mean()
    assert share == 0.0 or share > 0.5
    return bool(share == 0.0)


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


def test_an_interval_in_which_a_body_jumps_says_nothing_of_the_others():
    """However much of the way it is, and however the samples come."""
    x = np.where(T > 0.5, 0.5, 0.0)
    block = _block(np.stack([x + T, 0 * x], 1), np.stack([np.ones_like(T), 0 * T], 1))
    jumps = np.flatnonzero(np.diff(x)) + 1
    assert np.flatnonzero(Resolution().missed(block)).tolist() == jumps.tolist()
    resolution, found = Resolution(), []
    for part in np.split(np.arange(len(T)), [1, 7, *jumps]):
        columns = {name: value[part] for name, value in vars(block).items()}
        found += resolution.missed(SimpleNamespace(**columns)).ravel().tolist()
    assert np.flatnonzero(found).tolist() == jumps.tolist()


def test_what_is_held_at_rest_is_resolved():
    """Its whole way is rounding."""
    rounding = 1e-16 * np.random.default_rng(1).standard_normal((len(T), 2))
    assert _resolved(_block(0.3 + rounding, rounding, turn=rounding[:, 0]))


@pytest.mark.parametrize("load", [540.0, 1.0])
def test_what_a_drag_takes_up_between_two_samples_is_in_doubt(load: float) -> None:
    """A body of 0.1 kg is pushed at once up to a speed at which its drag takes up the force,
    v = F / c (1 - exp(-c t / m)): within the first interval if c / m is 5400 / s, so that no sample
    shows the work of either, and over all of them if it is 50 / s."""
    body = {"mass": 0.1, "inertia": [0.01, 0.01, 0.01]}
    effects = {
        "drag": {"type": "linear_drag", "body": "b", "coefficient": load},
        "push": {"type": "wrench", "body": "b", "force": [30.0 * load, 0.0, 0.0]},
    }
    options = {"duration": 0.5, "rate": 100.0}
    scene = {"bodies": {"b": body}, "effects": effects, "simulation": options}
    simulation = Simulation(scene, announce=None)
    run = simulation.run(check=False)
    fall = np.exp(-load / 0.1 * run.t)
    np.testing.assert_allclose(run.block.linear_velocity[:, 0, 0], 30.0 * (1.0 - fall), atol=1e-7)
    assert run.findings == ()
    lost = replace(run.block, kinetic_energy=run.block.kinetic_energy * (1.0 + 0.3 * run.t))
    check_list = CheckList(simulation.scene, simulation.layout, simulation.compiled)
    check_list.add(lost, Effort("dopri853", None, 1e-10, 10))
    assert [found.check for found in check_list.findings] == ["energy"]


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
    check_list = CheckList(simulation.scene, simulation.layout)
    for block in simulation.blocks(options["duration"], options["rate"]):
        check_list.add(block, effort_of(simulation))
    energy = check_list.ledger.energy()
    assert energy is not None
    assert max(abs(energy["error"]), energy["quadrature"]) > 0.1 * energy["scale"]
    reported = "energy" in [finding.check for finding in check_list.findings]
    assert reported == (dragged != "bob")
