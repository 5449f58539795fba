# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Equal runs give equal bags, to the byte, whenever and however fast they ran."""

from __future__ import annotations

import hashlib
from pathlib import Path

from rb_sim.io.bag.reader import BagReader
from tests.cli.process import invoke, rb_sim

FILES = ("bag_0.mcap", "metadata.yaml")


def sums(bag: Path) -> list[str]:
    return [hashlib.sha256((bag / name).read_bytes()).hexdigest() for name in FILES]


def test_two_runs_give_the_same_files(tumble: Path, tmp_path: Path) -> None:
    """Of one process and of another."""
    for name, command in (("one", rb_sim), ("two", invoke)):
        command("run", tumble, "--out", tmp_path / name, "--no-plots", "--no-rerun", "-q")
    assert sums(tmp_path / "one" / "bag") == sums(tmp_path / "two" / "bag")
    assert BagReader(tmp_path / "one" / "bag").start == 0


def test_wall_stamps_are_there_for_the_asking(tumble: Path, tmp_path: Path) -> None:
    plain = ("run", tumble, "--out", tmp_path, "--no-plots", "--no-rerun", "-q")
    assert invoke(*plain, "--wall-stamps").exit_code == 0
    assert BagReader(tmp_path / "bag").start > 1_700_000_000_000_000_000
