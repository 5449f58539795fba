"""Equal runs give equal bags, to the byte, whenever and however fast they ran."""

from __future__ import annotations

import hashlib
from pathlib import Path

from rb_sim.io.bag.reader import BagReader
from tests.cli.process import rb_sim

FILES = ("bag_0.mcap", "metadata.yaml")


def sums(bag: Path) -> list[str]:
    return [hashlib.sha256((bag / name).read_bytes()).hexdigest() for name in FILES]


def test_two_runs_give_the_same_files(tumble: Path, tmp_path: Path) -> None:
    found = []
    for name in ("one", "two"):
        done = rb_sim("run", tumble, "--out", tmp_path / name, "--no-plots", "--no-rerun", "-q")
        assert done.returncode == 0, done.stderr
        found.append(sums(tmp_path / name / "bag"))
    assert found[0] == found[1]
    assert BagReader(tmp_path / "one" / "bag").start == 0


def test_wall_stamps_are_there_for_the_asking(tumble: Path, tmp_path: Path) -> None:
    plain = ("run", tumble, "--out", tmp_path, "--no-plots", "--no-rerun", "-q")
    assert rb_sim(*plain, "--wall-stamps").returncode == 0
    assert BagReader(tmp_path / "bag").start > 1_700_000_000_000_000_000
