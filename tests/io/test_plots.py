# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""plots.png: what is drawn, that it can be read, and that long runs stay small."""

from __future__ import annotations

import shutil
import tracemalloc
from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

from rb_sim import Simulation
from rb_sim.base.errors import SinkError
from rb_sim.io import run_plots as plots
from rb_sim.io.panels import panels_of
from rb_sim.io.run_plots import PlotSink
from rb_sim.mechanics.samples import ARRAYS, SampleLayout, empty_block
from rb_sim.scene.load import load_scene


@pytest.fixture
def pictured(monkeypatch):
    """The axes that were drawn, by their titles."""
    seen = {}
    original = plots.draw_panel

    def draw_panel(ax, curves, contacts):
        original(ax, curves, contacts)
        seen[curves.panel.title] = ax

    monkeypatch.setattr(plots, "draw_panel", draw_panel)
    return seen


@pytest.fixture
def drawn(pictured, monkeypatch):
    """The same where no test looks at the pictures, which take most of the time: empty files."""
    monkeypatch.setattr(Figure, "savefig", lambda *_, **options: None)
    return pictured


def test_every_quantity_has_its_panel(tmp_path, scene, layout, samples, pictured):
    path = tmp_path / "out" / "plots.png"
    sink = PlotSink(path)
    sink.open(scene, layout)
    for first in (0.0, 1.0):
        block = samples(100, start=first)
        block.residual[:] *= 1e9  # round-off is not drawn
        sink.write(block)
    sink.close({"steps": 1})
    sink.close()
    block = samples(200)
    check = {
        "ball: position of the centre of mass, world": ("[m]", block.position[:, 0]),
        "door: orientation, quaternion body to world": ("", block.orientation[:, 1]),
        "door: velocity of the centre of mass, world": ("[m/s]", block.linear_velocity[:, 1]),
        "ball: angular velocity ω, body axes": ("[rad/s]", block.angular_velocity[:, 0]),
        "floor: reaction force on ball, world axes": ("[N]", block.reaction_force[:, 0]),
        "hinge/B: reaction torque about its anchor": ("[N m]", block.reaction_torque[:, 3]),
        "power of forces without potential": ("[W]", block.power[:, None]),
    }
    for title, (unit, expected) in check.items():
        ax = pictured[title]
        assert ax.get_title(loc="left") == f"{title} {unit}".strip() and not ax.get_ylabel()
        for line, column in zip(ax.get_lines(), expected.T, strict=True):
            np.testing.assert_array_equal(line.get_xdata(), block.t)
            np.testing.assert_array_equal(line.get_ydata(), column)
    assert pictured["energy"].get_title(loc="left") == "energy [J]"
    assert "energy change, work of forces without potential" in pictured
    # one legend of the figure for the axes, none in their panels
    (legend,) = pictured["ball: position of the centre of mass, world"].figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names[:3] == ["x, roll φ", "y, pitch θ", "z, yaw ψ"] or names[:3] == list("xyz")
    assert pictured["ball: position of the centre of mass, world"].get_legend() is None
    assert [line.get_label() for line in pictured["energy"].get_lines()][-1] == "total"
    assert pictured[
        "worst violation of a constraint, relative to the scene's scale"
    ].get_yscale() == ("log")
    image = matplotlib.image.imread(path)
    assert image.shape[0] > 500 and image.shape[1] == 1430
    assert image[..., :3].std() > 0.05
    # more than a page of panels: one for each body
    names = ["plots.png", "plots_ball.png", "plots_door.png"]
    assert sorted(p.name for p in path.parent.iterdir()) == names


