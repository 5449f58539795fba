# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Cases on other engines: the same motion in each, honest verdicts, a line where one lacks."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from benchmarks.hard_cases import compare
from benchmarks.hard_cases.compare import judged_checks, said
from benchmarks.hard_cases.described import CannotExpressError, described
from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.hard_cases import shipped
from rb_sim.hard_cases.judge import Row, load_cases
from rb_sim.hard_cases.report import PeerRow, beside

ROD = {"mass": 1.0, "inertia": [0.02, 0.1, 0.09], "center_of_mass": [0.0, 0.1, -0.5]}
HINGE = {"type": "fixed_axis", "body": "a", "axis_B": [0.0, 1.0, 0.0]}
LINK = {"type": "fixed_axis", "body": "b", "parent": "a", "axis_B": [0.0, 1.0, 0.0]}
SCENES: dict[str, Any] = {
    "thrown": {
        "bodies": {
            "a": ROD
            | {
                "orientation": {"axis": [1.0, 2.0, 3.0], "angle": 0.7},
                "angular_velocity": [1.0, -2.0, 0.5],
                "linear_velocity": [0.3, 0.0, 2.0],
            }
        },
        "effects": {"weight": {"type": "gravity"}},
    },
    "two rods": {
        "bodies": {
            "a": ROD | {"angular_velocity": [0.0, 1.0, 0.0]},
            "b": ROD | {"position": [0.0, 0.0, -1.0], "linear_velocity": [-1.0, 0.0, 0.0],
                        "angular_velocity": [0.0, 1.0, 0.0]},
        },
        "constraints": {"hinge": HINGE, "link": LINK},
        "effects": {"weight": {"type": "gravity"}},
    },
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("engine", compare.ENGINES)
def test_an_engine_is_told_the_same_scene(engine: str, name: str) -> None:
    """Pose and twist of every body agree with rb_sim to the engine's order."""
    pytest.importorskip("pydrake" if engine == "drake" else engine)
    module = compare.loaded(engine)
    scene = load_scene(SCENES[name] | {"simulation": {"duration": 0.5, "rate": 10.0}})
    method = "TrapezoidalIndex2" if engine == "exudyn" else module.METHODS[0]
    rows = module.run(described(scene), method, 1e-3, 6, 100)
    block = Simulation(scene, announce=None).run().block
    columns = (block.position, block.orientation, block.linear_velocity, block.angular_velocity)
    ours = np.concatenate(columns, axis=2)
    sign = np.sign((rows[:, :, 3:7] * ours[:, :, 3:7]).sum(axis=2, keepdims=True))
    rows[:, :, 3:7] *= sign
    np.testing.assert_allclose(rows, ours, atol=1e-4)


def test_what_an_engine_has_no_word_for_is_named() -> None:
    scene = load_scene(shipped_case("bennett_linkage"))
    with pytest.raises(CannotExpressError, match="constraint j3"):
        described(scene)


def shipped_case(name: str) -> Any:
    (case,) = load_cases(shipped(), [name])
    return case.scene


def test_figures_of_reactions_are_left_out() -> None:
    (case,) = load_cases(shipped(), ["rotor_1e4"])
    layout = Simulation(load_scene(case.scene), announce=None).layout
    assert [check.formula for check in judged_checks(case, layout)] == ["rotor_wz/1e4 - 1"]


def test_an_engine_that_is_better_is_said_to_be() -> None:
    assert said(1e-9, 1e-8, 1e-7) == "holds, better than rb_sim"
    assert said(1e-7, 1e-8, 1e-7) == "fails by 10, equal to rb_sim"
    assert said(1e-5, 1e-8, 1e-7) == "fails by 1e+03"
    row = PeerRow("c", "drake", "energy", "m", 1e-3, 1e-9, 1e-8, 1e-7, 0.1, "holds")
    assert "| c | drake | energy | m | 0.001 | 1e-09 | 1e-08 | 1e-07 | 0.1 | holds |" in beside(
        [row]
    )


def test_an_engine_that_is_not_installed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> Any:
        raise ImportError("No module named 'mujoco'")

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(
        RbSimError, match=r"mujoco cannot be imported .* pip install 'rb_sim\[peers\]'"
    ):
        compare.loaded("mujoco")


def test_a_check_is_compared_with_its_own_rows() -> None:
    """Two formulas of one bound, two settings: the rows come check by check."""
    (case,) = load_cases(shipped(), ["nanometre_beside_metre"])
    ours = [
        Row("c", "m", "h", "formula", figure, 1e-8, 0.1, "holds", "") for figure in (3, 1, 2, 4)
    ]
    assert [compare.least_of(case, check, ours) for check in case.checks] == [2, 1]
