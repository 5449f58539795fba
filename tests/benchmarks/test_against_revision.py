# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The comparison with another revision: its arguments, its measuring end and its table."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from benchmarks.against_revision import arguments, chosen, summary, without_contact
from benchmarks.stepping import answer
from rb_sim.base.errors import RbSimError

ROOT = Path(__file__).resolve().parents[2]


def test_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    options = arguments(["v1", "pendulum", "heavy_top", "--rounds", "5"])
    assert (options.revision, options.scenes, options.rounds) == (
        "v1",
        ["pendulum", "heavy_top"],
        5,
    )
    for given in ([], ["v1", "--rounds", "1"]):
        with pytest.raises(SystemExit):
            arguments(given)
    assert "must be at least 2" in capsys.readouterr().err


def test_scenes_are_those_without_contact_of_both_trees(tmp_path: Path) -> None:
    names = without_contact(ROOT)
    assert "pendulum" in names
    assert not names & {"thrown_ball", "rb_sim_node.params"}
    (tmp_path / "config").mkdir()
    for name in ("pendulum", "older"):
        (tmp_path / "config" / f"{name}.yaml").write_text("bodies: {}\n", encoding="utf-8")
    assert chosen([], (tmp_path, ROOT)) == ["pendulum"]
    own = str(tmp_path / "config" / "older.yaml")
    assert chosen([own], (tmp_path, ROOT)) == [own]
    with pytest.raises(SystemExit, match="older"):
        chosen(["older"], (tmp_path, ROOT))


def test_measuring_end_answers_every_request() -> None:
    scene = str(ROOT / "config" / "pendulum.yaml")
    asked = json.dumps({"scene": scene, "method": "rk4", "step": 1e-3, "count": 20})
    answers = io.StringIO()
    answer(io.StringIO(f"{asked}\n{asked}\n"), answers)
    times = [json.loads(line)["ns"] for line in answers.getvalue().splitlines()]
    assert len(times) == 2 and min(times) > 0.0
    with pytest.raises(RbSimError):
        answer(io.StringIO(asked.replace("pendulum", "no_such")), answers)


def test_ratios_are_taken_round_by_round() -> None:
    row = summary([100.0, 200.0, 100.0], [110.0, 220.0, 120.0])
    assert (row.old, row.new) == (100.0, 120.0)
    assert row.ratio == pytest.approx(1.1)
    assert row.quartiles == (pytest.approx(1.1), pytest.approx(1.15))
