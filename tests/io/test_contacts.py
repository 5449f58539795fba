# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contacts in bag, topics, recording and plots: states, work and events, made up but consistent."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import mcap.reader
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.bag.reader import BagReader
from rb_sim.io.run_plots import PlotSink
from rb_sim.mechanics.samples import (
    ARRAYS,
    ContactEvent,
    SampleBlock,
    SampleLayout,
    concatenate,
    empty_block,
)
from rb_sim.scene.load import load_scene

SCENE = {
    "bodies": {
        "ball": {"mass": 1, "shape": {"type": "sphere", "radius": 0.1}, "position": [0, 0, 0.5]},
        "bar": {"mass": 2, "shape": {"type": "rod", "length": 0.4}, "position": [0, 0, 1]},
    },
    "constraints": {
        "floor": {"type": "contact", "body": "ball"},
        "feet": {
            "type": "contact",
            "body": "bar",
            "parent": "ball",
            "surface": {"type": "sphere", "radius": 0.1},
            "points": [[0, 0, -0.2], [0, 0, 0.2]],
        },
    },
}
LAYOUT = SampleLayout(
    bodies=("ball", "bar"),
    reactions=("floor", "feet", "feet/1", "feet/2"),
    reaction_bodies=("ball", "bar", "bar", "bar"),
    commanded=(),
    contacts=("floor", "feet/1", "feet/2"),
)
EVENTS = (
    ContactEvent(0.0, "feet/2", "slips"),
    ContactEvent(0.123456789012345, "floor", "impact", (0.1, -1e-17, 1 / 3)),
    ContactEvent(0.123456789012345, "floor", "closes"),
    ContactEvent(0.35, "feet/1", "stops rolling"),
    ContactEvent(0.99 + 1e-8, "feet/2", "rests"),  # announced, just after the last sample
)
START = 1_700_000_000_000_000_000
RERUN = Path(sys.executable).with_name("rerun")


@pytest.fixture
def scene():
    return load_scene(SCENE)


def blocks(size: int = 30) -> list[SampleBlock]:
    """100 samples, 10 ms apart, in blocks; events in the block whose samples they precede."""
    t = np.arange(100) / 100.0
    whole = empty_block(100, LAYOUT)
    wave = np.sin(np.multiply.outer(t, np.arange(1.0, 13.0)))
    whole.t[:] = t
    whole.orientation[..., 3] = 1.0
    whole.position[:, 0], whole.position[:, 1] = wave[:, :3], wave[:, 3:6]
    whole.anchor[:] = wave.reshape(100, 4, 3)
    whole.reaction_force[:] = 2.0 * wave.reshape(100, 4, 3)
    whole.contact_work[:] = -wave[:, 0]
    whole.contact_state[:] = np.c_[t > 0.123, 2 * (t > 0.35), np.ones(100)]
    found, before = [], -1.0
    for first in range(0, 100, size):
        part = {name: getattr(whole, name)[first : first + size] for name in ARRAYS}
        last = float(part["t"][-1])
        events = [e for e in EVENTS if before < e.t <= last + (last > 0.98)]
        found.append(SampleBlock(**part, events=tuple(events)))
        before = last
    return found


def record(folder: Path, scene) -> Path:
    sink = BagSink(folder / "bag", start_ns=START)
    sink.open(scene, LAYOUT)
    for block in blocks():
        sink.write(block)
    sink.close()
    return folder / "bag"


@pytest.mark.parametrize("size", [1000, 13])
def test_a_bag_gives_back_states_work_and_events(tmp_path, scene, size):
    reader = BagReader(record(tmp_path, scene))
    assert reader.layout == LAYOUT
    read = list(reader.blocks(size))
    found, expected = concatenate(read, LAYOUT), concatenate(blocks(), LAYOUT)
    assert found.events == expected.events == EVENTS
    np.testing.assert_array_equal(found.contact_state, expected.contact_state)
    np.testing.assert_array_equal(found.contact_work, expected.contact_work)
    np.testing.assert_array_equal(found.anchor, expected.anchor)
    np.testing.assert_array_equal(found.reaction_force, expected.reaction_force)
    for block in read[:-1]:
        assert all(event.t <= block.t[-1] for event in block.events)
    surface = reader.scene.constraints["feet"].surface
    assert (surface.type, surface.radius, surface.side) == ("sphere", 0.1, "outside")
    assert reader.scene.constraints["feet"].parent == "ball"


def test_rosbags_finds_the_events_at_their_instants(tmp_path, scene):
    bag = record(tmp_path, scene)
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        kinds = {c.topic: c.msgtype.split("/")[-1] for c in reader.connections}
        chosen = [c for c in reader.connections if c.topic == "/rb_sim/contact_events"]
        found = [(t, reader.deserialize(data, c.msgtype)) for c, t, data in reader.messages(chosen)]
    assert kinds["/rb_sim/contacts/floor/state"] == "UInt8"
    assert kinds["/rb_sim/contacts/feet/point_2/state"] == "UInt8"
    assert kinds["/rb_sim/reactions/feet/point_1"] == "WrenchStamped"
    assert kinds["/rb_sim/contact_work"] == "Float64"
    assert kinds["/rb_sim/contact_events"] == "DiagnosticArray"
    log_time: int
    message: Any
    for (log_time, message), event in zip(found, EVENTS, strict=True):
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert stamp == round(event.t * 1e9)
        assert log_time == START + min(stamp, 990_000_000)
        (status,) = message.status
        assert (status.name, status.message) == (event.contact, event.kind)
        values = {pair.key: float(pair.value) for pair in status.values}
        assert values["t"] == event.t
        assert tuple(values[f"impulse_{axis}"] for axis in "xyz") == event.impulse


