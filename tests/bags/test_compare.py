# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Comparison against motions whose difference is known in closed form."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from rb_sim.bags.alignment import Clocks, moved, overlap
from rb_sim.bags.compare import differences, growth_rate, summary
from rb_sim.bags.tracks import (
    ROUNDING,
    Track,
    Tracks,
    Wrenches,
    floors,
    tracks_of_bag,
    tracks_of_csv,
)
from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.compare import CompareOptions, compare
from tests.bags.analysis import foreign
from tests.bags.scenes import PUSHED, record_node, record_run


def motion(t: np.ndarray, shift=(0.0, 0.0, 0.0), twist: float = 0.0) -> Track:
    """A spiral that turns; `shift` moves it, `twist` turns it about its own z by that angle."""
    position = np.c_[np.sin(1.3 * t), np.cos(0.7 * t), 0.2 * t] + shift
    turns = Rotation.from_rotvec(np.c_[0.3 * t, 0.1 * t**2, 0 * t])
    q = (turns * Rotation.from_rotvec([0, 0, twist])).as_quat()
    return Track(t, position, q)


def beside(a: Track, b: Track, **options):
    found = differences(Tracks("a", {"top": a}), Tracks("b", {"top": b}), **options)
    return found, summary(found)["differences"]["top"]


def test_a_shift_and_a_turn():
    t = np.linspace(0, 5, 501)
    _, table = beside(motion(t), motion(t, (0.003, 0.0, 0.004), 0.02))
    assert table["position"]["max"] == pytest.approx(0.005, rel=1e-12)
    assert table["position"]["rms"] == pytest.approx(0.005, rel=1e-12)
    assert table["angle"]["max"] == pytest.approx(0.02, rel=1e-9)


def test_other_sample_times_cost_nothing():
    """Another rate: the interpolation is of fourth order, here below 1e-6."""
    _, table = beside(motion(np.linspace(0, 5, 501)), motion(np.linspace(0, 5, 373)))
    assert table["position"]["max"] < 1e-6 and table["angle"]["max"] < 1e-6


def spun(t: np.ndarray, turn: float) -> Track:
    """A circle of 1 m, and a turn about z, by `turn` [rad] each second."""
    angle = turn * t
    position = np.c_[np.cos(angle), np.sin(angle), 0 * t]
    q = Rotation.from_rotvec(np.c_[0 * t, 0 * t, angle]).as_quat()
    velocity = turn * np.c_[-position[:, 1], position[:, 0], 0 * t]
    return Track(t, position, q, velocity, np.tile([0.0, 0.0, turn], (len(t), 1)))


@pytest.mark.parametrize("turn", [0.1, 0.6, 1.2, 1.8])
def test_what_interpolation_makes_is_reported_and_is_no_divergence(turn: float):
    """The same motion, sampled once a second and ten times: all that differs is interpolation."""
    a, b = spun(np.linspace(5.0, 35.0, 301), turn), spun(np.linspace(0.0, 40.0, 41), turn)
    found, table = beside(a, b)
    for quantity in ("position", "angle"):
        row = table[quantity]
        assert 0.5 * row["max"] < row["interpolation"] < 2.0 * row["max"]
        assert row["first_above"] is None and row["growth"] is None
    reported = [
        f"{table[q]['interpolation']:.2g} m" for q in ("position", "velocity") if turn > 1.0
    ]
    assert len(found.notes) == (turn > 1.0) and all(part in found.notes[0] for part in reported)
    assert "of which interpolation" in summary(found, {"angle": 0.0})["exceeded"][0]
    beyond = replace(b, position=b.position + [0.5, 0.0, 0.0])
    found, table = beside(a, beyond)
    assert table["position"]["first_above"] == 5.0
    _, table = beside(b, b)
    assert table["position"]["interpolation"] == 0.0


def coning(t: np.ndarray) -> Track:
    """A top that precesses at 6 rad/s, tilted by 1 rad, and spins at 130 rad/s."""
    turns = [Rotation.from_rotvec(np.outer(t, [0.0, 0.0, w])) for w in (6.0, 130.0)]
    q = (turns[0] * Rotation.from_rotvec([1.0, 0.0, 0.0]) * turns[1]).as_quat()
    return Track(t, np.outer(t, [1.0, 0.0, 0.0]), q)


