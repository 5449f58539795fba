# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim run --certify`: the certificate is printed and kept."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.process import invoke

SCENE = """
bodies: {b: {mass: 1.0, inertia: [1, 1, 1], position: [1, 0, 0]}}
effects: {spring: {type: spring, body: b, stiffness: 4.0}}
simulation: {duration: 3.0, rate: 20.0, tolerance: 1.0e-7}
"""


def test_the_certificate_is_in_the_table_and_in_the_summary(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SCENE)
    out = tmp_path / "out"
    options = ["--certify", "--no-bag", "--no-plots", "--no-rerun", "--out", out]
    done = invoke("run", tmp_path / "s.yaml", *options)
    assert done.exit_code == 0, done.output
    assert "global error at most" in done.stdout and "not measured" not in done.stdout
    kept = json.loads((out / "summary.json").read_text())["certificate"]
    assert 1e-10 < kept["errors"]["position"] < 1e-5
    assert kept["known_until"] == kept["follows_until"] == 3.0


def test_without_one_the_table_states_the_global_error_by_a_second_run(tmp_path: Path) -> None:
    """A tolerance bounds that of each step only."""
    (tmp_path / "s.yaml").write_text(SCENE)
    text = invoke("run", tmp_path / "s.yaml", "--no-rerun").stdout
    assert "by a second run (at tolerance 1e-08)" in text
    text = invoke("run", tmp_path / "s.yaml", "--no-rerun", "--no-check").stdout
    assert "not known: not checked" in text
