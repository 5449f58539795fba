# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Analysis of bags of ours and of anybody against motions whose numbers are known."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.bags.analysis.bodies import BodyFigures, masses_of
from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.figures import Figures
from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.cli.verbs.analyze import AnalyzeOptions
from rb_sim.cli.verbs.analyze import analyze as verb
from tests.bags.analysis import foreign
from tests.bags.scenes import PUSHED, record_run
from tests.browser import ask
from tests.cli.process import invoke

CUBE = Body(2.0, np.diag([0.1, 0.2, 0.3]), np.zeros(3))


@pytest.mark.parametrize("make", [foreign.pose_stamped, foreign.tf, foreign.odometry])
def test_poses_of_anybody(tmp_path, make):
    """m a of a harmonic motion, and the spin; whatever the type of the messages is."""
    bag = foreign.write(tmp_path / "bag", make)
    found = analyze(bag, masses={"body": CUBE, "drone": CUBE, "x": CUBE})
    name = "/tf" if make is foreign.tf else "/body"
    source = "/body:drone" if make is foreign.tf else "/body"
    assert name and source in found.bodies
    reported = found.as_dict()
    rates = reported["sources"][source]
    assert rates["count"] == 400 and rates["rate"] == pytest.approx(100.0, rel=1e-6)
    body = reported["bodies"][source]
    assert body["motion"]["wz"]["mean"] == pytest.approx(0.8, rel=1e-6)
    assert body["motion"]["vz"]["mean"] == pytest.approx(0.2, rel=1e-6)
    assert body["wrench"]["Fx"]["largest"] == pytest.approx(2.0 * 0.5 * 9.0, rel=1e-3)
    assert abs(body["wrench"]["Kx"]["largest"]) < 1e-6
    assert body["state"]["Lz"]["rms"] > 0
    if make is foreign.odometry:
        assert reported["sources"]["/body:twist"]["values"]["wz"]["mean"] == pytest.approx(0.8)


def test_a_recorded_run_agrees_with_its_wrenches(tmp_path):
    """Gravity is all that acts on the thrown box; total momentum and energy balance."""
    bag = _long_run(tmp_path / "bag")
    reported = analyze(bag).as_dict()
    box = reported["bodies"]["box"]
    assert box["wrench"]["Fz"]["mean"] == pytest.approx(-2.0 * 9.81, rel=1e-6)
    assert box["recorded"]["Fz"]["mean"] == pytest.approx(-2.0 * 9.81, rel=1e-12)
    assert box["apart"]["force"] < 1e-6 and box["apart"]["torque"] < 1e-5
    (balance,) = reported["balances"].values()
    assert abs(balance["energy"]["error"]) < 1e-6


def _long_run(folder: Path) -> Path:
    return record_run(PUSHED, folder, rate=400, duration=0.3, method="rk4", step=2.5e-3)


def spoilt(kind: str, folder: Path) -> Path:
    """A bag with one thing wrong."""
    t, p, q = foreign.swing()
    if kind == "gaps":
        keep = np.r_[0:100, 180:400]
        return foreign.write(folder, t=t[keep], position=p[keep], q=q[keep])
    if kind == "nan":
        p[50:60, 1] = np.nan
    if kind == "zero quaternion":
        q[10] = 0.0
    if kind == "time back":
        t[200:] -= 0.5
    if kind == "empty":
        t = t[:0]
    bag = foreign.write(folder, t=t, position=p, q=q)
    (file,) = bag.glob("*.mcap")
    if kind == "cut off":
        file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    if kind == "no file":
        file.unlink()
    if kind == "not a bag":
        file.write_text("hello")
    return bag


