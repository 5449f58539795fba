# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs in lanes are the runs alone: same steps, same numbers, however many there are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyarrow")

from rb_sim.sweeps.batch import Batch, BatchRunner, LaneRunner, described, do_batch
from rb_sim.sweeps.expressions import Expression
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.sweeps.plan import load_plan, points
from rb_sim.sweeps.storage import open_table
from rb_sim.sweeps.sweep import _looks, _row
from tests.sweeps.plans import height, plan

OUTPUTS = {
    "energy": "mean(energy)",
    "height": "last(position.BODY.z)",
    "least": "min(orientation.BODY.w)",
    "fastest": "max(norm(angular_velocity.BODY))",
    "load": "max(norm(reaction))",
}
TOP = {
    "spin": {"path": "bodies.top.angular_velocity[1]", "uniform": [20.0, 150.0]},
    "mass": {"path": "bodies.top.mass", "uniform": [10.0, 20.0]},
    "drop": {"path": "bodies.top.center_of_mass[1]", "uniform": [0.5, 1.5]},
}
ROD = {
    "rate": {"path": "bodies.bar.angular_velocity[1]", "uniform": [0.0, 9.0]},
    "mass": {"path": "bodies.bar.mass", "uniform": [0.5, 2.0]},
}
BOX = {
    "spin": {"path": "bodies.body.angular_velocity[0]", "uniform": [0.1, 3.0]},
    "speed": {"path": "bodies.body.linear_velocity[2]", "uniform": [-1.0, 3.0]},
}
RK4, DOPRI853 = {"method": "rk4", "step": 0.003}, {"method": "dopri853", "tolerance": 1e-11}
"""The first with samples between its grid points."""
CASES = [
    ("heavy_top", TOP, RK4),
    ("heavy_top", TOP, {"method": "euler", "step": 0.002}),
    ("heavy_top", TOP, {"method": "dopri853", "step": 0.01}),
    ("heavy_top", TOP, {"method": "dopri853", "tolerance": 1e-6}),
    *((*scene, method) for scene in (("pendulum", ROD), ("free_tumble", BOX))
      for method in (RK4, DOPRI853)),
]  # fmt: skip


def runner(scene: str, vary: dict[str, Any], draws: int = 21, **simulation: Any) -> Any:
    """(runner, values of every run) of a plan on a shipped scene of one body."""
    from rb_sim import load_scene

    loaded = load_scene(scene)
    (body,) = loaded.bodies
    joints = [name for name, joint in loaded.constraints.items() if joint.type != "free"]
    outputs = {name: text.replace("BODY", body) for name, text in OUTPUTS.items()}
    del outputs["load"]
    if joints:
        reaction = {"fixed_axis": f'reaction["{joints[0]}/A"].force'}
        kind = loaded.constraints[joints[0]].type
        outputs["load"] = f"max(norm({reaction.get(kind, f'reaction.{joints[0]}.force')}))"
    for entry in vary.values():
        _, _, rest = entry["path"].split(".", 2)
        entry["path"] = f"bodies.{body}.{rest}"
    description = {
        "scene": scene,
        "vary": vary,
        "draws": draws,
        "outputs": outputs,
        "simulation": simulation,
    }
    loaded_plan = load_plan(description)
    values = points(loaded_plan.plan)
    made = PlanRunner(loaded_plan, _looks(values))
    return made, [_row(values, run) for run in range(draws)]


@pytest.mark.parametrize(("scene", "vary", "simulation"), CASES)
def test_lanes_and_one_at_a_time_agree(
    scene: str, vary: dict[str, Any], simulation: dict[str, Any]
) -> None:
    made, values = runner(scene, vary, duration=0.5, rate=100.0, **simulation)
    together = LaneRunner(made).rows(values)
    assert sorted(together) == list(range(len(values)))  # not one was left to go alone
    for k, point in enumerate(values):
        alone, _ = made.run(point)
        assert together[k].keys() == alone.keys()
        assert together[k]["status"] == "ok" and together[k]["steps"] == alone["steps"]
        for name in made.expressions:
            assert together[k][name] == pytest.approx(alone[name], rel=1e-12, abs=1e-12), name


def test_what_a_run_gives_does_not_depend_on_its_neighbours() -> None:
    made, values = runner("pendulum", ROD, method="dopri853", tolerance=1e-9, duration=0.3)
    whole = LaneRunner(made).rows(values)
    for cut in (1, 5):
        part = LaneRunner(made).rows(values[cut:])
        assert [part[k] for k in range(len(part))] == [whole[k] for k in range(cut, len(values))]


