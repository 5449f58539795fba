"""The process that writes the logs, without a node that hears it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from rb_sim import Simulation, load_scene
from rb_sim.ros.logs.protocol import Begin, Block, End, Plan, frame


def test_plots_that_fail_after_the_node_has_gone_are_told(tmp_path: Path) -> None:
    """After a signal nobody waits for plots; what went wrong with them was told to nobody."""
    (tmp_path / "out").mkdir()
    scene = load_scene("heavy_top")
    simulation = Simulation(scene)
    simulation.advance(0.01)
    plan = Plan(tmp_path / "out", False, "", False, False, True, 0, {}, {})
    heard, answers = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-m", "rb_sim.ros.logs.writer"],
        stdin=subprocess.PIPE,
        stdout=answers,
        stderr=subprocess.PIPE,
        text=False,
    )
    os.close(answers)
    assert process.stdin is not None
    process.stdin.write(frame(Begin(plan, scene, simulation.layout)))
    process.stdin.write(frame(Block(simulation.sample().block)))
    process.stdin.flush()
    os.read(heard, 1)  # it has begun
    os.close(heard)
    (tmp_path / "out" / "plots.png").mkdir()  # where the picture is to be
    _, told = process.communicate(frame(End(None)), timeout=120)
    assert b"plots.png" in told, told
