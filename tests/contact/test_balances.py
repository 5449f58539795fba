# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Energy: what the contacts and the loads from outside have done is what it has changed by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.scene.listing import find_scene
from rb_sim.scene.yaml_reader import parse
from tests.contact_runs import contact_run

TOLERANCE = 1e-10
"""Of every step, relative to the coordinates: what energy the steps of these short runs gain or
lose is well below that part of the energy."""

SPANS = {
    "ball_on_block": 0.5, "bouncing_ball": 1.0, "colliding_spheres": 0.6, "incline_block": 0.2,
    "rattleback": 0.2, "rocking_block": 0.55, "sphere_in_cylinder": 0.5, "sphere_off_sphere": 1.5,
    "thrown_ball": 0.5, "tippe_top": 0.1, "turntable": 0.5,
}  # fmt: skip
"""[s], with the first events of each."""


def shipped(name: str) -> Any:
    """The mapping of a shipped scene."""
    path = find_scene(name)
    return parse(path.read_text(), path.name)


@pytest.mark.parametrize("name", SPANS)
def test_shipped_scene_balances(name: str) -> None:
    """Energy minus work of contacts changes by the work of the loads that have no potential: in
    `ball_on_block` that of a constant push on a block which does not turn.  The turntable's is all
    work of the contact."""
    found = contact_run(shipped(name), np.linspace(0.0, SPANS[name], 5), tolerance=TOLERANCE)
    r = found.trajectory
    change = r.energy - r.contact_work
    if name == "ball_on_block":
        change = change - 5.0 * r.position["block"][:, 0]
    assert np.abs(change - change[0]).max() <= TOLERANCE * np.abs(r.energy).max()
    if name == "turntable":
        assert_allclose(r.contact_work, r.energy - r.energy[0], atol=TOLERANCE)
        assert np.abs(r.contact_work).max() > 1e-3


def test_stick_slip_balances() -> None:
    """The drive does k v t dx, by Gauss's rule over the first slip; else nothing moves."""
    slip, stick = 0.981, 0.981 + 0.364065
    x, w = np.polynomial.legendre.leggauss(24)
    t = 0.5 * (slip + stick) + 0.5 * (stick - slip) * x
    found = contact_run(shipped("stick_slip"), [0.0, *t, 1.4], tolerance=TOLERANCE)
    r = found.trajectory
    drive = 5.0 * t * r.linear_velocity["block"][1:-1, 0]
    work = 0.5 * (stick - slip) * float(w @ drive)
    change = r.energy[-1] - r.contact_work[-1] - r.energy[0]
    assert work > 0.1
    assert abs(change - work) <= 1e-9