def test_an_estimate_that_passes_through_zero_hides_no_interpolation():
    """Where it does so the error of the spline does not; at B's own samples nothing is hidden."""
    a, b = coning(np.linspace(0.0, 2.0, 1001)), coning(np.linspace(0.0, 2.0, 101))
    row = beside(a, b)[1]["angle"]
    assert row["max"] > 0.01 and row["first_above"] is None
    turn = Rotation.from_rotvec([0.0, 0.0, 2e-3])
    a.orientation = (turn * Rotation.from_quat(a.orientation)).as_quat()
    assert beside(a, b)[1]["angle"]["first_above"] == 0.0


def swelling(t: np.ndarray) -> Track:
    """An oscillation of 0.8 rad a second whose size grows by exp(0.5 t)."""
    x = 1e-3 * np.exp(0.5 * t) * np.sin(0.8 * t)
    return Track(t, np.outer(x, [1.0, 0.5, 0.0]), np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)))


def test_what_interpolation_makes_does_not_grow():
    """It is of the size of the motion, which grows; a difference of the motions does so, too."""
    a, b = swelling(np.linspace(2.0, 16.0, 141)), swelling(np.linspace(0.0, 18.0, 19))
    row = beside(a, b)[1]["position"]
    assert row["max"] > 1e-3 and row["growth"] is None and row["first_above"] is None
    a.position += np.outer(1e-2 * np.exp(0.5 * a.t), [0.0, 0.0, 1.0])
    assert beside(a, b)[1]["position"]["growth"] == pytest.approx(0.5, abs=0.05)


def test_what_interpolation_makes_of_a_reaction_is_reported():
    """The same reaction, sampled once a second and ten times."""
    a, b = np.linspace(5.0, 35.0, 301), np.linspace(0.0, 40.0, 41)

    def tracks(t: np.ndarray) -> Tracks:
        wrench = np.outer(np.sin(0.8 * t), [30.0, 0.0, 0.0, 0.0, 0.4, 0.0])
        return Tracks("", {"top": spun(t, 0.01)}, {"tip": Wrenches(t, wrench)})

    table = summary(differences(tracks(a), tracks(b)))["differences"]["reaction tip"]
    for quantity in ("force", "torque"):
        row = table[quantity]
        assert 0.5 * row["max"] < row["interpolation"] < 2.0 * row["max"]
        assert row["first_above"] is None


def begun_anew(t: np.ndarray, at: float) -> Track:
    """The spiral, which is put back to its start at the first sample from `at` on."""
    k = int(np.searchsorted(t, at))
    parts = [motion(t[:k]), motion(t[k:] - at, (3.0, 0.0, 0.0))]
    position, q = (np.concatenate([getattr(part, name) for part in parts])
                   for name in ("position", "orientation"))  # fmt: skip
    return Track(t, position, q, anew=(k,))


def test_nothing_is_interpolated_across_a_reset():
    """Between the last sample before it and the first one after, nobody knows where B was."""
    a, b = begun_anew(np.linspace(0, 5, 501), 2.4), begun_anew(np.linspace(0, 5, 377), 2.4)
    found, table = beside(a, b)
    assert table["position"]["max"] < 1e-6 and table["angle"]["max"] < 1e-6
    inside = b.t[b.anew[0] - 1], b.t[b.anew[0]]
    between = int(((a.t > inside[0]) & (a.t < inside[1])).sum())
    assert found.left_out == {"top": between} and between > 0
    assert found.notes == [f"top: {between} samples skipped (gap, impact or reset in B)"]
    shifted = Track(b.t + 0.03, b.position, b.orientation, anew=b.anew)
    found, table = beside(a, shifted, align="offset")
    assert found.clocks.offset == pytest.approx(0.03, abs=1e-6)
    assert table["position"]["max"] < 1e-5


