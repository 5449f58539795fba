# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The wrenches that a run of ours tells, beside those that its poses take."""

from __future__ import annotations

import pytest

from rb_sim.bags.analysis.run import analyze
from tests.bags.scenes import record_run
from tests.interpreted import interpreted

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
    told = analyze(interpreted(record_run, TWO, tmp_path / "bag")).as_dict()["bodies"]
    for name, mass, weight in (("stone", 2.0, -9.81), ("balloon", 3.0, 0.0)):
        recorded = {key: told[name]["recorded"][key]["mean"] for key in ("Fx", "Fz")}
        assert recorded == pytest.approx({"Fx": 0.5 * mass, "Fz": mass * weight}, rel=1e-12)
        assert told[name]["apart"]["force"] < 1e-8
