# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim show`: the page of a run, opened in Chromium and asked what it shows."""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from rb_sim import Simulation, Trajectory, load_scene
from rb_sim.accuracy.closed_forms import exact_samples
from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.cli.verbs.replay import show
from rb_sim.io.motion_page import RunPage, save
from rb_sim.mechanics.samples import ContactEvent, SampleLayout, empty_block
from tests.bags.analysis import foreign
from tests.bags.scenes import record_run
from tests.browser import ask

TOP = """\
description: a top </script> <b>
bodies:
  top:
    mass: 1.0
    shape: {type: disk, radius: 0.2, center_B: [0, 0, 0.5]}
    center_of_mass: [0, 0, 0.5]
    orientation: {axis: [1, 0, 0], angle: 0.6}
    angular_velocity: [0, 0, 40]
constraints: {tip: {type: fixed_point, body: top}}
effects: {weight: {type: gravity}}
simulation: {duration: 1.0, rate: 50, method: rk4, step: 0.002}
"""

PENDULUM = """\
bodies:
  rod:
    mass: 1.0
    shape: {type: rod, length: 1.0}
    position: [0.5, 0, 0]
    orientation: {axis: [0, 1, 0], angle: 1.5707963267948966}
constraints: {hinge: {type: fixed_axis, body: rod, point_B: [0, 0, -0.5], axis_B: [0, 1, 0]}}
effects: {weight: {type: gravity}}
simulation: {duration: 1.0, rate: 50, method: rk4, step: 0.002}
"""


def data_of(page: Path) -> dict:
    text = page.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def facts(page: Path) -> dict[str, str]:
    return dict(data_of(page)["facts"])


def numbers(packed: dict) -> np.ndarray:
    import base64

    raw = np.frombuffer(base64.b64decode(packed["base64"]), dtype=packed["type"])
    return raw * packed.get("step", 1) + packed.get("low", 0)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """The folder of a run of the top."""
    out = tmp_path_factory.mktemp("top")
    record_run(TOP, out / "bag")
    return out


QUESTIONS = {
    "text": "return document.body.innerText;",
    "order": """
        const axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], box = [0, 0, 1, 1];
        const about = {axes, box}, ball = {kind: "ball", radius: 0.3, center: [-4.5, 0, 0.4]};
        const plank = {kind: "box", half: [5, 0.5, 0.1], center: [0, 0, 0]};
        const pole = {kind: "cylinder", radius: 0.1, length: 8, center: [0, 0, 4.1]};
        Object.entries({plank, ball, pole}).map(([name, s]) => Object.assign(s, about, {name}));
        return [[6, 0, 2], [6, 0, -2]].map(
          (eye) => inOrder([ball, pole, plank], eye).map((solid) => solid.name));
    """,
    "slider": """
        const slider = document.getElementById("slider"), answers = [];
        const pen = document.getElementById("scene").getContext("2d");
        for (const t of [0.3, 0.8]) {
          slider.value = t;
          slider.dispatchEvent(new Event("input"));
          document.querySelectorAll("#switches :checked").forEach((box) => box.click());
          const [x, y] = rb_sim.pixelOf("top"), pose = rb_sim.poseOf("top");
          const at = [x, y].map((c) => Math.round(c) + 3);
          const color = Array.from(pen.getImageData(...at, 1, 1).data);
          const clock = document.getElementById("clock").textContent;
          answers.push({...pose, pixel: [x, y], color, clock});
        }
        return answers;
    """,
    "hands": """
        const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", {key}));
        const {state, camera} = rb_sim, canvas = document.getElementById("scene");
        rb_sim.seek(0);
        press("ArrowRight");
        const stepped = state.time;
        press(" ");
        const playing = state.playing;
        press(" ");
        const yaw = camera.yaw, far = camera.distance;
        const hand = (kind, x) => canvas.dispatchEvent(
          new PointerEvent(kind, {pointerId: 1, clientX: x, clientY: 100, buttons: 1}));
        canvas.setPointerCapture = () => {};
        hand("pointerdown", 100); hand("pointermove", 160); hand("pointerup", 160);
        canvas.dispatchEvent(new WheelEvent("wheel", {deltaY: -100, cancelable: true}));
        return {stepped, playing, stopped: !state.playing, turned: yaw - camera.yaw,
                nearer: camera.distance / far};
    """,
}
"""Asked one after the other: the browser takes a second to start."""