def test_nothing_is_interpolated_across_a_gap():
    t = np.linspace(0, 5, 377)
    gone = (t < 1.0) | (t > 1.5)
    found, table = beside(motion(np.linspace(0, 5, 501)), motion(t[gone]))
    assert table["position"]["max"] < 1e-6
    assert 45 <= found.left_out["top"] <= 52


def test_a_bag_tells_where_its_run_began_anew(tmp_path):
    """There, and only there, the position jumps by more than a step of the motion covers."""
    bag = record_node(tmp_path / "bag")
    track = tracks_of_bag(bag).bodies["box"]
    steps = np.linalg.norm(np.diff(track.position, axis=0), axis=1)
    assert track.anew == (int(np.argmax(steps)) + 1,)


def test_offset_and_drift_of_the_other_clock():
    t = np.linspace(0, 8, 801)
    clock = t * (1 + 8e-5) + 1.7e9 + 0.123
    other = motion(t)
    other = Track(clock, other.position, other.orientation)
    found, table = beside(motion(t), other, align="clock")
    assert found.clocks.offset == pytest.approx(1.7e9 + 0.123, abs=1e-5)
    assert found.clocks.drift == pytest.approx(8e-5, abs=1e-6)
    assert 0.0 < found.clocks.drift_error < 1e-6
    assert table["position"]["max"] < 1e-5
    found, table = beside(motion(t), other)  # the times do not overlap: the offset by itself
    assert found.align == "offset" and found.clocks.drift == 0.0
    assert found.clocks.offset == pytest.approx(1.7e9 + 0.123, abs=1e-3)
    assert 1e-5 < table["position"]["max"] < 1e-3
    found, table = beside(motion(t), other, align="first")
    assert found.clocks.offset == pytest.approx(1.7e9 + 0.123, abs=1e-6)
    near = Track(t + 0.05, other.position, other.orientation)
    assert beside(motion(t), near)[1]["position"]["max"] > 0.03
    assert beside(motion(t), near, align="offset")[1]["position"]["max"] < 1e-6


@pytest.mark.parametrize("align", ["first", "offset", "clock", None])
@pytest.mark.parametrize("stiffer", [0.8, 1.1, 1.5])
def test_no_clock_lays_a_wrong_plant_onto_a_right_one(align, stiffer):
    """x = cos(w t) beside cos(w' t) with stamps of another day: they part by the beat of both.

    Bent time (t' = t w / w') would lay them onto each other to rounding.
    """
    t = np.linspace(0.0, 10.0, 1001)
    q = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1))

    def swing(rate, shift):
        return Track(t + shift, np.c_[np.cos(rate * t), 0 * t, 0 * t], q)

    w = 4.0
    found, table = beside(swing(w, 0.0), swing(w * stiffer**0.5, 1.7e9), align=align)
    assert abs(found.clocks.drift) <= 1e-4
    assert table["position"]["rms"] > 0.2
    within = overlap(swing(w, 0.0), swing(w * stiffer**0.5, 1.7e9), found.clocks)
    assert within.mean() >= 0.499  # nor by comparing only what is left at the ends


@pytest.mark.parametrize("align", ["first", "offset", "clock", None])
def test_a_wrong_plant_passes_no_bound_by_an_offset(align):
    """Falls with g and 1.1 g part by 0.05 g t^2; later by 0.035 s they are 0.12 m apart at most."""
    t, g = np.linspace(0.0, 1.0, 501), 9.81
    q = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1))

    def fall(gravity, shift):
        noise = 1e-3 * np.random.default_rng(int(10 * gravity)).standard_normal((len(t), 3))
        position = np.c_[0 * t, 0 * t, -0.5 * gravity * t**2] + noise
        return Tracks("fall", {"b": Track(t + shift, position, q)})

    right = differences(fall(g, 0.0), fall(g, 1.7e9), align=align)
    assert not summary(right, {"position": 0.15})["exceeded"] and not right.notes
    assert abs(right.clocks.offset - 1.7e9) <= max(4.0 * right.clocks.offset_error, 1e-6)
    wrong = differences(fall(g, 0.0), fall(1.1 * g, 1.7e9), align=align)
    (line,) = summary(wrong, {"position": 0.15})["exceeded"]
    assert float(line.split()[2]) == pytest.approx(0.05 * g, abs=0.01)
    assert not summary(wrong, {"position": 0.51})["exceeded"]


