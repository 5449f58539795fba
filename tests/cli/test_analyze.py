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

from rb_sim.bags.analysis import analysis_page
from rb_sim.cli.verbs import analyze
from tests.bags.analysis import foreign
from tests.cli.process import invoke


def test_the_terminal_shows_the_first_of_thousands(monkeypatch, tmp_path):
    """Laying out a table takes a millisecond a line; JSON has all of them."""
    monkeypatch.setattr(analyze, "MOST", 3)
    monkeypatch.setattr(analysis_page, "MOST", 3)
    for count in (5, 3):
        names = [f"/robot{k}/pose" for k in range(count)]
        bag = foreign.record(
            tmp_path / str(count),
            ((t, name, *foreign.pose_stamped(t, p, q))
             for t, p, q in zip(*foreign.swing(5), strict=True) for name in names),
        )  # fmt: skip
        text = invoke("analyze", bag).stdout
        assert text.count("/robot") == 3 + 3 + 3 and "/robot3" not in text
        for what in ("sources", "bodies"):
            assert (f"and 2 more {what} (all with --json or --out DIR)" in text) == (count == 5)


@pytest.mark.parametrize(
    ("scene", "duration", "said", "times"),
    [
        # of a box its lower corners, not the upper ones; the gap is 0 or rounding of either sign
        ("incline_block", 0.5, "overlap, closed [m]", 4),
        ("bouncing_ball", 0.1, "gap, open at all samples [m]", 1),
        # an impact between samples, which these do not show
        ("bouncing_ball", 1.0, "gap, open at all samples [m]", 1),
        ("bouncing_ball", 1.0, "events: 1 impact", 1),
    ],
)
def test_a_contact_that_carries_the_load_touches(tmp_path, scene, duration, said, times):
    options = ("--out", tmp_path / "o", "--duration", duration, "--no-plots", "--no-rerun", "-q")
    assert invoke("run", scene, *options).exit_code == 0
    assert invoke("analyze", tmp_path / "o/bag").stdout.count(said) == times
