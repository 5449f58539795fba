# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A run does not replace the logs of another one unasked."""

from __future__ import annotations

from tests.cli.process import invoke


def run(folder, *more):
    options = ("--out", folder, "--duration", "0.1", "--no-plots", "--no-rerun", "--quiet")
    return invoke("run", "pendulum", *options, *more)


def test_a_second_run_into_a_folder_is_refused_in_one_line(tmp_path):
    assert run(tmp_path / "o").exit_code == 0
    bag = tmp_path / "o/bag/bag_0.mcap"
    before = bag.read_bytes()
    again = run(tmp_path / "o", "--rate", "7")
    assert again.exit_code == 2
    (line,) = again.output.splitlines()
    assert line.startswith("error: --out: ") and "bag already" in line and "--overwrite" in line
    assert bag.read_bytes() == before


def test_overwrite_replaces_it(tmp_path):
    assert run(tmp_path / "o").exit_code == 0
    before = (tmp_path / "o/bag/bag_0.mcap").read_bytes()
    assert run(tmp_path / "o", "--rate", "7", "--overwrite").exit_code == 0
    assert (tmp_path / "o/bag/bag_0.mcap").read_bytes() != before


def test_a_folder_without_logs_is_taken(tmp_path):
    (tmp_path / "o").mkdir()
    (tmp_path / "o/notes.txt").write_text("mine")
    assert run(tmp_path / "o").exit_code == 0
    assert (tmp_path / "o/notes.txt").read_text() == "mine"


def test_a_name_that_no_folder_can_have_is_one_line(tmp_path):
    refused = run(tmp_path / ("x" * 300))
    (line,) = refused.output.splitlines()
    assert refused.exit_code == 2 and line.endswith("File name too long")


def test_a_run_that_is_simulated_again_replaces_no_other_run(tmp_path):
    assert run(tmp_path / "a").exit_code == run(tmp_path / "b").exit_code == 0
    again = ("resim", tmp_path / "a/bag", "--out", tmp_path / "b")
    refused = invoke(*again)
    (line,) = refused.output.splitlines()
    assert refused.exit_code == 2 and "bag already" in line and "--overwrite" in line
    assert invoke(*again, "--overwrite").exit_code == 0
