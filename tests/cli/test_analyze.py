# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What `rb_sim analyze` prints."""

from __future__ import annotations

import pytest

from rb_sim.cli.verbs import analyze
from tests.cli.process import invoke


def reported(count: int) -> dict:
    row = {"least": -1.0, "largest": 1.0, "rms": 0.5, "peak_frequency": None}
    source = {"count": 7, "rate": 50.0, "gaps": 0, "backwards": 0, "values": {"x": row}}
    return {
        "sources": {f"/robot{k}/pose": source for k in range(count)},
        "bodies": {f"/robot{k}/pose": {"note": "too few"} for k in range(count)},
        "balance": None,
        "events": [],
        "balances": {},
        "constraints": None,
        "contacts": None,
    }


def test_the_terminal_shows_the_first_of_thousands(monkeypatch, capsys):
    """Laying out a table takes a millisecond a line; JSON has all of them."""
    monkeypatch.setattr(analyze, "SHOWN", 3)
    analyze._print(reported(5))
    text = capsys.readouterr().out
    assert text.count("/robot") == 3 + 3 + 3 and "/robot3" not in text
    assert "and 2 more sources (all with --json or --out DIR)" in text
    assert "and 2 more bodies (all with --json or --out DIR)" in text
    analyze._print(reported(3))
    assert "more" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("scene", "duration", "said", "times"),
    [
        # of a box its lower corners, not the upper ones; the gap is 0 or rounding of either sign
        ("incline_block", 0.5, ": closed; largest overlap", 4),
        ("bouncing_ball", 0.1, "open at all samples; smallest gap 0.", 1),
        # an impact between samples, which these do not show
        ("bouncing_ball", 1.0, "open at all samples; smallest gap 0.", 1),
        ("bouncing_ball", 1.0, "events: 1 impact", 1),
    ],
)
def test_a_contact_that_carries_the_load_touches(tmp_path, scene, duration, said, times):
    options = ("--out", tmp_path / "o", "--duration", duration, "--no-plots", "--no-rerun", "-q")
    assert invoke("run", scene, *options).exit_code == 0
    assert invoke("analyze", tmp_path / "o/bag").stdout.count(said) == times
