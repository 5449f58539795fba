"""A motion so fast that one step passes pieces of a spline without end can be ended even so."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import math
import signal
from rb_sim import Simulation

def ended(number, frame):
    raise KeyboardInterrupt

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
simulation = Simulation(scene)
simulation.warm()
signal.signal(signal.SIGALRM, ended)
signal.alarm(2)
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
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.stdout.startswith("ended at"), done.stderr