@pytest.mark.parametrize(
    ("kind", "note"),
    [
        ("gaps", ""),
        ("nan", "10 readings with NaN or infinity skipped"),
        ("zero quaternion", "1 readings with a quaternion of length 0 skipped"),
        ("time back", "time goes back 1 times"),
    ],
)
def test_what_is_wrong_is_reported(tmp_path, kind, note):
    found = analyze(spoilt(kind, tmp_path / "bag"))
    reported = found.as_dict()
    assert any(note in line for line in found.notes) or not note
    source = reported["sources"]["/body"]
    if kind == "gaps":
        assert source["gaps"] == 1
        assert source["first_gaps"][0]["seconds"] == pytest.approx(0.81)
    assert source["values"]["z"]["largest"] == pytest.approx(0.2 * 3.99, rel=1e-6)
    assert abs(reported["bodies"]["/body"]["motion"]["vz"]["mean"] - 0.2) < 1e-6
    json.dumps(reported, allow_nan=False)


@pytest.mark.parametrize("kind", ["empty", "no file", "not a bag"])
def test_nothing_to_read_is_one_line(tmp_path, kind):
    with pytest.raises(SinkError) as caught:
        analyze(spoilt(kind, tmp_path / "bag"))
    assert len(str(caught.value).splitlines()) == 1


def test_a_topic_that_is_not_there_names_those_that_are(tmp_path):
    bag = spoilt("gaps", tmp_path / "bag")
    with pytest.raises(SinkError, match="no readable topic /bodi; must be /body$"):
        analyze(bag, topics=frozenset({"/bodi"}))


def test_what_lies_before_the_cut_is_analyzed(tmp_path):
    """The one chunk of this bag, of 400 poses in 4 s, is cut off after 316."""
    found = analyze(spoilt("cut off", tmp_path / "bag"))
    (note,) = (line for line in found.notes if "cut off" in line)
    assert "messages missing between t = 3.15000013 s and t = 3.99000013 s of the bag" in note
    assert found.messages == 316
    assert abs(found.as_dict()["bodies"]["/body"]["motion"]["vz"]["mean"] - 0.2) < 1e-6


