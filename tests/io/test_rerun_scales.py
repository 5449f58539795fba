# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Arrows are as long as the median, start outside of bodies; the trail is cut where it was."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

pytest.importorskip("rerun")

from rb_sim import Simulation  # noqa: E402
from rb_sim.base.errors import SimulationError  # noqa: E402
from rb_sim.io.rerun.arrow_scales import Resolved, clear_of, typical  # noqa: E402
from rb_sim.io.rerun.rerun_sink import RerunSink  # noqa: E402
from rb_sim.io.rerun.view import PIECES, Trail  # noqa: E402
from rb_sim.scene.extent import half_box  # noqa: E402
from tests.io.conftest import LAYOUT  # noqa: E402


def test_a_peak_does_not_shorten_the_other_arrows():
    forces = np.tile([0.0, 0.0, 2.0], (99, 1))
    forces[7], forces[8] = [0.0, 0.0, 5000.0], 0.0
    assert typical(forces) == 2.0
    assert typical(np.zeros((3, 3))) == 0.0
    assert typical(np.array([[3.0, 4.0, 0.0], [0, 0, 1e-12], [np.nan, 0, 0]])) == 5.0


def test_a_force_at_a_contact_starts_where_it_leaves_the_body():
    """A box 2 x 4 x 6, turned by 90 degrees about x, pushed up at its lowest face."""
    half = np.array([1.0, 2.0, 3.0])
    q = np.array([[np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
    center, up = np.array([[0.0, 0.0, 2.0]]), np.array([[0.0, 0.0, 9.0]])
    start = clear_of(half, center, q, np.array([[0.5, 1.0, 0.0]]), up)
    np.testing.assert_allclose(start, [[0.5, 1.0, 4.0]], atol=1e-12)  # y of the body is up: 4 high
    pull = clear_of(half, center, q, np.array([[0.5, 1.0, 0.0]]), -up)
    np.testing.assert_allclose(pull, [[0.5, 1.0, 0.0]], atol=1e-12)
    outside = clear_of(half, center, q, np.array([[0.5, 1.0, -1.0]]), up)
    np.testing.assert_allclose(outside, [[0.5, 1.0, -1.0]], atol=1e-12)
    still = clear_of(half, center, q, center, np.zeros((1, 3)))
    np.testing.assert_allclose(still, center)


def test_the_box_around_a_disk_that_leans():
    class Disk:
        type, radius, axis_B = "disk", 2.0, (0.6, 0.0, 0.8)

    """A disk is drawn with a thickness of 0.03 radii."""
    thick = 0.03 * 2.0 / 2.0
    expected = [2.0 * 0.8 + thick * 0.6, 2.0, 2.0 * 0.6 + thick * 0.8]
    np.testing.assert_allclose(half_box(Disk), expected)


def test_the_box_of_a_body_without_a_shape_has_its_inertia():
    """m/12 (b^2 + c^2) about the edge a, in axes that are turned."""
    from types import SimpleNamespace

    from scipy.spatial.transform import Rotation

    from rb_sim.scene.extent import inertia_box, reach_of

    edges, m = np.array([0.2, 0.4, 1.0]), 3.0
    turn = Rotation.from_rotvec([0.3, -0.7, 0.2]).as_matrix()
    moments = m / 12.0 * (np.sum(edges**2) - edges**2)
    body = SimpleNamespace(mass=m, inertia=turn @ np.diag(moments) @ turn.T, shape=None)
    half, axes = inertia_box(body)
    np.testing.assert_allclose(np.sort(half), 0.5 * edges, rtol=1e-9)
    again = m / 12.0 * (np.sum(4 * half**2) - 4 * half**2)
    np.testing.assert_allclose(axes @ np.diag(again) @ axes.T, body.inertia, atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert reach_of(body) == pytest.approx(0.5 * np.linalg.norm(edges))


def test_pieces_join_and_grow():
    """A point on a line, 0.1 m a sample; pieces of at least 0.2 m, twice as long after PIECES."""
    trail, position = Trail(100.0), np.zeros((10 * PIECES, 3))
    position[:, 0] = 0.1 * np.arange(len(position))
    rows, pieces = [], []
    for first in range(0, len(position), 777):
        found, made = trail.add(position[first : first + 777])
        rows += (found + first).tolist()
        pieces += made
    assert all(a[-1] == b[0] for a, b in zip(pieces, pieces[1:], strict=False))
    assert [piece[-1] for piece in pieces] == position[rows].tolist()
    assert all(piece[-1][0] - piece[0][0] > 0.2 for piece in pieces)
    assert pieces[-1][-1][0] - pieces[-1][0][0] > 0.4


def test_round_off_is_drawn_as_constant_and_motion_as_it_is():

    seen = Resolved(2.0)
    noise = 1e-12 * np.random.default_rng(1).standard_normal(50)
    ramp = np.linspace(0.0, 1.0, 50) / 3.0
    shown = seen("length", "p", np.c_[ramp, 0.7 + noise, noise])
    assert (shown[:, 0] == ramp).all()
    assert (shown[:, 1] == shown[0, 1]).all() and (shown[:, 2] == 0.0).all()
    later = seen("length", "p", np.c_[ramp, 0.7 - noise, noise])
    assert (later[:, 1] == shown[0, 1]).all()  # no step from one block to the next
    seen("force", "f", np.full((50, 3), 10.0))
    assert (seen("torque", "t", np.c_[1e3 * noise, noise, noise]) == 0.0).all()
    spoilt = np.c_[ramp, noise, np.full(50, np.nan)]
    np.testing.assert_array_equal(seen("length", "q", spoilt)[:, 2], spoilt[:, 2])


def test_the_extent_is_that_of_the_whole_motion(scene, samples):
    """The camera's box grows with every block; what is not finite is passed over."""
    from rb_sim.io.rerun.arrow_scales import Extent

    block = samples(20)
    for values in (block.position, block.anchor):
        values[:] = 0.0
    block.position[:, 0, 0] = np.linspace(0.0, 10.0, 20)
    extent = Extent(scene, LAYOUT)
    extent.add(block)
    center, size = extent.center_and_size()
    reach = 0.5 * np.linalg.norm([0.6, 0.04, 1.0])
    np.testing.assert_allclose(center, [5.0, 0.0, 0.0], atol=1e-12)
    assert size == pytest.approx(np.linalg.norm([10 + 2 * reach, 2 * reach, 2 * reach]))
    block.position[:, 0, 2] = np.nan
    block.position[:, 1, 0] = 30.0
    extent.add(block)
    assert extent.center_and_size()[0][0] == pytest.approx(15.0)


def test_a_recording_of_a_run_that_blows_up_says_nothing_of_numpy_s(tmp_path):
    """Rerun has single precision; whoever writes the recording, a run, a replay or a script."""
    spring = {"type": "spring", "body": "a", "point_A": [0, 0, 0], "stiffness": 1e8}
    body = {"mass": 1.0, "inertia": [1, 1, 1], "position": [1, 0, 0], "linear_velocity": [0, 1, 0]}
    scene = {
        "bodies": {"a": body},
        "effects": {"s": spring | {"rest_length": 0.0}},
        "simulation": {"duration": 3.0, "rate": 200.0, "method": "rk4", "step": 1e-3},
    }
    sink = RerunSink(tmp_path / "run.rrd")
    simulation = Simulation(scene, announce=None)
    with warnings.catch_warnings(action="error"):
        with pytest.raises(SimulationError, match="no longer finite"):
            simulation.run(sinks=[sink], checks=False)
        sink.close()
    assert sink.path.stat().st_size > 0
