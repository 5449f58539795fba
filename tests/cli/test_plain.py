# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Names and units stand in tables as they are, whatever a terminal might make of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from rb_sim.cli.verbs.compare import CompareOptions, compare
from rb_sim.cli.verbs.info import info
from tests.bags.analysis.foreign import EPOCH, STORE, pose_stamped, swing

NAMES = ("/[/]", "/[bold]arm[/bold]", "/:smile:", "/[s]")


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag whose topics look like rich's markup and emoji."""
    folder = tmp_path_factory.mktemp("odd") / "bag"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic in NAMES:
            kind, _ = pose_stamped(0.0, [0.0] * 3, [0.0, 0.0, 0.0, 1.0])
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for t, p, q in zip(*swing(40), strict=True):
                message = bytes(STORE.serialize_cdr(pose_stamped(t, p, q)[1], kind))
                writer.write(connection, round((EPOCH + t) * 1e9), message)
    return folder


def test_info(odd: Path, capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    assert info(odd, as_json=False) == 0
    out = capsys.readouterr().out
    for text in (*NAMES, "jitter [ms]", "longest [s]", "rate [Hz]"):
        assert text in out


def test_compare(odd: Path, capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    assert compare(CompareOptions(odd, str(odd))) == 0
    out = capsys.readouterr().out
    for text in (*NAMES, "position [m]", "angle [rad]", "at t [s]", "growth [1/s]"):
        assert text in out


def test_analyze(odd: Path, capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    from rb_sim.cli.verbs.analyze import AnalyzeOptions, analyze

    monkeypatch.setenv("COLUMNS", "160")
    assert analyze(AnalyzeOptions(odd)) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in NAMES)
