# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One run of a sweep: numbers found by their path, accuracy that is lost, contacts of all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SceneError
from rb_sim.sweeps.one_run import PlanRunner, parse
from rb_sim.sweeps.plan import load_plan, points
from rb_sim.sweeps.sweep import MOST, look_over, to_look_at


@pytest.mark.parametrize(
    "text", ["", "bodies..top", "[0]", ".bodies", "bodies.top[x]", "a[0]b", "a."]
)
def test_what_is_no_path_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(SceneError, match="must be a path like"):
        parse(text, "f")


# A sweep whose runs lose accuracy says so, though none of them is watched on its way.


SPIN = """\
description: a free body that spins about its middle axis, as a plan gives it
bodies:
  nut: {mass: 1.0, inertia: [1.0, 2.0, 3.0], angular_velocity: [0.1, 1.0, 0.2]}
simulation: {duration: 1.0, rate: 20, method: euler, step: 0.02}
"""


def spins(folder: Any, **simulation: Any) -> dict[str, Any]:
    """A plan of 61 spins from 0 to 60 rad/s; Euler's method gains half of (w h)^2 in a step."""
    scene = folder / "spin.yaml"
    scene.write_text(SPIN)
    spin = {
        "path": "bodies.nut.angular_velocity[1]",
        "grid": {"from": 0.0, "to": 60.0, "count": 61},
    }
    outputs = {"energy": "last(kinetic_energy)"}
    return {
        "scene": str(scene),
        "vary": {"spin": spin},
        "outputs": outputs,
        "simulation": simulation,
    }


def lost(described: dict[str, Any], runs: list[int]) -> dict[int, set[str]]:
    """The watches that spoke, by run."""
    loaded = load_plan(described)
    found: dict[int, set[str]] = {}
    for each in look_over(PlanRunner(loaded), points(loaded.plan), runs):
        assert str(each).startswith(f"run {each.run}: {each.finding.check}: ")
        found.setdefault(each.run, set()).add(each.finding.check)
    return found


def test_the_runs_that_lose_it_are_named(tmp_path: Any) -> None:
    """At rest nothing is lost; at 60 rad/s a step turns by 1.2 rad."""
    found = lost(spins(tmp_path), [0, 60])
    assert found.keys() == {60}
    assert "energy" in found[60]
    assert lost(spins(tmp_path, method="dopri853", tolerance=1e-9), [0, 60]) == {}


def test_a_run_that_fails_is_reported_as_far_as_it_went(tmp_path: Any) -> None:
    described = spins(tmp_path, duration=1000.0)
    assert "energy" in lost(described, [60])[60]


def test_some_are_looked_at_both_ends_among_them() -> None:
    assert to_look_at(np.array([7])) == [7]
    assert to_look_at(np.arange(3, 43)) == [3, 42]
    chosen = to_look_at(np.arange(10_000))
    assert len(chosen) == MOST and (chosen[0], chosen[-1]) == (0, 9999)


def test_a_whole_sweep_warns(tmp_path: Any, here: str) -> None:
    pytest.importorskip("pyarrow")
    pytest.importorskip("distributed")
    from rb_sim import AccuracyWarning
    from rb_sim.sweeps.sweep import sweep

    with pytest.warns(AccuracyWarning, match="^run 60: energy: "):
        result = sweep(spins(tmp_path), tmp_path / "coarse", scheduler=here)
    assert (result.looked_at, {each.run for each in result.lost}) == (2, {60})


# A contact between all bodies, which is checked as one of each body, in the scene of a plan.


SCENE_ALL = """\
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
    (tmp_path / "two.yaml").write_text(SCENE_ALL)
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
