# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A method, a constraint: one file and one line. Heun's and a prismatic joint are added here."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

PROGRAM = """
from rb_sim.mechanics.methods import METHODS, MethodEntry
from tests.mechanics.heun import Heun, heun

METHODS["heun"] = MethodEntry(Heun, None, 2, "Heun's method", loop=heun)

from rb_sim import Simulation, load_scene
import math

def error(steps, coordinates):
    # x = cos 2 t on a spring without rest length
    ball = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [1.0, 0.0, 0.0]}
    scene = {
        "bodies": {"ball": ball},
        "effects": {"spring": {"type": "spring", "body": "ball", "stiffness": 4.0}},
        "simulation": {"method": "heun", "step": 1.0 / steps, "duration": 1.0},
    }
    simulation = Simulation(load_scene(scene), coordinates=coordinates)
    simulation.advance(1.0)
    return abs(simulation.sample().position["ball"][0, 0] - math.cos(2.0))

for coordinates in ("auto", "maximal"):
    coarse, fine = error(100, coordinates), error(200, coordinates)
    print(math.log2(coarse / fine))
"""

JOINT = """
from rb_sim.catalogue.constraints import SPECS
from tests.mechanics.prismatic import Prismatic

SPECS["prismatic"] = Prismatic

from rb_sim import Simulation, load_scene

slide = {"type": "prismatic", "body": "block", "axis_A": [0.8, 0.0, -0.6]}
scene = {
    "bodies": {"block": {"mass": 2.0, "inertia": [0.1, 0.2, 0.3]}},
    "constraints": {"slide": slide},
    "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -10.0]}},
    "simulation": {"method": "rk4", "step": 0.01},
}
simulation = Simulation(load_scene(scene))
simulation.advance(1.0)
end = simulation.sample()
print(*end.position["block"][0], *end.reaction["slide"].force[0])
"""


def printed(program: str) -> list[float]:
    """The numbers that a program prints, in a process of its own."""
    environment = os.environ | {"RB_SIM_INTERPRETED": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def test_heuns_method_is_one_file_and_one_line() -> None:
    """Named by a scene, in both kinds of coordinates, it converges with its order."""
    orders = printed(PROGRAM)
    assert len(orders) == 2
    assert all(abs(order - 2.0) < 0.05 for order in orders), orders


def test_a_prismatic_joint_is_one_file_and_one_line() -> None:
    """Down a slope of 3 : 4: a = g sin, and what presses is m g cos, normal to the way."""
    found = printed(JOINT)
    assert found == pytest.approx([2.4, 0.0, -1.8, 9.6, 0.0, 12.8], abs=1e-12)
