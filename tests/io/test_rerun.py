# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings for Rerun: verified by the viewer's own tools, read back, drawn."""

from __future__ import annotations

import builtins
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.io.rerun.rerun_sink import RerunSink
from rb_sim.scene.load import load_scene

RERUN = Path(sys.executable).with_name("rerun")
needs_rerun = pytest.mark.skipif(not RERUN.exists(), reason="rerun-sdk is not installed")


def run(*arguments: object) -> str:
    command = [str(RERUN), *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=240).stdout


@pytest.fixture
def recording(tmp_path, scene, layout, samples):
    """A finished recording of 200 samples."""
    sink = RerunSink(tmp_path / "out" / "recording.rrd")
    sink.open(scene, layout)
    for first in range(4):
        sink.write(samples(50, start=first / 2))
    sink.close({"steps": 2000, "energy_error": 1e-13, "method": {"name": "rk4"}})
    sink.close()
    return sink.path


def at_rest(folder: Path, scene) -> Path:
    """A recording of the scene's bodies, which stay at the origin."""
    from rb_sim.mechanics.samples import SampleLayout, empty_block

    layout = SampleLayout(tuple(scene.bodies), (), (), ())
    sink = RerunSink(folder / "r.rrd")
    sink.open(scene, layout)
    block = empty_block(3, layout)
    block.orientation[..., 3] = 1.0
    block.t[:] = [0, 1, 2]
    sink.write(block)
    sink.close()
    return sink.path


def column(path: Path, entity: str, component: str) -> tuple[np.ndarray, list]:
    """Times [ns] and values of one component of one entity."""
    from rerun.chunk import RrdReader

    times, rows = [], []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            times += batch.column("sim_time").cast("int64").to_pylist()
            rows += batch.column(component).to_pylist()
    return np.array(times), rows


@needs_rerun
def test_rerun_verifies_it(recording):
    run("rrd", "verify", recording)
    stats = run("rrd", "stats", recording)
    assert "sim_time" in stats
    for entity in (
        "/world/ball",
        "/world/ball/shape",
        "/world/door/shape",
        "/world/trail/door",
        "/world/velocity/ball",
        "/world/reaction/floor",
        "/world/reaction/hinge/A",
        "/world/command/ball",
        "/plots/ball/position",
        "/plots/door/orientation",
        "/plots/ball/velocity",
        "/plots/ball/angular_velocity",
        "/plots/reactions/hinge/force",
        "/plots/reactions/floor/torque",
        "/plots/energy",
        "/plots/residual",
        "/about",
    ):
        assert f"{entity}:" in stats, entity
    assert "/world/reaction/hinge:" not in stats  # the total is not drawn beside its bearings


@needs_rerun
def test_the_summary_names_quantities_with_units_and_what_failed():
    from rb_sim.io.rerun.view import summary_text

    summary = {"method": "rk4", "step": 0.01, "tolerance": None, "constraint_rows": 3,
               "energy": {"error": -2e-7, "relative": 1e-9},
               "global_error": {"relative": 3e-9, "t": 2.0},
               "warnings": ["energy: ..."]}  # fmt: skip
    assert summary_text(summary).splitlines()[3:] == [
        "- method: rk4",
        "- step [s]: 0.01",
        "- global error, of the motion: 3e-09",
        "- energy error [J]: -2e-07",
        "- warning: energy: ...",
    ]


SUPPORTS = {
    "bodies": {
        name: {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [0.0, 0.0, 2.0]}
        for name in ("top", "door", "cart", "bead", "point", "sled")
    },
    "constraints": {
        "tip": {"type": "fixed_point", "body": "top", "point_B": [0.0, 0.0, -1.0]},
        "hinge": {"type": "fixed_axis", "body": "door", "axis_B": [0, 1, 0], "point_B": [1, 0, 0]},
        "rail": {
            "type": "translation",
            "body": "cart",
            "guide": {"type": "line", "direction": [1, 0, 0]},
        },
        "ring": {
            "type": "translation",
            "body": "bead",
            "guide": {"type": "circle", "center": [0, 0, 1], "normal": [0, 1, 0], "radius": 1.0},
        },
        "curve": {
            "type": "translation",
            "body": "sled",
            "guide": {
                "type": "curve",
                "points": [[0, 0, 2], [1, 0, 3], [2, 0, 2], [3, 0, 3], [4, 1, 2]],
            },
        },
        "table": {"type": "plane", "body": "point", "normal_A": [0, 0, 1]},
    },
}