def test_angles_in_degrees_joints_and_commands_have_panels(tmp_path, drawn):
    """A wheel that turns faster and faster about y, by the angle 2 t^2, on a slider that goes."""
    inertia = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    scene = load_scene({
        "bodies": {"slider": inertia, "wheel": inertia},
        "constraints": {
            "rail": {"type": "translation", "body": "slider",
                     "guide": {"type": "line", "direction": [1, 0, 0]}},
            "axle": {"type": "fixed_axis", "body": "wheel", "parent": "slider",
                     "axis_B": [0, 1, 0]},
        },
        "effects": {"push": {"type": "commanded_wrench", "body": "slider"}},
    })  # fmt: skip
    layout = SampleLayout(("slider", "wheel"), (), (), ("slider",))
    block = empty_block(300, layout)
    block.t[:] = np.arange(300) / 100.0
    angle = 2.0 * block.t**2
    block.orientation[..., 3] = 1.0
    block.orientation[:, 1] = np.c_[0 * angle, np.sin(angle / 2), 0 * angle, np.cos(angle / 2)]
    block.angular_velocity[:, 1, 1] = 4.0 * block.t
    block.position[..., 0] = block.t[:, None]
    block.linear_velocity[..., 0] = 1.0
    block.command[100:, 0, 0] = 8.0
    sink = PlotSink(tmp_path / "p.png")
    sink.open(scene, layout)
    for part in (slice(0, 70), slice(70, 300)):
        arrays = {name: getattr(block, name)[part] for name in ARRAYS}
        sink.write(replace(block, **arrays))
    sink.close()
    expected = {
        "wheel: roll, pitch, yaw about the world's x, y, z": ("°", 1, np.degrees(angle)),
        "axle: angle from the first sample": ("°", 0, np.degrees(angle)),
        "rail: displacement from the first sample": ("m", 0, block.t),
        "slider: commanded force, world axes": ("N", 0, block.command[:, 0, 0]),
    }
    for title, (unit, k, values) in expected.items():
        assert drawn[title].get_title(loc="left") == f"{title} [{unit}]"
        np.testing.assert_allclose(drawn[title].get_lines()[k].get_ydata(), values, atol=1e-6)
    zero = ("slider: roll, pitch", "slider: commanded torque", "slider: angular velocity")
    assert not [title for title in drawn if title.startswith(zero)]


def test_the_caller_may_reuse_its_arrays(tmp_path, drawn):
    from rb_sim.mechanics.samples import empty_block

    scene = load_scene({"bodies": {"b": {"mass": 1, "inertia": [1, 1, 1]}}})
    layout = SampleLayout(("b",), (), (), ())
    sink = PlotSink(tmp_path / "plots.png")
    sink.open(scene, layout)
    block = empty_block(1, layout)
    for k in range(5):
        block.t[:] = k
        block.position[:] = k**2
        sink.write(block)
    sink.close()
    x, *_ = drawn["b: position of the centre of mass, world"].get_lines()
    np.testing.assert_array_equal(x.get_ydata(), [0, 1, 4, 9, 16])


def test_long_runs_stay_small(tmp_path, scene, layout, samples, drawn):
    """The curves of 60 000 samples hold at most four points per bucket, and the peak."""
    sink = PlotSink(tmp_path / "plots.png")
    sink.open(scene, layout)
    block, memory = samples(2000), []
    tracemalloc.start()
    for k in range(30):
        block.t[:] = 20.0 * k + np.arange(2000) / 100.0
        block.reaction_force[:] = 0.0
        block.reaction_force[777, 0, 2] = 1e3 if k == 11 else 0.0
        sink.write(block)
        memory.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert memory[-1] < 1.5 * memory[4]
    sink.close()
    force = drawn["floor: reaction force on ball, world axes"].get_lines()[2].get_ydata()
    assert len(force) <= 4 * plots.BUCKETS and force.max() == 1e3


def test_many_bodies_have_pages_and_none_is_left_out(tmp_path, drawn):
    from rb_sim.mechanics.samples import empty_block

    names = tuple(f"b{k}" for k in range(5))
    wheels = tuple(f"wheel{k}" for k in range(16))
    layout = SampleLayout(names, wheels, tuple(names[k % 5] for k in range(16)), ())
    scene = load_scene({"bodies": {name: {"mass": 1, "inertia": [1, 1, 1]} for name in names}})
    block = empty_block(5, layout)
    block.t[:] = np.arange(5.0)
    for field in (block.position, block.orientation, block.linear_velocity, block.reaction_force):
        field[:] = 1.0 + np.arange(5.0).reshape(5, 1, 1)
    sink = PlotSink(tmp_path / "plots.png")
    sink.open(scene, layout)
    sink.write(block)
    sink.close()
    pages = sorted(p.name for p in tmp_path.iterdir())
    assert pages == ["plots.png", *(f"plots_{name}.png" for name in names)]
    assert all(f"{name}: reaction force on" in " ".join(drawn) for name in wheels)
    assert all(f"{name}: position of the centre of mass, world" in drawn for name in names)


def test_a_torque_says_about_which_point_it_is():
    for name, about in (("rocking_block", "the centre of mass"), ("thrown_ball", "its anchor")):
        simulation = Simulation(name)
        titles = [panel.title for panel in panels_of(simulation.scene, simulation.layout)]
        assert f"floor: reaction torque about {about}" in titles


