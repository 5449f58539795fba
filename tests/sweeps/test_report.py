# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The report: Sobol indices of a known function, extreme runs that run alone, maps."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

pytest.importorskip("pyarrow")
pytest.importorskip("plotly")

from rb_sim.base.errors import RbSimError
from rb_sim.scene.load import load_scene
from rb_sim.simulation.simulation import Simulation
from rb_sim.sweeps.sweep import sweep
from rb_sim.sweeps.sweep_page import (
    Extreme,
    RunTable,
    grid_axes,
    grid_values,
    picked_columns,
    report,
)
from tests.sweeps.plans import height, plan


def test_sobol_indices_of_a_linear_output_are_the_shares_of_its_variance(
    tmp_path: Path, here: str
) -> None:
    """height = start + speed / 2 + const: shares (1/12) and (0.5 * 0.5)^2 of their sum."""
    description = plan(
        tmp_path, draws=256, sampling="saltelli", outputs={"h": "last(position.stone.z)"}
    )
    out = tmp_path / "out"
    sweep(description, out, scheduler=here)
    found = report(out)
    speed, start = 0.0625, 1.0 / 12.0
    for name, variance in (("speed", speed), ("start", start)):
        index, share = found.indices["h"][name], variance / (speed + start)
        assert index.first == pytest.approx(share, abs=0.03)
        assert index.total == pytest.approx(share, abs=0.03)
        assert 0.0 < abs(index.first - share) < 1.5 * index.first_interval < 0.5
    page = found.html.read_text()
    assert "Sensitivity of h" in page and "src=" not in page.split("</script>")[-1]
    assert found.slopes.by_output["h"]["speed"].exact == pytest.approx(0.5, abs=1e-12)
    assert found.slopes.by_output["h"]["start"].exact == pytest.approx(1.0, abs=1e-12)
    assert "Derivatives at speed =" in page
    extreme = next(e for e in found.extremes if e.which == "largest")
    scene = load_scene(extreme.scene)
    alone = Simulation(scene).run()
    assert alone.position["stone"][-1, 2] == pytest.approx(extreme.value, abs=1e-14)
    stone = scene.bodies["stone"]
    assert extreme.value == pytest.approx(
        height(stone.linear_velocity[2], stone.position[2]), abs=1e-13
    )


def test_two_grids_make_a_map(tmp_path: Path, here: str) -> None:
    vary = {
        "speed": {
            "path": "bodies.stone.linear_velocity[2]",
            "grid": {"from": 1, "to": 2, "count": 3},
        },
        "start": {"path": "bodies.stone.position[2]", "list": [0.0, 1.0]},
    }
    vary["speed"]["grid"] = {"from": 1.0, "to": 2.0, "count": 3}
    description = {k: v for k, v in plan(tmp_path, vary=vary).items() if k != "draws"}
    sweep(description, tmp_path / "out", scheduler=here)
    found = report(tmp_path / "out")
    assert [p.name for p in found.pictures] == ["map_height.png", "map_top.png"]
    assert found.pictures[0].read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("starts", [[0.5, 0.0, 1.0], [0.5, 0.0, 1.0, 0.0]])
def test_a_list_in_any_order_is_drawn_along_its_axis(
    tmp_path: Path, here: str, starts: list[float]
) -> None:
    vary = {
        "speed": {"path": "bodies.stone.linear_velocity[2]", "list": [2.0, 1.0]},
        "start": {"path": "bodies.stone.position[2]", "list": starts},
    }
    description = {k: v for k, v in plan(tmp_path, vary=vary).items() if k != "draws"}
    sweep(description, tmp_path / "out", scheduler=here)
    table = RunTable(tmp_path / "out")
    (_, speeds, _), (_, shown, _) = grid_axes(table.plan())
    assert speeds.tolist() == [1.0, 2.0] and shown.tolist() == [0.0, 0.5, 1.0]
    drawn = grid_values(table.plan(), table, "height")
    assert drawn == pytest.approx(height(speeds[:, None], shown[None, :]), abs=1e-13)


def test_a_sweep_that_keeps_samples_only_has_a_report(tmp_path: Path, here: str) -> None:
    out = tmp_path / "out"
    sweep(plan(tmp_path, draws=3, outputs={}, trajectories=2), out, scheduler=here)
    assert "3 of 3 runs" in report(out).html.read_text()


def test_every_output_has_its_worst_runs_and_the_page_says_which_columns_it_scatters(
    tmp_path: Path, here: str
) -> None:
    outputs = {f"z{i}": f"last(position.stone.z) + {i}" for i in range(8)}
    sweep(plan(tmp_path, draws=4, outputs=outputs), tmp_path / "out", scheduler=here)
    found = report(tmp_path / "out")
    assert {extreme.output for extreme in found.extremes} == set(outputs)
    assert "Scatter matrix (6 of 10 columns)" in found.html.read_text()
    assert picked_columns(list("abcdefg"), ["y"], 6) == [*"abcde", "y"]
    assert picked_columns(["a"], list("uvwxyz"), 6) == [*"auvwxy"]


def test_a_folder_without_a_sweep_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RbSimError, match="not the folder of a sweep"):
        report(tmp_path)


def test_the_command_of_a_run_is_one_for_the_shell() -> None:
    scene = Path("my sweeps", "worst", "run_3.yaml")
    words = shlex.split(Extreme("load", "largest", 3, 1.0, scene).command)
    assert words == ["rb_sim", "run", str(scene), "--out", "my sweeps/worst/run_3"]