def points_of(path: Path, entity: str, component: str) -> np.ndarray:
    """Numbers of a component of an entity that does not change, shape (n, 3)."""
    from rerun.chunk import RrdReader

    found = None
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and chunk.is_static and component in batch.schema.names:
            found = batch.column(component).to_pylist()[-1]
    assert found is not None, f"no {component} of {entity}"
    return np.array(found, dtype=float).reshape(-1, 3)


@needs_rerun
def test_what_holds_the_bodies_is_drawn(tmp_path):
    path = at_rest(tmp_path, load_scene(SUPPORTS))
    run("rrd", "verify", path)
    tip = points_of(path, "/world/top/support/tip/joints/0", "Points3D:positions")
    assert tip.tolist() == [[0.0, 0.0, -1.0]]
    cone = points_of(path, "/world/support/tip/solids/0", "Mesh3D:vertex_positions")
    np.testing.assert_allclose(cone[2::3], np.tile([0, 0, -1], (len(cone) // 3, 1)), atol=1e-6)
    hinge = points_of(path, "/world/door/support/hinge/joints/0", "Points3D:positions")
    assert hinge.tolist() == [[1.0, 0.0, 0.0]]
    axis = points_of(path, "/world/support/hinge/lines/0", "LineStrips3D:strips")
    assert axis[0, 1] == -axis[1, 1] != 0.0 and (axis[:, [0, 2]] == [1.0, 0.0]).all()
    bearings = [
        points_of(path, f"/world/support/hinge/solids/{k}", "Cylinders3D:centers")[0]
        for k in (0, 1)
    ]
    np.testing.assert_allclose(bearings, axis)
    ring = points_of(path, "/world/support/ring/lines/0", "LineStrips3D:strips")
    np.testing.assert_allclose(np.linalg.norm(ring - [0, 0, 1], axis=1), 1.0, atol=1e-6)
    rail = points_of(path, "/world/support/rail/lines/0", "LineStrips3D:strips")
    assert np.ptp(rail[:, 0]) > 1.0
    curve = points_of(path, "/world/support/curve/lines/0", "LineStrips3D:strips")
    for point in ([0, 0, 2], [1, 0, 3], [4, 1, 2]):
        assert np.linalg.norm(curve - point, axis=1).min() < 0.03
    table = points_of(path, "/world/support/table/planes/0", "LineStrips3D:strips")
    assert len(table) > 12 and np.ptp(table[:, 2]) < 1e-6  # lines, which hide nothing


@needs_rerun
def test_a_rod_and_a_spring_join_their_ends_in_a_recording(tmp_path):
    """The rod from its pivot to a bob, the spring between two bobs, at every sample."""
    from rb_sim import Simulation

    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
    scene = {
        "bodies": {"a": {**ball, "position": [1, 0, 2]}, "b": {**ball, "position": [2, 0, 2]}},
        "constraints": {"rod": {"type": "distance", "body": "a", "point_A": [0, 0, 2]}},
        "effects": {
            "g": {"type": "gravity"},
            "spring": {"type": "spring", "body": "b", "parent": "a", "stiffness": 1.0},
        },
        "simulation": {"duration": 0.5, "rate": 20},
    }
    simulation = Simulation(load_scene(scene))
    sink = RerunSink(tmp_path / "r.rrd")
    found = simulation.run(sinks=[sink])
    sink.close()
    pivot = np.tile([0.0, 0.0, 2.0], (len(found), 1))
    a, b = found.position["a"], found.position["b"]
    for name, ends in {"rod": (a, pivot), "spring": (b, a)}.items():
        _, rows = column(sink.path, f"/world/support/{name}/links/0", "LineStrips3D:strips")
        np.testing.assert_allclose(np.array(rows)[:, 0], np.stack(ends, axis=1), atol=1e-6)


@needs_rerun
def test_a_globe_that_outgrows_the_view_becomes_lines(tmp_path):
    """A ball that leaves a globe far behind: seen as a whole at last, as lines at first."""
    from rb_sim.mechanics.samples import SampleLayout, empty_block

    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0, 0, 10.1]}
    globe = {"type": "sphere", "center": [0, 0, 0], "radius": 10.0}
    scene = load_scene({
        "bodies": {"ball": ball},
        "constraints": {"globe": {"type": "contact", "body": "ball", "surface": globe}},
    })  # fmt: skip
    sink = RerunSink(tmp_path / "r.rrd")
    sink.open(scene, SampleLayout(("ball",), (), (), ()))
    block = empty_block(2, sink._layout)
    block.orientation[..., 3] = 1.0
    for height in (10.1, 100.0):
        block.t[:] += 1.0
        block.position[..., 2] = height
        sink.write(block)
        sink._flush()
    sink.close()
    folder = "/world/support/globe"
    assert len(points_of(sink.path, f"{folder}/lines/0", "LineStrips3D:strips")) == 0
    centers = points_of(sink.path, f"{folder}/solids/0", "Ellipsoids3D:centers")
    assert centers.tolist() == [[0.0, 0.0, 0.0]]


@needs_rerun
def test_the_body_frame_is_drawn_at_its_origin(recording, scene, layout, samples):
    from scipy.spatial.transform import Rotation

    block = samples(200)
    offset = Rotation.from_quat(block.orientation[:, 1]).apply(scene.bodies["door"].center_of_mass)
    times, rows = column(recording, "/world/door", "Transform3D:translation")
    np.testing.assert_array_equal(times, 10_000_000 * np.arange(200))
    expected = block.position[:, 1] - offset
    np.testing.assert_allclose(np.array(rows)[:, 0], expected, atol=1e-6)  # single precision
    times, rows = column(recording, "/plots/reactions/hinge/force", "Scalars:scalars")
    np.testing.assert_array_equal(rows, block.reaction_force[:, 1])


SHAPES = {
    "ball": {"type": "sphere", "radius": 0.2},
    "plate": {"type": "disk", "radius": 0.2, "axis_B": [0, 1, 0]},
    "drum": {"type": "cylinder", "radius": 0.2, "length": 1.0, "axis_B": [1, 0, 0]},
    "brick": {"type": "box", "size": [0.1, 0.2, 0.3]},
    "rod": {"type": "rod", "length": 1.0, "axis_B": [0, 0, -1]},
    "bar": {"type": "rod", "length": 1.0, "radius": 0.05},
    "egg": {"type": "ellipsoid", "semi_axes": [0.1, 0.2, 0.3]},
    "point": None,
}


@needs_rerun
def test_every_shape(tmp_path):
    bodies = {
        name: {"mass": 1, "inertia": [1, 1, 1]} | ({"shape": shape} if shape else {})
        for name, shape in SHAPES.items()
    }
    path = at_rest(tmp_path, load_scene({"bodies": bodies}))
    run("rrd", "verify", path)
    stats = run("rrd", "stats", path)
    for name, shape in SHAPES.items():
        assert (f"/world/{name}/shape:" in stats) == (shape is not None), name


@needs_rerun
@pytest.mark.parametrize(
    ("shape", "length", "radius"),
    [
        ({"type": "rod", "length": 2.0}, 2.0, 0.04),
        ({"type": "rod", "length": 2.0, "radius": 0.5}, 2.0, 0.5),
        ({"type": "disk", "radius": 2.0}, 0.06, 2.0),
        ({"type": "cylinder", "radius": 0.5, "length": 2.0}, 2.0, 0.5),
    ],
)
def test_what_has_no_thickness_is_drawn_with_some(shape, length, radius):
    """In a recording and on a page alike."""
    from rb_sim.io.drawn_supports import solid_of
    from rb_sim.io.rerun.static import solid_archetype

    body = load_scene({"bodies": {"b": {"mass": 1, "inertia": [1, 1, 1], "shape": shape}}}).bodies[
        "b"
    ]
    solid = solid_of(body)
    recorded = solid_archetype(solid, np.zeros(3), (0, 0, 0, 255))
    drawn = recorded.lengths.as_arrow_array()[0].as_py(), recorded.radii.as_arrow_array()[0].as_py()
    assert drawn == pytest.approx((length, radius), rel=1e-6)
    assert (solid["length"], solid["radius"]) == pytest.approx((length, radius))


@needs_rerun
@pytest.mark.parametrize("parent", [True, False])
def test_a_plane_on_a_body_is_shown_by_its_shape(tmp_path, parent):
    """Else it would hide the body's lower half; a plane in the world is drawn."""
    scene = load_scene("ball_on_block")
    if not parent:
        top = scene.constraints["top"].model_copy(update={"parent": None})
        scene = scene.model_copy(update={"constraints": scene.constraints | {"top": top}})
    assert ("support/top" in run("rrd", "stats", at_rest(tmp_path, scene))) != parent


@needs_rerun
def test_rows_go_to_the_file_in_blocks(tmp_path, scene, layout, samples):
    """At most ROWS samples are held; nothing is lost and the order of times is kept."""
    from rb_sim.io.rerun import rerun_sink as rerun

    sink = RerunSink(tmp_path / "r.rrd")
    sink.open(scene, layout)
    for k in range(100):
        sink.write(samples(100, start=float(k)))
        assert sink._rows < rerun.ROWS
    sink.close()
    times, _ = column(sink.path, "/plots/energy", "Scalars:scalars")
    np.testing.assert_array_equal(times, 10_000_000 * np.arange(10_000))


@needs_rerun
def test_the_caller_may_reuse_its_arrays(tmp_path, scene, layout, samples):
    sink, block = RerunSink(tmp_path / "r.rrd"), samples(1)
    sink.open(scene, layout)
    for k in range(5):
        block.t[:], block.position[:] = k, k**2
        sink.write(block)
    sink.close()
    times, rows = column(sink.path, "/plots/ball/position", "Scalars:scalars")
    assert times.tolist() == [k * 1_000_000_000 for k in range(5)]
    assert [row[0] for row in rows] == [0, 1, 4, 9, 16]


@needs_rerun
def test_an_unfinished_recording_can_be_read(tmp_path, scene, layout, samples):
    sink = RerunSink(tmp_path / "r.rrd")
    sink.open(scene, layout)
    sink.write(samples(5000))
    shutil.copy(sink.path, tmp_path / "killed.rrd")
    assert "/world/ball:" in run("rrd", "stats", tmp_path / "killed.rrd")
    sink.close()


@needs_rerun
def test_removed_folder(tmp_path, scene, layout, samples):
    sink = RerunSink(tmp_path / "out" / "r.rrd")
    sink.open(scene, layout)
    sink.write(samples(5000))
    shutil.rmtree(tmp_path / "out")
    with pytest.raises(SinkError, match="r.rrd: the recording was removed while it was written$"):
        sink.write(samples(5000))
    sink.close()
    with pytest.raises(SinkError, match="r.rrd: the recording is closed$"):
        sink.write(samples(1))


FILE_LIMIT = """
import resource, sys
from pathlib import Path
from rb_sim.mechanics.samples import SampleLayout, empty_block
from rb_sim.scene.load import load_scene
from rb_sim.io.rerun.rerun_sink import RerunSink
import numpy as np
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
scene = load_scene({"bodies": {"ball": {"mass": 1, "inertia": [1, 1, 1]}}})
layout = SampleLayout(("ball",), (), (), ())
sink = RerunSink(Path(sys.argv[1]))
sink.open(scene, layout)
block = empty_block(5000, layout)
block.orientation[..., 3] = 1.0
block.position[:] = np.random.default_rng(0).random((5000, 1, 3))
while True:
    block.t[:] += 100.0
    sink.write(block)
"""


@needs_rerun
def test_a_write_that_fails_is_noticed(tmp_path):
    path = tmp_path / "r.rrd"
    done = subprocess.run(
        [sys.executable, "-c", FILE_LIMIT, str(path)], capture_output=True, text=True, timeout=240
    )
    expected = f"rb_sim.base.errors.SinkError: {path}: recording stopped: File too large"
    assert done.stderr.splitlines()[-1] == expected
    assert "/world/ball:" in run("rrd", "stats", path)


@needs_rerun
def test_folder_that_cannot_be_written(tmp_path, scene, layout):
    (tmp_path / "file").write_text("")
    with pytest.raises(SinkError, match="r.rrd: cannot record here: "):
        RerunSink(tmp_path / "file" / "r.rrd").open(scene, layout)


def test_without_rerun_the_error_says_what_to_install(tmp_path, monkeypatch):
    original = builtins.__import__

    def no_rerun(name, *rest, **options):
        if name.split(".")[0] == "rerun":
            raise ImportError(name)
        return original(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", no_rerun)
    with pytest.raises(MissingExtraError, match=r"pip install 'rb_sim\[rerun\]'"):
        RerunSink(tmp_path / "r.rrd")


@needs_rerun
def test_far_from_the_origin_places_are_counted_from_a_local_one(tmp_path):
    """The viewer counts in single precision, which at 4,200 km tells half metres apart."""
    from rb_sim import Simulation

    place = [500000.25, 4200000.0, 1.0]
    scene = {
        "bodies": {
            "ball": {
                "mass": 0.2,
                "shape": {"type": "sphere", "radius": 0.05},
                "position": place,
                "linear_velocity": [1.0, 0.5, 0.0],
            }
        },
        "constraints": {"floor": {"type": "contact", "body": "ball", "restitution": 0.7}},
        "effects": {"g": {"type": "gravity"}},
        "simulation": {"duration": 1.0, "rate": 50},
    }
    simulation = Simulation(load_scene(scene))
    sink = RerunSink(tmp_path / "r.rrd")
    found = simulation.run(sinks=[sink])
    sink.close()
    _, rows = column(sink.path, "/world/ball", "Transform3D:translation")
    drawn = np.array([row[0] for row in rows], dtype=float)
    assert np.abs(drawn).max() < 100.0
    moved = found.position["ball"] - found.position["ball"][0]
    np.testing.assert_allclose(drawn - drawn[0], moved, atol=1e-6)
    origin = found.position["ball"][0] - drawn[0]
    np.testing.assert_allclose(origin, np.round(origin), atol=1e-6)  # said in whole metres


@needs_rerun
def test_arrows_have_one_scale_however_the_samples_came(tmp_path):
    """A ball let go from rest: by its first samples arrows would be a hundred metres long."""
    from rerun.chunk import RrdReader

    from rb_sim import Simulation

    scene = load_scene(
        {
            "bodies": {"b": {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}},
            "effects": {"g": {"type": "gravity"}},
            "simulation": {"duration": 1.0, "rate": 1000},
        }
    )

    def scale(rows: int) -> float:
        simulation = Simulation(scene)
        whole = simulation.run()
        sink = RerunSink(tmp_path / f"{rows}.rrd")
        sink.open(scene, whole.layout)
        for first in range(0, len(whole), rows):
            sink.write(part_of(whole.block, first, first + rows))
            sink._flush()
        sink.close()
        found = [
            chunk.to_record_batch().column("Transform3D:scale").to_pylist()[-1][0][0]
            for chunk in RrdReader(sink.path).stream()
            if chunk.entity_path == "/world/velocity/b/arrow"
            and chunk.is_static
            and "Transform3D:scale" in chunk.to_record_batch().schema.names
        ]
        return found[-1]

    def part_of(block, first, last):
        from dataclasses import replace

        from rb_sim.mechanics.samples import ARRAYS

        return replace(block, **{name: getattr(block, name)[first:last] for name in ARRAYS})

    one, many = scale(1001), scale(10)
    assert one == many
    assert f"{1.0 / one:.6e}"[:8] in ("1.000000", "2.000000", "5.000000")  # m/s for a metre
    assert 0.05 < one * 9.81 * 2.5 < 50.0  # the median speed, as long as an eighth of the way


@needs_rerun
def test_what_never_turns_has_no_plot_of_its_attitude(tmp_path):
    """The view of the beginning has the plot, that of the whole run has not."""
    from rb_sim import Simulation

    simulation = Simulation(load_scene("sphere_slides_off", duration=0.1))
    sink = RerunSink(tmp_path / "r.rrd")
    simulation.run(sinks=[sink])
    sink.close()
    printed = run("rrd", "print", "-vvv", sink.path)
    views = [line for line in printed.splitlines() if "[TimeSeries]" in line]
    assert sum("ball: position" in line for line in views) == 2
    assert sum("ball: orientation" in line for line in views) == 1