def test_a_bound_is_not_passed_by_comparing_what_stands_still():
    """An excursion of A before B begins, of B after A has ended: both stand still in between."""
    t = np.linspace(0.0, 10.0, 1001)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1))

    def excursion(at, size, shift):
        x = size * np.exp(-(((t - at) / 0.3) ** 2))
        return Track(t + shift, np.c_[x, 0 * t, 0 * t], still)

    a, b = excursion(3.0, 1.0, 0.0), excursion(7.0, 0.3, 1.7e9)
    apart = Clocks(1.7e9 - 5.0)  # A's last half beside B's first one
    assert moved(a, overlap(a, b, apart)) < 0.01 > moved(b, overlap(b, a, apart.back))
    found, _ = beside(a, b, align="offset")
    assert found.shared > 0.9 and found.clocks.offset == pytest.approx(1.7e9 + 4.0, abs=0.3)
    found.shared = 0.01
    assert "only 1% of the motion overlaps" in summary(found, {"position": 9.0})["exceeded"][-1]


def test_an_unknown_way_to_align_is_refused():
    t = np.linspace(0.0, 1.0, 11)
    with pytest.raises(RbSimError, match="--align: got 'best'; must be one of none, first, off"):
        beside(motion(t), motion(t), align="best")


EUROC = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1]"
)


@pytest.mark.parametrize("header", [EUROC, "time,x,y,z,qw,qx,qy,qz,vx,vy,vz,temperature"])
@pytest.mark.parametrize(
    ("factor", "start"), [(1e9, 1.4e9), (1e9, 0.0), (1e6, 1.4e9), (1e3, 1.4e9), (1.0, 0.0)]
)
def test_csv_with_w_first_and_other_units_of_time(tmp_path, header, factor, start):
    """The header names the columns; stamps of another unit are recognised, and said."""
    path, q = tmp_path / "pose.csv", Rotation.from_rotvec([0.3, -0.2, 0.5]).as_quat()
    lines = [header]
    for k in range(10):
        at = start + 0.005 * k
        t = f"{at:.6f}" if factor == 1.0 else f"{round(at * factor)}"
        lines.append(f"{t},{k},2,3,{q[3]},{q[0]},{q[1]},{q[2]},4,5,6,0.1")
    path.write_text("\n".join(lines) + "\n")
    found = tracks_of_csv(path)
    track = found.bodies["pose"]
    np.testing.assert_allclose(track.t - track.t[0], 0.005 * np.arange(10), atol=1e-6)
    assert track.t[0] == pytest.approx(start, abs=1e-6)
    np.testing.assert_allclose(track.position[3], [3, 2, 3])
    np.testing.assert_allclose(track.orientation[3], q)
    np.testing.assert_allclose(track.linear_velocity[3], [4, 5, 6])
    assert any("times are taken as" in note for note in found.notes) == (factor != 1.0)


def test_csv_whose_header_names_the_unit_of_time(tmp_path):
    path = tmp_path / "pose.csv"
    rows = [f"{5 * k},{k},0,0,0,0,0,1" for k in range(4)]
    path.write_text("t [ms],x [mm],y [mm],z [mm],qx,qy,qz,qw\n" + "\n".join(rows))
    found = tracks_of_csv(path)
    np.testing.assert_allclose(found.bodies["pose"].t, 0.005 * np.arange(4))
    np.testing.assert_allclose(found.bodies["pose"].position[:, 0], 0.001 * np.arange(4))
    assert [note.partition(": ")[2] for note in found.notes] == [
        "times are in ms, as its header says",
        "positions are in mm, as its header says",
    ]


@pytest.mark.parametrize("head", ["stamp_ms", "time (ms)", "t [ms]"])
def test_csv_at_a_kilohertz_in_ms(tmp_path, head):
    """Steps of 1 could be seconds: the header tells the unit, in one of three ways."""
    path = tmp_path / "pose.csv"
    rows = [f"{k},{k},0,0,0,0,0,1" for k in range(9)]
    path.write_text(f"{head},x,y,z,qx,qy,qz,qw\n" + "\n".join(rows))
    np.testing.assert_allclose(tracks_of_csv(path).bodies["pose"].t, 0.001 * np.arange(9))


