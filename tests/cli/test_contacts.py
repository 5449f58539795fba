# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim run` of scenes with contact: events, impulses, and a balance that sees impacts."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from rb_sim.accuracy.checks.balance import Ledger
from rb_sim.mechanics.samples import ContactEvent, SampleLayout, empty_block
from rb_sim.scene.load import load_scene
from tests.cli.process import invoke

BOUNCE = """\
bodies:
  ball: {mass: 0.5, shape: {type: sphere, radius: 0.05}, position: [0, 0, 1.05]}
constraints:
  floor: {type: contact, body: ball, restitution: 0.8}
effects:
  weight: {type: gravity, acceleration: [0, 0, -9.81]}
simulation: {duration: 1.5, rate: 50, tolerance: 1.0e-12}
"""


@pytest.fixture(scope="module")
def bounce(tmp_path_factory):
    """The command's output and summary.json: a ball dropped from h = 1 m, twice on the floor."""
    folder = tmp_path_factory.mktemp("bounce")
    (folder / "bounce.yaml").write_text(BOUNCE, encoding="utf-8")
    options = ("--out", folder, "--npz", folder / "all.npz", "--no-rerun", "--no-plots")
    done = invoke("run", folder / "bounce.yaml", *options)
    assert done.exit_code == 0, done.output
    return done, json.loads((folder / "summary.json").read_text()), folder


def test_summary_of_a_bouncing_ball(bounce):
    """v = sqrt(2 g h); impulses m (1 + e) v e^k; each takes (1 - e^2) of the kinetic energy."""
    _, summary, _ = bounce
    contacts, m, e, g = summary["contacts"], 0.5, 0.8, 9.81
    v = math.sqrt(2.0 * g)
    assert contacts["events"] == {"impact": 2}
    first, second = contacts["first_events"]
    assert (first["contact"], first["kind"]) == ("floor", "impact")
    assert first["t"] == pytest.approx(v / g, rel=1e-11)
    assert second["t"] == pytest.approx(v / g * (1.0 + 2.0 * e), rel=1e-11)
    np.testing.assert_allclose(first["impulse"], [0.0, 0.0, m * (1.0 + e) * v], atol=1e-11)
    total = m * (1.0 + e) * v * (1.0 + e)
    np.testing.assert_allclose(contacts["impulses"]["floor"], [0.0, 0.0, total], atol=1e-11)
    assert contacts["work"] == pytest.approx(-m * g * (1.0 - e**4), rel=1e-11)
    assert summary["energy"]["work"] == contacts["work"]
    assert summary["energy"]["relative"] < 1e-11
    assert summary["momentum"] is None
    assert summary["momentum_not_balanced_because_of"] == "floor"


def test_the_table_tells_what_happened(bounce):
    done, summary, _ = bounce
    text, contacts = done.stdout, summary["contacts"]
    for words in ("contact events", "2 impact", "t = 0.451523641 s: floor impact (3.987 N s)"):
        assert words in text
    assert "work of contacts" in text and "impact impulse" in text
    assert contacts["impacts_at_once"] == "together" and "together (simulation.impacts)" in text


def test_the_arrays_hold_the_events(bounce):
    _, summary, folder = bounce
    with np.load(folder / "all.npz") as columns:
        times = [event["t"] for event in summary["contacts"]["first_events"]]
        np.testing.assert_array_equal(columns["events.t"], times)
        assert columns["events.kind"].tolist() == ["impact", "impact"]
        assert columns["events.impulse"].shape == (2, 3)
        assert columns["contact_work"][-1] == summary["contacts"]["work"]
        assert set(columns["contact_state.floor"]) == {0.0}


def test_redundant_corners_are_said_to_be_undetermined(tmp_path):
    text = BOUNCE
    for old, new in (
        ("{type: sphere, radius: 0.05}, position: [0, 0, 1.05]",
         "{type: box, size: [0.2, 0.2, 0.2]}, position: [0, 0, 0.1]"),
        ("1.5, rate: 50, tolerance: 1.0e-12", "0.01, method: rk4, step: 0.01"),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "box.yaml").write_text(text, encoding="utf-8")
    options = ("--out", tmp_path, "--no-rerun", "--no-plots", "--no-bag")
    done = invoke("run", tmp_path / "box.yaml", *options)
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["indeterminate_reactions"] == ["floor/1", "floor/2", "floor/3", "floor/4"]
    assert "minimum-norm reactions reported" in " ".join(done.stdout.split())


@pytest.mark.parametrize(("bodies", "heap"), [(1, False), (2, True)])
def test_loads_that_a_heap_leaves_open_are_said_to_be_one_of_several(bodies, heap, tmp_path):
    """One box has the minimum-norm ones under time stepping, too; a stack may have others."""
    box = {"type": "box", "size": [1.0, 1.0, 0.2]}
    stack = {
        f"box{i}": {"mass": 1.0, "shape": box, "position": [0.0, 0.0, 0.1 + 0.2 * i]}
        for i in range(bodies)
    }
    contacts: dict[str, Any] = {"floor": {"type": "contact", "body": "box0"}}
    if heap:
        on = {"type": "contact", "body": "box1", "parent": "box0", "surface": {"type": "shape"}}
        contacts["on"] = on
    options = {"method": "time_stepping", "step": 0.001, "duration": 0.02}
    weight = {"weight": {"type": "gravity"}}
    scene = {"bodies": stack, "constraints": contacts, "effects": weight, "simulation": options}
    (tmp_path / "stack.yaml").write_text(yaml.safe_dump(scene), encoding="utf-8")
    done = invoke("run", tmp_path / "stack.yaml")
    assert done.exit_code == 0, done.output
    text = " ".join(done.stdout.split())
    assert ("load distribution one of the admissible distributions if" in text) is heap
    assert ("minimum-norm reactions reported" in text) is not heap


def test_counts_do_not_grow_with_the_run():
    """A thousand blocks of events: all are counted, ten are listed."""
    scene = load_scene(
        {
            "bodies": {"b": {"mass": 1, "shape": {"type": "sphere", "radius": 1}}},
            "constraints": {"floor": {"type": "contact", "body": "b"}},
        }
    )
    layout = SampleLayout(("b",), ("floor",), ("b",), (), ("floor",))
    ledger = Ledger(scene, layout)
    for k in range(1000):
        block = empty_block(1, layout)
        block.t[:] = k
        block.orientation[..., 3] = 1.0
        ledger.add(replace(block, events=(ContactEvent(k, "floor", "impact", (0.0, 0.0, 1.0)),)))
    reported = ledger.contacts()
    assert reported is not None
    assert reported["events"] == {"impact": 1000} and len(reported["first_events"]) == 10
    assert reported["impulses"] == {"floor": [0.0, 0.0, 1000.0]}
