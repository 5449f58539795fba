# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The laws of shipped scenes on arrays, against what the engine recorded of the same states."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim import load_scene
from rb_sim.bags.analysis.recorded_run import analyze, coordinates
from rb_sim.bags.analysis.scene_laws import SceneLaws
from tests.bags.scenes import record_run

SCENES = {"heavy_top": 0.05, "pendulum": 0.3, "rolling_disk": 0.2, "stick_slip": 0.05,
          "sphere_off_sphere": 0.03, "turntable": 0.03}  # fmt: skip


def _run(name: str, duration: float):
    from rb_sim import Simulation

    scene = load_scene(name, duration=duration, rate=20 / duration)
    return Simulation(scene).run(checks=False).block


@pytest.mark.parametrize("name", SCENES)
def test_energies_momenta_and_errors(name):
    block = _run(name, SCENES[name])
    laws = SceneLaws(load_scene(name))
    found = laws.at(block.t, coordinates(block))
    np.testing.assert_allclose(found.kinetic, block.kinetic_energy, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.potential, block.potential_energy, rtol=1e-12, atol=1e-12)
    momenta = np.hstack([block.momentum, block.angular_momentum])
    np.testing.assert_allclose(found.momenta, momenta, rtol=1e-12, atol=1e-12)
    assert np.abs(found.gap).max(initial=0.0) < 1e-10 * laws.length
    assert np.abs(found.slip).max(initial=0.0) < 1e-9 * laws.speed
    assert found.overlap.max(initial=0.0) < 1e-9 * laws.length
    moved = coordinates(block) + np.eye(1, 13 * len(laws.bodies), 2)  # lifted by a metre
    lifted = laws.at(block.t, moved)
    if laws.points:
        assert (np.abs(lifted.overlap - found.overlap) > 0.1).all()
    elif name != "rolling_disk":
        assert np.abs(lifted.gap).max() == pytest.approx(1.0, rel=1e-9)


def test_turns_of_a_torsion_spring_are_counted_over_the_samples():
    """Wound by 7.6 rad, as the run has it, in pieces and once more."""
    from tests.catalogue.test_effects import wound

    simulation = wound("reduced", 50.0)
    block = simulation.run(checks=False).block
    laws, half = SceneLaws(simulation.scene), len(block) // 2
    y = coordinates(block)
    for part in (slice(0, half), slice(half, None), slice(0, half), slice(half, None)):
        found = laws.at(block.t[part], y[part])
        wanted = block.potential_energy[part]
        np.testing.assert_allclose(found.potential, wanted, rtol=1e-9, atol=1e-9)


# The wrenches that a run of ours tells, beside those that its poses take.


TWO = """\
bodies:
  stone: {mass: 2.0, inertia: [1, 1, 1]}
  balloon: {mass: 3.0, inertia: [1, 1, 1], position: [5, 0, 0], linear_velocity: [0, 0, 1]}
effects:
  weight: {type: gravity, bodies: [stone]}
  drift: {type: gravity, acceleration: [0.5, 0, 0]}
simulation: {duration: 0.2, method: rk4, step: 1.0e-2, rate: 100}
"""


def test_weight_acts_on_the_bodies_that_it_names(tmp_path) -> None:
    """The recorded total of the balloon is without the stone's weight, as its motion is."""
    reported = analyze(record_run(TWO, tmp_path / "bag")).as_dict()["bodies"]
    for name, mass, weight in (("stone", 2.0, -9.81), ("balloon", 3.0, 0.0)):
        recorded = {key: reported[name]["recorded"][key]["mean"] for key in ("Fx", "Fz")}
        assert recorded == pytest.approx({"Fx": 0.5 * mass, "Fz": mass * weight}, rel=1e-12)
        assert reported[name]["apart"]["force"] < 1e-8
