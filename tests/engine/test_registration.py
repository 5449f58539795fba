"""A method is one file and one line: Heun's is added to the registry, and a scene may name it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

PROGRAM = """
from rb_sim.engine.methods.registry import METHODS, MethodEntry
from tests.engine.heun import Heun, heun

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


def test_heuns_method_is_one_file_and_one_line() -> None:
    """Named by a scene, in both kinds of coordinates, it converges with its order."""
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        text=True,
        env=environment,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    orders = [float(line) for line in done.stdout.split()]
    assert len(orders) == 2
    assert all(abs(order - 2.0) < 0.05 for order in orders), orders