def test_a_run_that_fails_in_a_lane_is_reported_as_alone(tmp_path: Path) -> None:
    """A step that is too large for the fastest spins only; the others are not touched."""
    vary = {"spin": {"path": "bodies.top.angular_velocity[0]", "list": [1.0, 4e3, 2.0, 9e3, 3.0]}}
    scene = {"scene": "heavy_top", "vary": vary, "outputs": {"e": "last(energy)"}}
    simulation = {"method": "rk4", "step": 0.01, "duration": 0.5}
    made = PlanRunner(
        load_plan({**scene, "simulation": simulation}), [{"spin": 1.0}, {"spin": 2.0}]
    )
    values = [{"spin": x} for x in vary["spin"]["list"]]
    rows = [row for row, _ in BatchRunner(made).rows(range(5), values)]
    alone = [made.run(point)[0] for point in values]
    assert [row["status"] for row in rows] == ["ok", "failed", "ok", "failed", "ok"]
    assert [row["reason"] for row in rows] == [row["reason"] for row in alone]
    assert "too large" in rows[1]["reason"]
    assert rows[4] == alone[4]


def test_a_run_out_of_time_is_given_up_though_it_had_company(tmp_path: Path) -> None:
    slow = plan(tmp_path, seconds_per_run=1e-9, simulation={"duration": 4e3, "rate": 1.0})
    made = PlanRunner(load_plan(slow), [{"speed": 1.0, "start": 0.0}, {"speed": 2.0, "start": 1.0}])
    ((row, _),) = BatchRunner(made).rows([0], [{"speed": 1.0, "start": 0.0}])
    assert row["status"] == "given up"


def test_a_run_of_more_samples_than_fit_into_memory_is_a_row(tmp_path: Path) -> None:
    """Its instants alone are 160 TB; of 2^53 samples none has a time of its own."""
    outputs, vary = {"end": "last(t)"}, {"path": "simulation.duration", "list": [0.5, 1e12, 1e15]}
    description = plan(tmp_path, vary={"T": vary}, outputs=outputs, seconds_per_run=0.5)
    del description["draws"]
    points = [{"T": value} for value in vary["list"]]
    rows = [
        row
        for row, _ in BatchRunner(PlanRunner(load_plan(description), points[:1])).rows(
            range(3), points
        )
    ]
    assert [row["status"] for row in rows] == ["ok", "given up", "failed"]
    assert rows[0]["end"] == 0.5
    assert "2^53 samples" in rows[2]["reason"]


def test_a_batch_with_lanes_and_without(tmp_path: Path) -> None:
    """The thrown body has no sines: here the bits agree too, and with the closed form."""
    loaded = load_plan(plan(tmp_path, draws=20))
    values = points(loaded.plan)
    tables = []
    for lanes in (True, False):
        folder = tmp_path / str(lanes)
        described_plan = described(loaded, _looks(values), lanes)
        done = do_batch(described_plan, str(folder), Batch(0, np.arange(20), values, ("stone",)))
        assert done == (0, 20, 0)
        tables.append(open_table(folder))
    assert tables[0].equals(tables[1])
    speed, start = (tables[0].column(name).to_numpy() for name in ("speed", "start"))
    assert tables[0].column("height").to_numpy() == pytest.approx(height(speed, start), abs=1e-13)


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("last(position.top.z)", True),
        ("last(position.top.z) - first(energy) * spin", True),
        ("sqrt(last(abs(energy) * 2))", True),
        ('last(reaction["shaft/A"].force.z)', True),
        ("max(energy)", False),
        ("last(energy - mean(energy))", False),
        ("last(where(t > 1, energy, 0))", False),
        ("last(position.top[3])", False),
        ("integral(energy)", False),
        ("time_of(energy > 1)", False),
        ("any(energy > 1)", False),
        ("energy", False),
    ],
)
def test_which_outputs_need_the_ends_of_a_run_only(text: str, ends: bool) -> None:
    assert Expression(text, "x").of_ends({"spin"}) is ends


def test_only_what_is_asked_for_is_sampled() -> None:
    """An output of the ends alone, with and without an output that needs every sample."""
    vary = {"spin": {"path": "bodies.top.angular_velocity[1]", "list": [100.0, 120.0, 140.0]}}
    outputs = {"end": "last(position.top.z) - first(position.top.z)"}
    rows = []
    for more in ({}, {"most": "max(position.top.z)"}):
        description = {"scene": "heavy_top", "vary": vary, "outputs": {**outputs, **more}}
        simulation = {"tolerance": 1e-7, "duration": 0.2}
        made = PlanRunner(load_plan({**description, "simulation": simulation}), [{"spin": 1.0}])
        assert made.of_ends is (not more) and made.quantities == {"position"}
        rows.append(LaneRunner(made).rows([{"spin": x} for x in vary["spin"]["list"]]))
    assert [rows[0][k]["end"] for k in range(3)] == [rows[1][k]["end"] for k in range(3)]
    assert np.isfinite([rows[1][k]["most"] for k in range(3)]).all()