def test_csv_with_seconds_and_nanoseconds_apart(tmp_path):
    """Without the nanoseconds all samples of a second would have one time, which is told."""
    path = tmp_path / "pose.csv"
    rows = [f"{5 + k // 100},{k % 100 * 10_000_000},{k},0,0,0,0,0,1" for k in range(250)]
    path.write_text("sec,nanosec,x,y,z,qx,qy,qz,qw\n" + "\n".join(rows))
    found = tracks_of_csv(path)
    np.testing.assert_allclose(found.bodies["pose"].t, 5.0 + 0.01 * np.arange(250), rtol=1e-12)
    assert not found.notes
    path.write_text("sec,spare,x,y,z,qx,qy,qz,qw\n" + "\n".join(rows))
    (note,) = tracks_of_csv(path).notes
    assert note.endswith("247 lines of pose skipped: their times do not increase")


@pytest.mark.parametrize("rate", [20.0, 100.0, 500.0])
@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9), ("", 1.0)])
@pytest.mark.parametrize("bodies", [1, 2])
def test_csv_with_times_from_0_in_other_units(tmp_path, rate, unit, factor, bodies):
    path = tmp_path / "pose.csv"
    rows = [f"{k / rate * factor:.10g},{k},0,0,0,0,0,1,b{i}"
            for k in range(40) for i in range(bodies)]  # fmt: skip
    path.write_text("t,x,y,z,qx,qy,qz,qw,body\n" + "\n".join(rows))
    found = tracks_of_csv(path)
    for track in found.bodies.values():
        np.testing.assert_allclose(track.t, np.arange(40) / rate, rtol=1e-12)
    assert [f"taken as {unit}," in note for note in found.notes] == [True] * bool(unit)


def test_growth_and_first_divergence():
    t = np.linspace(0, 10, 1001)
    apart = np.minimum(1e-12 * np.exp(2.5 * t), 0.1)
    assert growth_rate(t, apart) == pytest.approx(2.5, rel=1e-6)
    a, b = motion(t), motion(t)
    b.position[:, 0] += apart
    row = beside(a, b)[1]["position"]
    assert row["growth"] == pytest.approx(2.5, rel=0.05)
    assert row["first_above"] == pytest.approx(np.log(row["bound"] / 1e-12) / 2.5, abs=0.02)


def test_a_bag_and_a_scene_and_a_bound(tmp_path, capsys):
    """The scene with one per cent more gravity falls 0.01 g t^2 / 2 further."""
    bag = record_run(PUSHED, tmp_path / "bag")
    scene = tmp_path / "heavier.yaml"
    scene.write_text(PUSHED.replace("{type: gravity}",
                                    "{type: gravity, acceleration: [0, 0, -9.9046]}"))  # fmt: skip
    out = tmp_path / "out"
    options = CompareOptions(bag, str(scene), out, max_position=1e-3)
    assert compare(options) == 1
    reported = json.loads((out / "compare.json").read_text())
    fall = (9.9046 - 9.81) / 2 * 1.0**2
    assert reported["differences"]["box"]["position"]["max"] == pytest.approx(fall, rel=1e-3)
    assert reported["exceeded"] and (out / "compare.png").stat().st_size > 10_000
    same = CompareOptions(bag, str(bag), max_position=0.0, max_angle=0.0)
    assert compare(same) == 0