@pytest.fixture(scope="module")
def answers(run) -> dict:
    """What the page of that run says."""
    show(str(run))
    parts = (f"{name}: (() => {{ {script} }})()" for name, script in QUESTIONS.items())
    return ask(run / "show.html", f"return {{{', '.join(parts)}}};", "--window-size=1200,1000")


def test_the_slider_moves_the_body_to_where_it_was(run, answers):
    """Pose to single precision; and at the pixel where its centre of mass is, its colour."""
    found = answers["slider"]
    recorded = Trajectory.from_bag(run / "bag")
    for t, shown in zip((0.3, 0.8), found, strict=True):
        k = int(np.argmin(np.abs(recorded.t - t)))
        np.testing.assert_allclose(shown["position"], recorded.position["top"][k], atol=1e-6)
        q = recorded.orientation["top"][k]
        assert abs(np.dot(shown["orientation"], q)) == pytest.approx(1.0, abs=1e-6)
        assert shown["clock"] == f"t = {t:.4f} s"
        red, _, blue, _ = shown["color"]
        assert blue - red > 60  # the disk is blue, what is behind it grey
    assert np.linalg.norm(np.subtract(found[0]["pixel"], found[1]["pixel"])) > 20.0


def test_the_page_says_what_it_shows(run, answers, capsys):
    show(str(run))
    assert capsys.readouterr().out.startswith(f"wrote {run / 'show.html'}: ")
    reported = facts(run / "show.html")
    assert reported["method"] == "rk4, step 0.002 s" and reported["samples"] == "51"
    assert reported["simulated"] == "1 s" and "rb_sim" in reported["versions"]
    text = answers["text"]
    assert "a top </script> <b>" in text  # as it is, no markup
    assert "tip: force" not in text and "an arrow of" in text


def test_play_and_keys_and_mouse(answers):
    found = answers["hands"]
    assert found["stepped"] == pytest.approx(0.02) and found["playing"] and found["stopped"]
    assert found["turned"] == pytest.approx(0.48) and found["nearer"] < 0.95


def test_the_closed_form_is_dashed_over_the_run(tmp_path):
    show(str(scene_file(tmp_path, PENDULUM)), tmp_path / "page.html")
    page = data_of(tmp_path / "page.html")
    exact = numbers(page["exact"]["position"])
    np.testing.assert_allclose(exact, numbers(page["position"]), atol=2e-6)
    assert np.ptp(exact) > 0.5
    assert "closed form" in facts(tmp_path / "page.html")
    text = ask(
        tmp_path / "page.html", "return plots.map((plot) => plot.lines.every((l) => l.exact))"
    )
    assert text == [True] * len(text)


def test_a_run_that_was_pushed_has_no_closed_form(tmp_path):
    pushed = PENDULUM.replace(
        "{weight: {type: gravity}}",
        "{weight: {type: gravity}, drive: {type: commanded_wrench, body: rod}}",
    )
    simulation = Simulation(load_scene(pushed))
    simulation.apply_wrench("rod", force=[0, 0, 30.0], torque=[0, 0, 0])
    from rb_sim.cli.verbs.replay import page_of_run

    page = page_of_run(simulation.run(checks=False), [], [])
    assert page["exact"] is None
    assert [a["group"] for a in page["arrows"]].count("command") == 1


def test_closed_forms_of_contact_have_samples():
    """The ball strikes, so that its coordinates are those of a motion from event to event."""
    ball = load_scene("config/bouncing_ball.yaml")
    times = np.linspace(0.0, 0.5, 6)
    found = exact_samples(ball, times)
    assert found is not None
    run = Simulation(ball).run(at=times, checks=False)
    np.testing.assert_allclose(found[1].position, run.block.position, atol=1e-9)


