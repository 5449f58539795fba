# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The numbers of README are those of the program."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.scene.listing import shipped_statics
from rb_sim.statics import load_statics, solve
from tests.docs.blocks import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def rolling_sphere() -> tuple[float, float]:
    """(closed form, run): F = (1, 0.5, 0) N, K = (0.02, -0.01, 0.03) N m, a = 0.1 m."""
    run = Simulation("rolling_sphere").run(0.1)
    return (5.0 * -0.01 / 0.1 - 2.0 * 1.0) / 7.0, float(run.reaction["floor"].force[-1, 0])


def string_of(name: str, exact: float) -> tuple[float, float]:
    found = solve(load_statics(shipped_statics()[name])).reactions["string"]
    return exact, float(found.along)


def thrown_ball() -> tuple[float, float]:
    run = Simulation("thrown_ball").run()
    speed = np.linalg.norm(run.linear_velocity["ball"], axis=1)
    return 5.0 / 7.0, float(speed[-1] / speed[0])


ROWS = {
    "rolling_sphere": rolling_sphere,
    "rod_over_wall": lambda: string_of("rod_over_wall", 45.984375),
    "hinged_rods": lambda: string_of("hinged_rods", 15.0 * np.tan(np.pi / 6.0)),
    "thrown_ball": thrown_ball,
}


@pytest.mark.parametrize("name", ROWS)
def test_a_row_says_what_closed_form_and_program_give(name):
    (row,) = re.findall(rf"^\|[^|]*{name}[^|]*\|[^|]*\|([^|]*)\|([^|]*)\|$", README, re.MULTILINE)
    said = [float(re.findall(r"-?\d+\.\d+", cell)[-1]) for cell in row]
    assert said == [pytest.approx(value, rel=2e-6) for value in ROWS[name]()]


def test_it_is_one_screen_and_its_pictures_are_there():
    assert len(README.splitlines()) <= 120
    for picture in re.findall(r"\]\((docs/pictures/[^)]+)\)", README):
        assert (ROOT / picture).stat().st_size < 1.5e6