def test_csv_in_two_forms(tmp_path):
    t = np.linspace(0, 1, 50)
    track = motion(t)
    rows = np.c_[t, track.position, track.orientation]
    tum = tmp_path / "motion.txt"
    np.savetxt(tum, rows, header="timestamp tx ty tz qx qy qz qw")
    named = tmp_path / "motion.csv"
    order = [7, 0, 1, 2, 3, 4, 5, 6]
    names = np.array("t x y z qx qy qz qw".split())[order]
    np.savetxt(named, rows[:, order], delimiter=",", header=",".join(names), comments="")
    for path in (tum, named):
        found = tracks_of_csv(path).bodies["motion"]
        np.testing.assert_allclose(found.position, track.position)
        np.testing.assert_allclose(found.orientation, track.orientation)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "no line with numbers"),
        ("t,x,y\n1,2,3\n", "no column z, qx, qy, qz, qw; must be t, x"),
        ("1 2 3 4 0 0 0 1\n2 2 3 4 0 0 0 one\n", "a line is not 8 numbers"),
        ("1 2 3 nan 0 0 0 1\n", "a number is not finite"),
        ("t,x,y,z,qx,qy,qz,qw\n1,2,3,4,0,0,0,1\nlost\n", "a line is not 8 numbers"),
        ("zeit,links,hoch,weit,a,b,c,d\n1,2,3,4,0,0,0,1\n", "no column t, x, y, z, qx"),
    ],
)
def test_a_csv_that_will_not_do(tmp_path, text, line):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(RbSimError, match=line) as caught:
        tracks_of_csv(path)
    assert len(str(caught.value).splitlines()) == 1


def test_no_body_in_common():
    t = np.linspace(0, 1, 20)
    a = Tracks("a", {"top": motion(t), "nut": motion(t)})
    b = Tracks("b", {"disk": motion(t), "ball": motion(t)})
    with pytest.raises(RbSimError, match="use --match"):
        differences(a, b)
    assert differences(a, b, match={"nut": "ball"}).pairs == {"nut": "ball"}
    with pytest.raises(RbSimError, match="the second one of disk, ball"):
        differences(a, b, match={"nut": "boll"})


def test_the_only_body_of_another_scene_is_compared_with_a_note():
    """A bag of a top and the scene of a pendulum: nothing said that these are two bodies."""
    t = np.linspace(0, 1, 20)
    a, b = Tracks("a", {"top": motion(t)}, length=1.0), Tracks("b", {"rod": motion(t)}, length=1.0)
    (note,) = differences(a, b).notes
    assert note.startswith("top: compared with rod, the only body of B")
    assert differences(a, b, match={"top": "rod"}).notes == []
    assert differences(a, replace(b, length=0.0)).notes == []


def test_overlay(tmp_path, monkeypatch):
    """With a panel for the positions, which differ, and none for what is the same."""
    blueprint = pytest.importorskip("rerun.blueprint", reason="rerun-sdk is not installed")
    from rb_sim.bags.comparison_views import overlay

    panels, view = [], blueprint.TimeSeriesView
    monkeypatch.setattr(
        blueprint, "TimeSeriesView", lambda **given: panels.append(given["name"]) or view(**given)
    )
    t = np.linspace(0, 2, 101)
    a, b = Tracks("a", {"top": motion(t)}), Tracks("b", {"top": motion(t, (0.1, 0, 0))})
    overlay(a, b, differences(a, b), Path(tmp_path / "o.rrd"))
    assert (tmp_path / "o.rrd").stat().st_size > 5000
    assert panels == ["position [m]"]
    overlay(a, a, differences(a, a), Path(tmp_path / "same.rrd"))
    assert panels == ["position [m]"]


def test_a_picture_of_both_motions_is_drawn_where_it_is_asked_for(tmp_path, monkeypatch):
    """Of the overlay, which is then kept nowhere else; a name that is no .png is refused first."""
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    drawn = []

    def draw(recording: Path, picture: Path) -> None:
        drawn.append((recording.stat().st_size > 5000, picture))

    monkeypatch.setattr("rb_sim.io.rerun.viewer.save_screenshot", draw)
    t = np.linspace(0, 2, 101)
    track = motion(t)
    np.savetxt(tmp_path / "a.txt", np.c_[t, track.position, track.orientation])
    bag = record_run(PUSHED, tmp_path / "bag")
    options = CompareOptions(bag, str(tmp_path / "a.txt"), match=["box=a"])
    compare(replace(options, screenshot=tmp_path / "both.png"))
    assert drawn == [(True, tmp_path / "both.png")]
    with pytest.raises(RbSimError, match=r"both.jpg: the name must end in .png"):
        compare(replace(options, screenshot=tmp_path / "both.jpg"))