def test_supports_stand_where_the_scene_has_them(scene, layout, samples):
    """Floor at z = 0; the hinge's axis through (0.5, 0.5), with a bearing at each end."""
    from rb_sim.io.drawn_supports import Sight, Supports

    block = samples(5)
    origin = np.array([0.5, 0.0, 0.0])
    block.position[0, 1] = [0.8, 0.5, 0.5] - origin
    block.orientation[0] = [0.0, 0.0, 0.0, 1.0]
    drawn = Supports(scene, layout, block, Sight(np.zeros(3), 2.0, 0.0), origin).as_dict()
    (plane,) = drawn["planes"]
    assert plane["point"][2] == 0.0 and plane["normal"] == [0, 0, 1] and plane["thing"]
    (line,) = drawn["lines"]
    np.testing.assert_allclose(np.array(line["points"])[:, :2], [[0.0, 0.5]] * 2, atol=1e-12)
    bearings = [s for s in drawn["solids"] if s["on"] < 0]
    np.testing.assert_allclose([b["center"] for b in bearings], line["points"], atol=1e-12)


@pytest.mark.parametrize("name", ["turntable", "sphere_off_sphere"])
def test_supports_of_shipped_scenes_are_drawn(name, tmp_path):
    """Without a complaint of the page; a turntable turns its grid."""
    scene = load_scene(f"config/{name}.yaml", duration=0.1)
    from rb_sim.cli.verbs.replay import page_of_run

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        page = page_of_run(Simulation(scene).run(checks=False), [], [])
    save(page, tmp_path / "page.html")
    drawn = page["supports"]
    if name == "sphere_off_sphere":  # larger than what is seen of it: lines on the globe
        points = np.concatenate([line["points"] for line in drawn["lines"]])
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-9)
    else:
        assert any(plane["thing"] for plane in drawn["planes"])
    assert ("spin" in drawn["planes"][0]) == (name == "turntable")
    assert ask(tmp_path / "page.html", "rb_sim.seek(0.05); return rb_sim.state.time") == 0.05


def test_between_samples_a_body_turns_the_short_way(tmp_path):
    """Whatever the signs of the quaternions are; the sample after t = 0.4 s has the other one."""
    disk = {"mass": 1.0, "shape": {"type": "disk", "radius": 0.1}, "angular_velocity": [0, 0, 2.0]}
    scene = load_scene({"bodies": {"disk": disk}, "simulation": {"duration": 1.0, "rate": 5}})
    run = Simulation(scene).run(checks=False)
    run.block.orientation[3:] *= -1.0
    save(RunPage(scene, run.layout, run.block).data(facts=[], warnings=[]), tmp_path / "page.html")
    looked_at = """
        return [0.3, 0.5].map((t) => {
          rb_sim.seek(t);
          return rb_sim.poseOf("disk").orientation;
        });
    """
    for t, (x, y, z, w) in zip((0.3, 0.5), ask(tmp_path / "page.html", looked_at), strict=True):
        assert 2.0 * np.arctan2(z * np.sign(w), abs(w)) == pytest.approx(2.0 * t, abs=1e-6)
        assert (x, y) == (0.0, 0.0)


def test_nearer_solids_are_drawn_later(answers):
    """Whatever their centres are: a small ball on a long plank, from above and from below."""
    above, below = answers["order"]
    assert above.index("plank") < above.index("ball") < above.index("pole")
    assert below[-1] == "plank"


SHAPES = [
    ({"type": "box", "size": [0.6, 0.4, 0.2]}, [0.3, 0.2, 0.1]),
    ({"type": "ellipsoid", "semi_axes": [0.3, 0.2, 0.1]}, [0.3, 0.2, 0.1]),
    ({"type": "cylinder", "radius": 0.1, "length": 0.8, "axis_B": [1, 0, 0]}, [0.4, 0.1, 0.1]),
    ({"type": "disk", "radius": 0.4, "axis_B": [0, 1, 0]}, [0.4, 0.006, 0.4]),
    ({"type": "sphere", "radius": 0.2}, [0.2, 0.2, 0.2]),
]
"""Shapes and their half extents along the axes of their body."""