def test_a_bag_without_contacts_does_not_mention_them(tmp_path):
    scene = load_scene({"bodies": {"b": {"mass": 1, "inertia": [1, 1, 1]}}})
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, SampleLayout(("b",), (), (), ()))
    sink.close()
    with (tmp_path / "bag/bag_0.mcap").open("rb") as file:
        reader = mcap.reader.make_reader(file)
        (record,) = [m for m in reader.iter_metadata() if m.name == "rb_sim"]
        summary = reader.get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert "contact" not in record.metadata["layout"] and "contacts" not in record.metadata
    assert not [topic for topic in topics if "contact" in topic]


def test_a_reset_shifts_the_events_with_the_samples(tmp_path, scene):
    sink = BagSink(tmp_path / "bag", start_ns=START)
    sink.open(scene, LAYOUT)
    for block in (*blocks(100), *blocks(100)):
        sink.write(block)
    sink.close()
    with (tmp_path / "bag/bag_0.mcap").open("rb") as file:
        messages = mcap.reader.make_reader(file).iter_messages(log_time_order=False)
        times = [(c.topic, m.log_time) for _, c, m in messages]
    assert [t for _, t in times] == sorted(t for _, t in times)
    events = [t - START for topic, t in times if topic == "/rb_sim/contact_events"]
    # the second run's clock begins where the first one ended
    np.testing.assert_array_equal(np.array(events[5:]) - events[:5], 990_000_000)


@pytest.mark.skipif(not RERUN.exists(), reason="rerun-sdk is not installed")
def test_recording_shows_states_points_supports_and_events(tmp_path, scene):
    from rb_sim.io.rerun.rerun_sink import RerunSink
    from tests.io.test_rerun import column

    sink = RerunSink(tmp_path / "r.rrd")
    sink.open(scene, LAYOUT)
    for block in blocks():
        sink.write(block)
    sink.close()
    run = [str(RERUN), "rrd", "stats", str(sink.path)]
    stats = subprocess.run(run, check=True, capture_output=True, text=True, timeout=240).stdout
    for entity in (
        "/world/support/floor/planes/0",
        "/world/ball/support/feet/solids/0",
        "/world/contact/feet/1",
    ):
        assert f"{entity}:" in stats, entity
    whole = concatenate(blocks(), LAYOUT)
    _, states = column(sink.path, "/plots/contacts/feet/1", "Scalars:scalars")
    np.testing.assert_array_equal(np.array(states)[:, 0], whole.contact_state[:, 1])
    _, points = column(sink.path, "/world/contact/feet/1", "Points3D:positions")
    closed = np.array([bool(row) for row in points])
    np.testing.assert_array_equal(closed, whole.contact_state[:, 1] > 0)
    shown = np.array([row[0] for row in points if row])
    np.testing.assert_allclose(shown, whole.anchor[closed, 2], atol=1e-6)  # single precision
    times, texts = column(sink.path, "/events", "TextLog:text")
    assert times.tolist() == [round(event.t * 1e9) for event in EVENTS]
    assert texts[1] == ["t = 0.123456789 s: floor impact, impulse 0.348 N s"]


def test_plots_show_states_and_impacts(tmp_path, scene, monkeypatch):
    from matplotlib.colors import to_hex

    from rb_sim.base.palette import SLIPPING, STICKING
    from rb_sim.io import run_plots as plots

    drawn = {}
    original = plots.draw_contact

    def draw_contact(ax, contacts, c):
        original(ax, contacts, c)
        drawn[contacts.names[c]] = ax

    monkeypatch.setattr(plots, "draw_contact", draw_contact)
    sink = PlotSink(tmp_path / "plots.png")
    sink.open(scene, LAYOUT)
    for block in blocks():
        sink.write(block)
    sink.close()
    assert set(drawn) == set(LAYOUT.contacts)
    (legend,) = drawn["floor"].figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names[-3:] == ["slips", "sticks or rolls", "impact"]
    colors = {
        name: [to_hex(color).upper() for strip in ax.collections for color in strip.get_facecolor()]
        for name, ax in drawn.items()
    }
    assert colors == {"floor": [SLIPPING], "feet/1": [STICKING], "feet/2": [SLIPPING]}
    spans = {name: _spans(ax) for name, ax in drawn.items()}
    np.testing.assert_allclose(spans["floor"], [(0.13, 0.99)])
    np.testing.assert_allclose(spans["feet/1"], [(0.36, 0.99)])
    np.testing.assert_allclose(spans["feet/2"], [(0.0, 0.99)])
    assert drawn["floor"].get_lines()[-1].get_xdata().tolist() == [EVENTS[1].t]


def _spans(ax) -> list[tuple[float, float]]:
    """From and to of each piece of the strips."""
    paths = [path.vertices[:, 0] for strip in ax.collections for path in strip.get_paths()]
    return [(float(x.min()), float(x.max())) for x in paths]


def test_the_work_of_an_impact_is_in_the_plot_of_work(scene):
    """Energy jumps by the work of the contact at an impact; no power tells it."""
    from rb_sim.io.panels import Balance

    whole = concatenate(blocks(), LAYOUT)
    jump = np.where(whole.t > 0.123, -0.75, 0.0)
    block = replace(
        whole,
        contact_work=jump,
        kinetic_energy=2.0 + jump,
        potential_energy=np.zeros(100),
        reaction_force=np.zeros((100, 4, 3)),
    )
    change, work = Balance(scene, LAYOUT)(block).T
    np.testing.assert_allclose(change, work, atol=1e-15)
