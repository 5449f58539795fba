# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A contact between all bodies, which is checked as one of each body, in the scene of a plan."""

from __future__ import annotations

from pathlib import Path

import pytest

from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.sweeps.plan import load_plan

SCENE = """\
bodies:
  low: {mass: 1.0, shape: {type: sphere, radius: 0.1}, position: [0, 0, 0.1]}
  high: {mass: 2.0, shape: {type: sphere, radius: 0.1}, position: [0, 0, 0.3]}
constraints:
  floor: {type: contact, body: all}
  heap: {type: contact, between: all, restitution: 0.1}
effects:
  weight: {type: gravity, acceleration: [0.0, 0.0, -9.81]}
simulation: {duration: 0.02, rate: 100, method: time_stepping, step: 0.001}
"""


@pytest.mark.parametrize("path", ["bodies.high.mass", "constraints.heap.restitution"])
def test_the_floor_bears_both_weights(tmp_path: Path, path: str) -> None:
    (tmp_path / "two.yaml").write_text(SCENE)
    runner = PlanRunner(
        load_plan(
            {
                "scene": str(tmp_path / "two.yaml"),
                "vary": {"value": {"path": path, "grid": {"from": 0.2, "to": 0.4, "count": 2}}},
                "outputs": {"load": "last(norm(reaction.floor_low.force))"},
            }
        )
    )
    for value in (0.2, 0.4):
        row, _ = runner.run({"value": value})
        mass = 1.0 + (value if path == "bodies.high.mass" else 2.0)
        assert row["load"] == pytest.approx(9.81 * mass, rel=1e-9), row
