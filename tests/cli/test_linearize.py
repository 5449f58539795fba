# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What `rb_sim linearize` says: eigenvalues tell of growth only where the motion is steady."""

from __future__ import annotations

import json
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from rb_sim import RbSimError, Simulation
from rb_sim.cli.verbs.linearize import linearize
from tests.linear.test_linearize import LEVER, THRESHOLD, disk, top

UNSTEADY = "not steady in these axes"


@pytest.fixture
def said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    """Of a scene with options, what the command prints."""

    def of(scene: dict[str, Any], axes: str = "world", turning: float = 0.0) -> str:
        path = tmp_path / "scene.yaml"
        path.write_text(yaml.safe_dump(scene), encoding="utf-8")
        assert linearize(path, 0.0, axes, turning, None) == 0
        return " ".join(capsys.readouterr().out.split())

    return of


@pytest.mark.parametrize(("share", "grows"), [(0.5, True), (2.0, False)])
def test_a_sleeping_top_is_steady_and_grows_below_its_threshold(
    said: Any, share: float, grows: bool
) -> None:
    text = said(top(share * THRESHOLD))
    assert UNSTEADY not in text
    assert ("grows" in text) is grows


def test_a_disk_that_rolls_in_a_circle_is_steady_in_axes_that_turn_with_it(said: Any) -> None:
    scene, _ = disk(0.3, 1.2)
    assert UNSTEADY not in said(scene, turning=1.2)
    assert UNSTEADY in said(scene)
    assert UNSTEADY in said(scene, turning=1.1)


def test_of_a_motion_that_is_not_steady_no_mode_is_said_to_grow(said: Any) -> None:
    """A top that falls: at one instant its model has a positive eigenvalue."""
    scene = top(0.0)
    scene["bodies"]["top"] |= {
        "angular_velocity": [1.0, 0.0, 0.0],
        "linear_velocity": [0.0, -LEVER, 0.0],
    }
    text = said(scene)
    assert UNSTEADY in text
    assert "grows" not in text


def test_contacts_are_refused_before_anything_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """To come to t = 1 s the loops of contacts would be compiled first, for a minute."""
    monkeypatch.setattr(Simulation, "advance", lambda *_: pytest.fail("moved"))
    with pytest.raises(RbSimError, match="linearize: the scene has contacts"):
        linearize("bouncing_ball", 1.0, "world", 0.0, None)


def test_json_has_the_model_and_the_table_the_matrices(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both have A of a sleeping top; modes of the JSON are the eigenvalues of its A."""
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(top(2.0 * THRESHOLD)), encoding="utf-8")
    assert linearize(path, 0.0, "world", 0.0, None, as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    values = np.linalg.eigvals(np.array(found["A"]))
    modes = [complex(mode["real"], mode["imaginary"]) for mode in found["modes"]]
    assert all(np.abs(values - mode).min() < 1e-6 for mode in modes)
    assert len(found["A"]) == len(found["states"]) == 6
    assert len(found["C"]) == len(found["outputs"])
    assert linearize(path, 0.0, "world", 0.0, None) == 0
    table = capsys.readouterr().out.splitlines()
    row = next(line for line in table if line.split()[:1] == [found["states"][-1]])
    np.testing.assert_allclose(list(map(float, row.split()[1:])), found["A"][-1], rtol=1e-4)


def test_off_equilibrium_the_advice_is_to_start_at_one(said: Any) -> None:
    scene = top(0.0)
    scene["bodies"]["top"]["orientation"] = {"axis": [1, 0, 0], "angle": 0.3}
    scene["bodies"]["top"]["position"] = [0.0, -LEVER * sin(0.3), LEVER * cos(0.3)]
    assert "Start the scene in an equilibrium at rest" in said(scene)
