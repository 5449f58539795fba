# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A motion so fast that one step passes pieces of a spline without end can be ended even so."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest
from typer.testing import CliRunner

from rb_sim import Simulation
from rb_sim.base.errors import SimulationError
from rb_sim.cli.main import app
from rb_sim.scene import yaml_reader

RING = """
import math

around = [2.0 * math.pi * k / 32 for k in range(32)]
scene = {
    "bodies": {
        "bead": {
            "mass": 0.03,
            "inertia": [1e-3] * 3,
            "position": [1.0, 0.0, 0.0],
            "linear_velocity": [0.0, 1e10, 0.0],
        },
    },
    "constraints": {
        "wire": {
            "type": "translation",
            "body": "bead",
            "guide": {
                "type": "curve",
                "closed": True,
                "points": [[math.cos(a), math.sin(a), 0.0] for a in around],
            },
        },
    },
    "simulation": {
        "duration": 10.0, "rate": 100.0, "method": "rk4", "step": 4e-3, "project_initial": True,
    },
}
"""
SCRIPT = """
import signal
import rb_sim.motion.traced
from rb_sim import Simulation

# Without its own end, which a fast machine comes to before the signal does.
rb_sim.motion.traced.MOST_ROUNDS = 10**9

def ended(number, frame):
    raise KeyboardInterrupt

simulation = Simulation(scene)
simulation.warm()
signal.signal(signal.SIGALRM, ended)
signal.alarm(1)
try:
    simulation.run()
except KeyboardInterrupt:
    print("ended at", simulation.time)
"""


def test_a_signal_ends_a_run_that_passes_pieces_without_end() -> None:
    """A step of 4 ms is 4e7 m of a ring whose pieces are 0.2 m long: 2e8 parts, minutes in which
    nobody would be asked.  A motion that blows up on a wire comes to the same, but when and how
    hangs on its last digits, so on the machine."""
    done = subprocess.run(
        [sys.executable, "-c", RING + SCRIPT],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.stdout.startswith("ended at"), done.stderr


def ring() -> dict[str, Any]:
    """The scene of the script."""
    space: dict[str, Any] = {}
    exec(RING, space)
    return space["scene"]


def test_a_step_that_passes_pieces_without_end_is_an_error(monkeypatch) -> None:
    monkeypatch.setattr("rb_sim.motion.traced.MOST_ROUNDS", 4)
    with pytest.raises(SimulationError, match="8192 pieces of a guide .* too large"):
        Simulation(ring()).run()


def test_a_run_that_ends_in_its_first_step_keeps_what_was_logged(monkeypatch, tmp_path) -> None:
    """A sample was, and no step, so that none had a price: the summary divided by zero."""
    monkeypatch.setattr("rb_sim.motion.traced.MOST_ROUNDS", 4)
    scene, out = tmp_path / "ring.yaml", tmp_path / "out"
    mapping = ring()
    mapping["simulation"] |= {"duration": 1e-5, "rate": 1e7}
    scene.write_text(yaml_reader.write(mapping))
    told = CliRunner().invoke(app, ["run", str(scene), "--out", str(out), "--no-rerun"])
    assert told.exit_code == 1
    assert "8192 pieces of a guide" in " ".join(told.output.split())
    assert (out / "summary.json").exists()
