# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What `rb_sim accuracy` says of bodies at rest."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from rb_sim.accuracy.accuracy_tables import measure, print_statics
from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.accuracy import of_statics
from rb_sim.scene.listing import find_scene, list_scenes, shipped_statics
from rb_sim.scene.load import is_statics, load_statics
from tests.equilibrium.scenes import ladder

CONFIG = Path(__file__).resolve().parents[2] / "config" / "statics"
SHIPPED = sorted(path.stem for path in CONFIG.glob("*.yaml"))


def test_report_says_what_was_compared(tmp_path: Path) -> None:
    def reported(mapping: dict[str, Any]) -> str:
        text = io.StringIO()
        print_statics(measure(load_statics(mapping), spell=0.0), Console(file=text, width=200))
        return text.getvalue()

    assert "the solver's own bound is 1e-12" in reported(ladder(1.0, 0.6, 0.0))
    slipping = reported(ladder(0.6, 0.3, 0.0))
    assert "no equilibrium" in slipping and "no reactions to measure" in slipping
    assert of_statics(CONFIG / "table_offset.yaml", tmp_path) == 0
    data = json.loads((tmp_path / "accuracy.json").read_text(encoding="utf-8"))
    assert [answer["name"] for answer in data["answers"]] == ["reactions", "with their ranges"]
    for answer in data["answers"]:
        assert answer["left_of_forces"] < 1e-12 and answer["left_of_torques"] < 1e-12
    with pytest.raises(RbSimError, match="at rest"):
        of_statics(CONFIG / "table_offset.yaml", target=1e-6)


def test_the_verb_takes_names_and_files_of_both_kinds() -> None:
    assert set(SHIPPED) == set(shipped_statics())
    assert not set(SHIPPED) & {scene.name for scene in list_scenes()}
    assert find_scene("table_offset") == CONFIG / "table_offset.yaml"
    assert is_statics(CONFIG / "sphere_held.yaml")
    assert not is_statics(find_scene("pendulum"))