@pytest.mark.filterwarnings("ignore:.*nothing moves")
def test_shapes_are_drawn_as_large_as_they_are(tmp_path):
    """Along the axes of bodies that are turned by a quarter about z, off their centre of mass."""
    turn = {"axis": [0, 0, 1], "angle": np.pi / 2}
    bodies = {
        f"b{i}": {"mass": 1.0, "shape": shape, "position": [1, 2, 3 + i], "orientation": turn}
        for i, (shape, _) in enumerate(SHAPES)
    }
    scene = load_scene({"bodies": bodies, "simulation": {"duration": 0.1}})
    from rb_sim.cli.verbs.replay import page_of_run

    save(page_of_run(Simulation(scene).run(checks=False), [], []), tmp_path / "page.html")
    drawn = ask(tmp_path / "page.html", """
        return D.bodies.map((body, i) => {
          const {position, orientation} = poseOf(i, 0);
          const frame = {position, axes: axesOf(...orientation)};
          const solid = solidOf(body.solid, frame, [0, 0, 0]);
          const ends = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((d) => reach(solid, d));
          const points = solid.kind === "ball" ? [] : meshOf(solid).points;
          return {ends, points: points.map((p) => add(solid.center, inWorld(solid.axes, p)))};
        });
    """)  # fmt: skip
    assert [found["points"] == [] for found in drawn] == [False, False, False, False, True]
    for i, ((_, half), found) in enumerate(zip(SHAPES, drawn, strict=True)):
        turned = [half[1], half[0], half[2]]
        np.testing.assert_allclose(found["ends"], turned, atol=1e-6)
        if found["points"]:
            low, high = np.min(found["points"], axis=0), np.max(found["points"], axis=0)
            np.testing.assert_allclose(0.5 * (high - low), turned, atol=1e-6)
            np.testing.assert_allclose(0.5 * (high + low), [1.0, 2.0, 3.0 + i], atol=1e-6)


def test_a_long_run_keeps_its_peaks_and_says_what_is_left_out(scene, layout, samples):
    block = samples(60_000)
    block.reaction_force[31_234, 0] = [0.0, 0.0, 7777.0]
    page = RunPage(scene, layout, block)
    assert len(page.kept) <= 5000
    data = page.data(facts=[], warnings=[])
    assert numbers(data["reactions"][0]["force"]).max() == pytest.approx(7777.0)
    assert numbers(data["t"])[-1] == pytest.approx(block.t[-1])
    assert "60000; the 3D view has " in dict(data["facts"])["samples"]