def coning(period: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Torque and note of a cube that spins about an axis that turns, looked at every `period`."""
    t = period * np.arange(count)
    turned = [Rotation.from_rotvec(np.outer(t, axis)) for axis in ([0, 0, 3.0], [0, 0, 40.0])]
    q = (turned[0] * Rotation.from_rotvec([0.5, 0, 0]) * turned[1]).as_quat()
    figures = BodyFigures(CUBE)
    figures.add(t, np.hstack([np.zeros((count, 3)), q]))
    figures.finish()
    return figures.as_dict()["wrench"]["Kx"]["rms"], "".join(figures.notes)


def test_a_spin_that_is_too_fast_for_the_samples_is_reported():
    """The error that is told is of the size of the torque's, and less."""
    exact, nothing = coning(1e-3, 4001)
    assert not nothing
    torque, note = coning(4e-2, 101)
    assert note.startswith("turns by up to 1.7 rad between samples")
    reported = float(note.split("error of ")[1].split(" %")[0]) / 100.0
    assert 0.05 < reported < abs(torque / exact - 1.0) < 3.0 * reported


def test_a_wrong_schema_is_reported(tmp_path):
    """A Float64 that says it is a PoseStamped, by its schema and by its bytes."""
    import mcap.writer

    path = tmp_path / "wrong.mcap"
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start(profile="ros2", library="somebody")
        schema = writer.register_schema("geometry_msgs/msg/PoseStamped", "ros2msg", b"float64 x\n")
        unsaid = writer.register_schema("geometry_msgs/msg/PoseStamped", "ros2msg", b"")
        channel = writer.register_channel("/x", "cdr", schema)
        short = writer.register_channel("/short", "cdr", unsaid)
        big = writer.register_channel("/big", "cdr", unsaid)
        writer.add_message(short, 0, b"\0\1\0\0" + bytes(8), 0)
        writer.add_message(channel, 0, b"\0\1\0\0" + bytes(8), 0)
        writer.add_message(big, 0, b"\0\0\0\0" + bytes(80), 0)
        writer.finish()
    with pytest.raises(SinkError) as caught:
        analyze(path)
    (line,) = str(caught.value).splitlines()
    assert "/x: skipped: its schema of geometry_msgs/msg/PoseStamped lacks header, pose" in line
    assert "/short: skipped: a message of 12 bytes is not a geometry_msgs/msg/PoseStamped" in line
    assert "/big: skipped: its encoding 0000 is not CDR, little endian" in line


def test_mass_properties_of_a_urdf(tmp_path):
    """The inertia turns with its origin: a quarter about z exchanges x and y."""
    path = tmp_path / "drone.urdf"
    path.write_text(
        '<robot name="r"><link name="drone"><inertial><mass value="2"/>'
        '<origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="3"/></inertial></link></robot>'
    )
    body = masses_of(str(path))["drone"]
    np.testing.assert_allclose(body.inertia, np.diag([2.0, 1.0, 3.0]), atol=1e-12)
    assert body.mass == 2.0 and body.center_of_mass.tolist() == [0.1, 0.0, 0.0]
    path.write_text("<robot><link name='a'><inertial><mass value='x'/></inertial></link></robot>")
    with pytest.raises(RbSimError, match="link a: mass or inertia is not as URDF has it"):
        masses_of(str(path))


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    pytest.importorskip("plotly", reason="plotly is not installed")
    folder = tmp_path_factory.mktemp("results")
    bag = foreign.write(folder / "bag")
    out = folder / "out"
    assert verb(AnalyzeOptions(bag, out, parquet=_has("pyarrow"))) == 0
    return out


def _has(module: str) -> bool:
    from importlib.util import find_spec

    return find_spec(module) is not None


def test_tables(results):
    t, p, _ = foreign.swing()
    with (results / "samples.csv").open() as file:
        heads, *rows = csv.reader(file)
    assert heads[:3] == ["t [s]", "/body.x [m]", "/body.y [m]"]
    values = np.array(rows, float)
    np.testing.assert_allclose(values[:, 1:4], p, atol=1e-15)
    np.testing.assert_allclose(values[:, 0], t, atol=3e-7)  # log times of 1.7e9 s have 2e-7
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(results / "samples.parquet")
    assert table.schema.field("/body.x").metadata[b"unit"] == b"m"
    assert json.loads(table.schema.metadata[b"units"])["t"] == "s"
    np.testing.assert_array_equal(table["/body.z"].to_numpy(), p[:, 2])


def test_the_report_stands_alone(results):
    page = results / "report.html"
    assert "inverse dynamics" not in page.read_text()  # no mass was given
    counts = "return Object.values(rb_sim.shared).map((shared) => shared.plots.length)"
    assert min(ask(page, counts)) >= 1
    fits = "return document.documentElement.scrollWidth - innerWidth"
    assert ask(page, fits, "--window-size=600,900") <= 0  # wide tables scroll by themselves


def test_numbers_are_never_folded(tmp_path):
    """At 80 columns each number of the table stands in one line."""
    name, factor = "/a_body_with_a_rather_long_name/pose", 1.2345e-113
    t, p, q = foreign.swing()
    entries = ((t[k], name, *foreign.pose_stamped(t[k], factor * p[k], q[k])) for k in range(400))
    text = invoke("analyze", foreign.record(tmp_path / "bag", entries)).stdout
    for number in ("400", "100", "-6.172e-114", "6.172e-114"):
        assert f" {number} " in text


@pytest.mark.parametrize("count", [64, 301, 2047, 5000])
def test_a_short_recording_has_a_spectrum(count):
    """White noise of variance 1 has 2/rate of density; a sine its peak; what stands still none."""
    rng, rate = np.random.default_rng(1), 50.0
    t = np.arange(count) / rate
    values = np.c_[rng.normal(size=count), np.sin(2 * np.pi * 5.0 * t), 1.0 + 1e-14 * (t > 0.5)]
    figures = Figures(("noise", "sine", "constant"))
    figures.add(t, values)
    found = figures.spectrum()
    assert found is not None
    frequency, density = found
    assert np.trapezoid(density[:, 0], frequency) == pytest.approx(1.0, rel=0.35)
    reported = figures.as_dict()["values"]
    assert reported["sine"]["peak_frequency"] == pytest.approx(5.0, abs=rate / min(count, 2048))
    assert reported["constant"]["peak_frequency"] is None


@pytest.mark.parametrize("count", [500, 3000])
@pytest.mark.parametrize("jump", ["reset", "gap", "clock set back"])
def test_no_spectrum_reaches_across_a_jump(jump, count):
    """A sine has half its squared amplitude in its density, though it goes on 100 m higher."""
    t = np.arange(count) / 50.0
    wave = np.sin(2 * np.pi * 5.0 * t)[:, None]
    start = {"reset": t[-1] + 0.02, "gap": t[-1] + 2.0, "clock set back": 0.0}[jump]
    both, values = np.concatenate([t, start + t]), np.concatenate([wave, 100.0 + wave])
    figures = Figures(("x",))
    if jump == "reset":
        figures.add(t, wave)
        figures.begin_anew()
        figures.add(start + t, 100.0 + wave)
    else:
        figures.add(both[:200], values[:200])
        figures.add(both[200:], values[200:])
    frequency, density = figures.spectrum()
    assert np.trapezoid(density[:, 0], frequency) == pytest.approx(0.5, rel=0.02)
    assert figures.as_dict()["values"]["x"]["peak_frequency"] == pytest.approx(5.0, abs=0.1)


def test_few_samples_have_no_spectrum():
    figures = Figures(("x",))
    figures.add(np.arange(63) / 50.0, np.arange(63.0)[:, None])
    assert figures.spectrum() is None


@pytest.mark.parametrize("jitter", [0.0, 1e-6, 1e-5, 1e-4, 1e-3, 4e-3])
def test_samples_that_are_not_even(jitter):
    """A swing seen at uneven instants has the accelerations that it has."""
    from rb_sim.bags.analysis.derivatives import differentiated

    t = np.arange(400) / 100 + np.random.default_rng(0).uniform(0, jitter, 400)
    q = np.c_[0 * t, 0 * t, np.sin(0.4 * t), np.cos(0.4 * t)]
    motion = differentiated(t, np.c_[0.5 * np.sin(3 * t), t, 0 * t], q, np.zeros(3))
    assert motion is not None
    exact = -4.5 * np.sin(3 * motion.t)
    assert np.abs(motion.acceleration[:, 0] - exact).max() < 2e-5
    assert np.abs(motion.turning).max() < 2e-5


def test_noise_of_the_poses_is_reported():
    """1 mm at 100 Hz is an acceleration of 0.3 * 1e-3 * 1e4 m/s^2 and more than the swing's."""
    t, p, q = foreign.swing(4000)
    rng = np.random.default_rng(3)
    figures = BodyFigures(CUBE)
    figures.add(t, np.c_[p + rng.normal(0, 3e-3, p.shape), q])
    figures.finish()
    (note,) = figures.notes
    assert note.startswith("acceleration from poses is mostly noise")
    reported = float(note.split("mostly noise: ")[1].split()[0])
    wrench = figures.wrench.as_dict()["values"]
    exact = 4.5 * np.sin(3.0 * t[4:-4])
    true = np.hypot(*(wrench[k]["rms"] / CUBE.mass for k in ("Fy", "Fz")))  # these are all noise
    assert reported == pytest.approx(true * np.sqrt(1.5), rel=0.1)
    assert np.sqrt(np.mean(exact**2)) < reported
    quiet = BodyFigures(CUBE)
    quiet.add(t, np.c_[p, q])
    quiet.finish()
    assert quiet.notes == []