def test_a_heap_has_pages_of_its_first_bodies_and_says_so(tmp_path, monkeypatch):
    names = tuple(f"b{k}" for k in range(plots.MOST_PAGES + 5))
    scene = load_scene({"bodies": {name: {"mass": 1, "inertia": [1, 1, 1]} for name in names}})
    seen: dict[str, list[str]] = {}
    monkeypatch.setattr(plots, "page", lambda title, _, notes, __: seen.update({title: notes}))
    monkeypatch.setattr(plots, "save", lambda pages, _: seen.update(pages=list(pages)))
    block = empty_block(5, SampleLayout(names, (), (), ()))
    block.t[:] = np.arange(5.0)
    block.position[:] = 1.0 + np.arange(5.0).reshape(5, 1, 1)
    sink = PlotSink(tmp_path / "plots.png")
    sink.open(scene, SampleLayout(names, (), (), ()))
    sink.write(block)
    sink.close()
    assert seen["pages"] == ["", *names[: plots.MOST_PAGES]]
    assert f"pages of the first 24 of {len(names)} bodies" in seen[scene.name][-1]


def test_round_off_is_not_drawn_but_named(tmp_path, monkeypatch, scene, layout, samples, drawn):
    """A torque of 1e-13 of force times length, a residual of round-off, a speed that rounds."""
    notes = []
    original = plots.not_drawn
    monkeypatch.setattr(plots, "not_drawn", lambda *a: notes.extend(original(*a)) or notes)
    block = samples(50)
    block.reaction_torque[:, 0] = 1e-13 * block.reaction_force[:, 0]
    block.linear_velocity[:, 0, 2] = 0.5 + 1e-13 * np.sin(block.t)
    block.reaction_force[:, 1] = [0.0, 0.0, 9.81]
    block.reaction_force[:, 1, 2] += 1e-13 * np.sin(block.t)
    sink = PlotSink(tmp_path / "plots.png")
    sink.open(scene, layout)
    sink.write(block)
    sink.close()
    assert "floor: reaction torque about its anchor" not in drawn
    text = " ".join(notes)
    assert "zero throughout: floor: reaction torque about its anchor" in text
    assert "constant throughout: hinge: reaction force on door (0, 0, 9.81) N" in text
    assert "worst violation of a constraint, relative to the scene's scale: at most" in text
    velocity = drawn["ball: velocity of the centre of mass, world"].get_lines()
    assert np.ptp(velocity[2].get_ydata()) == 0.0 and np.ptp(velocity[0].get_ydata()) > 0.1


def test_a_jump_is_drawn_where_it_is():
    """A speed that falls at -9.81 and jumps from -2 to +1 at t = 0.35, sampled every 0.1 s."""
    t = np.arange(11) / 10.0
    speed = np.where(t < 0.35, -2.0 - 9.81 * (t - 0.35), 1.0 - 9.81 * (t - 0.35))[:, None]
    times, values = plots.with_jumps(t, speed, np.array([0.35]))
    assert list(times[4:6]) == [0.35, 0.35]
    np.testing.assert_allclose(values[4:6, 0], [-2.0, 1.0], atol=1e-12)
    same, curves = plots.with_jumps(t, speed, np.array([]))
    assert same is t and curves is speed


def test_no_samples_no_picture(tmp_path, scene, layout):
    sink = PlotSink(tmp_path / "plots.png")
    sink.open(scene, layout)
    sink.close()
    assert not (tmp_path / "plots.png").exists()


def test_values_that_are_not_finite_do_not_stop_it(tmp_path, scene, layout, samples):
    block = samples(20)
    block.residual[:] = np.nan
    block.position[5:] = np.inf
    sink = PlotSink(tmp_path / "plots.png")
    sink.open(scene, layout)
    sink.write(block)
    sink.close()
    assert (tmp_path / "plots.png").stat().st_size > 10_000


def test_folder_gone(tmp_path, scene, layout, samples):
    sink = PlotSink(tmp_path / "out" / "plots.png")
    sink.open(scene, layout)
    sink.write(samples(5))
    shutil.rmtree(tmp_path / "out")
    with pytest.raises(SinkError, match="plots.png: cannot be written: No such file or directory$"):
        sink.close()
    (tmp_path / "file").write_text("")
    with pytest.raises(SinkError, match="cannot draw here"):
        PlotSink(tmp_path / "file" / "plots.png").open(scene, layout)
