"""A motion that blows up on a spline passes pieces without end: its run can be ended even so."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import signal
from rb_sim import Simulation

def ended(number, frame):
    raise KeyboardInterrupt

scene = {
    "bodies": {
        "bead": {"mass": 0.03, "inertia": [1e-3] * 3, "position": [1.0, 0.0, 0.0]},
    },
    "constraints": {
        "wire": {
            "type": "translation",
            "body": "bead",
            "guide": {
                "type": "curve",
                "closed": True,
                "points": [[1, 0, 0], [0, 1, 0.3], [-1, 0, 0], [0, -1, 0.3]],
            },
        },
    },
    "effects": {
        "spring": {"type": "spring", "body": "bead", "stiffness": 4e4, "point_A": [0.3, 0.4, 0.0]},
    },
    "simulation": {"duration": 10.0, "rate": 100.0, "method": "rk4", "step": 4e-3},
}
simulation = Simulation(scene)
simulation.warm()
signal.signal(signal.SIGALRM, ended)
signal.alarm(5)
try:
    simulation.run()
except KeyboardInterrupt:
    print("ended at", simulation.time)
"""


def test_a_signal_ends_a_run_that_passes_pieces_without_end() -> None:
    """Steps of rk4 of 4.6 rad of the spring let its speed grow without bounds; a step that ends at
    every piece of the wire then has no end, and the loop must ask now and then."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.stdout.startswith("ended at"), done.stderr