def test_equal_instants_are_holes_of_a_logarithmic_axis():
    """Where some differences are zero they do not stretch the axis; where all are, a line is."""
    from rb_sim.bags.comparison_views import LEAST_DRAWN, _above_floor

    drawn = _above_floor(np.array([0.0, 1e-6, 1e-3]))
    assert np.isnan(drawn[0])
    assert drawn[1:].tolist() == [1e-6, 1e-3]
    assert _above_floor(np.zeros(2)).tolist() == [LEAST_DRAWN, LEAST_DRAWN]


def test_rounding_where_a_point_stands_still_is_not_apart():
    """The origin of a spinning top stands on its tip: what differs there is noise."""
    t = np.linspace(0, 5, 501)
    noise = 2e-13 * np.random.default_rng(1).standard_normal((2, len(t), 3))
    one, other = motion(t), motion(t)
    one.position, other.position = noise[0], noise[1]
    row = beside(one, other)[1]["position"]
    assert row["first_above"] is None and row["growth"] is None
    other.position = noise[1] + np.c_[np.where(t < 2.0, 0.0, 1.0), 0 * t, 0 * t]
    assert beside(one, other)[1]["position"]["first_above"] == 2.0


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
def test_the_floor_is_relative_to_the_motion_or_the_scene(size: float):
    """The same of a motion over a micrometre and a kilometre; of a scene its bodies count, too."""
    t = np.linspace(0, 5, 501)
    one, other = motion(t), motion(t)
    one.position *= size
    covered = np.ptp(one.position, axis=0).max()
    other.position = one.position + [1e-4 * covered, 0.0, 0.0]
    tops = Tracks("a", {"top": one}), Tracks("b", {"top": other})
    assert floors(*tops)["position"] == pytest.approx(ROUNDING * covered)
    tops[0].length = 50.0 * size
    assert floors(*tops)["position"] == pytest.approx(ROUNDING * 50.0 * size)


def test_a_torque_that_vanishes_is_small_against_force_times_length():
    t = np.linspace(0, 1, 101)
    wrench = np.zeros((len(t), 6))
    wrench[:, 2] = 20.0
    off = wrench + 1e-14 * np.random.default_rng(1).standard_normal(wrench.shape)
    tracks = [
        Tracks(name, {"top": motion(t)}, {"tip": Wrenches(t, w)}, [], 0.5)
        for name, w in (("a", wrench), ("b", off))
    ]
    table = summary(differences(*tracks))["differences"]["reaction tip"]
    assert table["torque"]["bound"] == pytest.approx(
        ROUNDING * 20.0 * floors(*tracks)["position"] / ROUNDING
    )
    assert table["torque"]["first_above"] is None and table["force"]["first_above"] is None


def test_a_single_sample_beside_a_motion():
    """Its one instant is compared; where the single sample is the other motion, it is refused."""
    t = np.linspace(0, 5, 501)
    whole, one = motion(t), motion(t[100:101])
    assert beside(one, whole)[1]["position"]["max"] == 0.0
    with pytest.raises(RbSimError, match="a motion of 1 sample .*: must be at least 4"):
        beside(whole, one)


@pytest.mark.parametrize("begin", [1.7e9, -2.0e9])
def test_times_of_a_calendar_are_shown_from_the_first_on(tmp_path, capsys, begin):
    """Six digits of 1.7e9 s are the same for days."""
    t = begin + np.linspace(0, 5, 501)
    for name, shift in (("a", 0.0), ("b", 0.5)):
        track = motion(t - begin)
        track.position[:, 0] += np.where(t - begin >= 2.0, shift, 0.0)
        np.savetxt(tmp_path / f"{name}.txt", np.c_[t, track.position, track.orientation], "%.17g")
    from rb_sim.cli.verbs.compare import _print

    a, b = (tracks_of_csv(tmp_path / f"{name}.txt") for name in "ab")
    reported = summary(differences(a, b, match={"a": "b"}))
    _print(reported)
    said = capsys.readouterr().out
    assert f"t from {begin:.6f} s on" in said and "e+09" not in said
    assert reported["differences"]["a"]["position"]["first_above"] == pytest.approx(begin + 2.0)
    assert any(line.split()[-1] == "2" for line in said.splitlines() if "position" in line)