def test_many_bodies_and_reactions_stay_below_3_mb(tmp_path):
    """216 balls, 1,296 reactions that all act, 20,000 events."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
    names = tuple(f"ball{k}" for k in range(216))
    weight = {"weight": {"type": "gravity"}}
    scene = load_scene({"bodies": dict.fromkeys(names, ball), "effects": weight})
    contacts = tuple(f"c{k}" for k in range(1296))
    of = tuple(names[k % 216] for k in range(1296))
    layout = SampleLayout(names, contacts, of, (), contacts)
    block = empty_block(1500, layout)
    random = np.random.default_rng(1)
    block.t[:] = np.arange(1500) / 100.0
    for field in ("position", "orientation", "reaction_force", "reaction_torque", "anchor"):
        getattr(block, field)[:] = random.normal(size=getattr(block, field).shape)
    from dataclasses import replace

    events = tuple(ContactEvent(0.0005 * k, contacts[k % 7], "impact") for k in range(20_000))
    page = RunPage(scene, layout, replace(block, events=events))
    save(page.data(facts=[], warnings=[]), tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size < 3e6
    reported = facts(tmp_path / "page.html")
    assert reported["reactions"] == "the 24 with the greatest forces of 1296"
    shown = ask(tmp_path / "page.html", "rb_sim.seek(3.3); return rb_sim.poseOf('ball7')")
    k = int(np.argmin(np.abs(page.kept.t - 3.3)))
    gap = np.abs(np.diff(page.kept.position[:, 7], axis=0)).max()
    assert np.abs(shown["position"] - page.kept.position[k, 7]).max() < gap


def test_a_bag_of_others_is_shown_by_its_axes(tmp_path, capsys):
    bag = foreign.write(tmp_path / "drone", foreign.tf)
    show(str(bag), tmp_path / "page.html")
    page = tmp_path / "page.html"
    pose, titles = ask(page, """
        rb_sim.seek(1.0);
        return [rb_sim.poseOf(rb_sim.bodies[0]), plots.map((plot) => plot.title)];
    """)  # fmt: skip
    assert pose["position"] == pytest.approx([0.5 * np.sin(3.0), 0.1, 0.2], abs=1e-6)
    assert abs(pose["orientation"][3]) == pytest.approx(np.cos(0.4), abs=1e-6)
    assert titles[0] == "position of /body:drone, origin of its frame"  # no mass is known
    data = data_of(page)
    assert data["axes"] and data["trace"] and all(b["solid"] is None for b in data["bodies"])


def test_a_bag_that_was_cut_is_shown_as_far_as_it_goes(run, tmp_path, capsys):
    cut = tmp_path / "bag"
    record_run(TOP, cut, duration=40.0)
    (file,) = cut.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    show(str(cut), tmp_path / "page.html")
    warned = capsys.readouterr().err
    assert "the bag was never finished; the last sample that can be read is of t = " in warned
    end = ask(tmp_path / "page.html", "rb_sim.seek(1e9); return rb_sim.state.time")
    assert 5.0 < end < 35.0 and f"t = {end:.6g} s" in warned
    assert any("never finished" in line for line in data_of(tmp_path / "page.html")["warnings"])


def test_one_clear_line_for_what_cannot_be_shown(run, tmp_path):
    with pytest.raises(SinkError, match=r"page\.htm: the name must end in \.html"):
        show(str(run), tmp_path / "page.htm")
    with pytest.raises(SinkError, match="not a bag: no .mcap or .db3 file in it"):
        show(str(tmp_path))
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(RbSimError, match="this run has no bag.*--no-bag"):
        show(str(tmp_path))
    with pytest.raises(SinkError, match="page.html: cannot write it"):
        show(str(run), Path("/proc/nothing/page.html"))
    for name in ("nothing", str(tmp_path / "nothing.yaml")):
        with pytest.raises(
            RbSimError, match="does not exist; must be the folder of a run, a bag or"
        ):
            show(name)


def test_arrows_stay_in_the_picture_and_zeros_have_no_plot(tmp_path):
    """The ball stands on top of a sphere at first, with its arrow upwards, and never turns."""
    page = tmp_path / "page.html"
    show("sphere_slides_off", page)
    ends, title, text = ask(
        page,
        """
        const {width, height} = canvas.getBoundingClientRect(), rows = [...times_.keys()];
        camera.fit(width, height);
        const tips = rows.map((k) => camera.project(endsOf(arrows[0], k)[1]));
        return [tips.map(([x, y]) => 0 < x && x < width && 0 < y && y < height),
                plots.map((plot) => plot.title), document.body.innerText];
        """,
    )
    assert np.mean(ends) > 0.95
    assert not any("angles" in one for one in title) and "zero throughout: angles of ball" in text


def test_the_reaction_that_carries_most_is_shown_first(tmp_path):
    """Not the top of a leaning rod, which the floor bears only after the fall."""
    rod = """
bodies:
  rod:
    mass: 1.0
    shape: {type: rod, length: 1.0}
    position: [0, 0, 0.4330127018922193]
    orientation: {axis: [0, 1, 0], angle: 30 deg}
constraints: {floor: {type: contact, body: rod}}
effects: {weight: {type: gravity}}
simulation: {duration: 1.0, rate: 50}
"""
    page = tmp_path / "page.html"
    show(str(scene_file(tmp_path, rod)), page)
    data = data_of(page)
    assert data["reactions"][data["strongest"]]["name"] == "floor/2"
    script = "return plots.map((one) => one.title)"
    assert any("floor/2: force on rod" in title for title in ask(page, script))


def scene_file(folder: Path, text: str) -> Path:
    path = folder / "scene.yaml"
    path.write_text(text)
    return path
