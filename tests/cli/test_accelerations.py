# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim run --accelerations`: in the .npz and the plots, or one line that says why not."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim import load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.run import RunOptions
from rb_sim.cli.verbs.run import run as run_verb
from rb_sim.io.plots.plots import Plots
from rb_sim.trajectory.wrenches import accelerating
from tests.bags.scenes import PUSHED
from tests.interpreted import interpreted


def _run(folder, **options) -> int:
    path = folder / "scene.yaml"
    path.write_text(PUSHED)
    return run_verb(RunOptions(scene=str(path), duration=0.1, quiet=True, rerun=False, **options))


def test_the_npz_holds_them(tmp_path):
    npz = tmp_path / "out" / "run.npz"
    assert interpreted(_npz, tmp_path, npz) == 0
    found = np.load(npz)
    np.testing.assert_allclose(found["linear_acceleration.box"], [[0, 0, -9.81]] * 6, atol=1e-12)
    # without a torque I dw/dt = -w x I w
    w = found["angular_velocity.box"]
    inertia = np.diag(2.0 / 12.0 * np.array([0.05, 0.1, 0.13]))
    expected = np.linalg.solve(inertia, -np.cross(w, w @ inertia).T).T
    np.testing.assert_allclose(found["angular_acceleration.box"], expected, atol=1e-12)


def _npz(folder, npz) -> int:
    return _run(folder, npz=npz, accelerations=True)


def test_the_plots_show_them():
    scene = load_scene(PUSHED, duration=0.1)
    block, layout = interpreted(_samples, PUSHED)
    plots = Plots(scene, layout, accelerating(scene, layout))
    plots.add(block)
    (figure,) = plots.figures().values()
    notes = "; ".join(text.get_text() for text in figure.texts)
    assert "box: acceleration of the centre of mass (0, 0, -9.81) m/s²" in notes  # constant
    titles = {axes.get_title(loc="left"): axes for axes in figure.axes}
    assert "box: angular acceleration, body axes [rad/s²]" in titles
    plain = Plots(scene, layout)
    plain.add(block)
    assert len(plain.figures()[""].axes) < len(figure.axes)


def _samples(text):
    from rb_sim import Simulation

    simulation = Simulation(load_scene(text, duration=0.1))
    return simulation.run().block, simulation.layout


def test_asked_for_but_nowhere_to_go(tmp_path):
    with pytest.raises(
        RbSimError, match="--accelerations: give --out DIR for bag and plots, or --npz"
    ):
        _run(tmp_path, accelerations=True)


def test_time_stepping_has_none(tmp_path):
    with pytest.raises(RbSimError, match="--accelerations: method time_stepping has none"):
        _run(tmp_path, accelerations=True, npz=tmp_path / "x.npz", method="time_stepping")