def test_why_nothing_can_be_compared_is_reported_first(tmp_path, capsys):
    """All stamps but the first go back: what is left is one pose."""
    t, p, q = foreign.swing(40)
    bag = foreign.write(tmp_path / "bag", t=t[::-1], position=p, q=q)
    with pytest.raises(RbSimError, match="a motion of 1 sample with increasing times"):
        compare(CompareOptions(bag, str(bag)))
    assert "39 poses skipped: stamps do not increase" in capsys.readouterr().err


@pytest.mark.parametrize("bound", [float("nan"), -1e-3])
def test_a_bound_that_is_none_is_refused(bound: float, tmp_path) -> None:
    options = CompareOptions(tmp_path / "none", "none", max_angle=bound)
    with pytest.raises(RbSimError, match=r"^--max-angle: got .*; must be >= 0$"):
        compare(options)


def pictured(a: Tracks, b: Tracks, tmp_path, monkeypatch) -> Figure:
    """The figure of compare.png."""
    from rb_sim.bags.comparison_views import picture

    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: figures.append(self))
    picture(differences(a, b), a, b, tmp_path / "compare.png")
    return figures[0]


def test_the_picture_lays_both_over_each_other_and_bridges_no_gap(tmp_path, monkeypatch):
    """A rolls through three turns about y; B has a gap of 0.6 s and is 1 mm higher."""
    t = np.linspace(0, 2, 401)
    half = 0.5 * 6.0 * np.pi * t
    turns = np.c_[0 * t, np.sin(half), 0 * t, np.cos(half)]
    a = Track(t, np.c_[t, 0 * t, 0.1 * np.sin(3 * t)], turns)
    seen = (t < 0.7) | (t > 1.3)
    b = Track(t[seen], a.position[seen] + [0, 0, 1e-3], -turns[seen])
    figure = pictured(Tracks("a", {"ball": a}), Tracks("b", {"ball": b}), tmp_path, monkeypatch)
    axes = {axis.get_ylabel(): axis for axis in figure.axes if axis.axison}
    assert list(axes) == [
        "x [m]",
        "pitch [°]",
        "z [m]",
        "position difference [m]",
    ]  # y, roll, yaw rest
    for label, axis in axes.items():
        *_, last = axis.get_lines()  # of B, or of the difference
        times, values = last.get_xdata(), last.get_ydata()
        within = np.isnan(values[1:]) | np.isnan(values[:-1]) | (np.diff(times) < 0.1)
        assert within.all() and np.isnan(values).any(), label
    one, other = axes["pitch [°]"].get_lines()
    np.testing.assert_allclose(one.get_ydata(), 1080.0 * one.get_xdata(), atol=1e-6)
    kept = ~np.isnan(other.get_ydata())
    np.testing.assert_allclose(other.get_ydata()[kept], 1080.0 * other.get_xdata()[kept], atol=1e-6)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["A", "B", "ball"]
    assert not any(axis.get_legend() for axis in figure.axes)


def test_what_is_the_same_has_no_panel_but_a_line(tmp_path, monkeypatch):
    t = np.linspace(0, 2, 101)
    one, other = (Tracks(name, {"top": motion(t)}) for name in "ab")
    figure = pictured(one, other, tmp_path, monkeypatch)
    assert "same to rounding: position, angle" in figure.get_suptitle()
    assert not any("apart" in axis.get_ylabel() for axis in figure.axes if axis.axison)


def test_a_table_of_a_trajectory_is_refused_with_the_reason(tmp_path):
    """Its positions are of centres of mass, those of bags of the bodies' origins."""
    table = tmp_path / "run.csv"
    table.write_text("t,position.top.x,position.top.y,position.top.z\n0,1,2,3\n")
    with pytest.raises(RbSimError, match="run.csv: .*to_csv has positions of centres of mass"):
        tracks_of_csv(table)
