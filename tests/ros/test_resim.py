"""What the real node recorded, simulated again: held commands in body axes, a reset, a timeout."""

from __future__ import annotations

from pathlib import Path

from rb_sim.cli.verbs.resim import ResimOptions, resim
from tests.ros.client import Client
from tests.ros.test_commands import TURNED


def test_the_same_bits(start, client: Client, tmp_path: Path, capsys):
    scene = tmp_path / "turned.yaml"
    scene.write_text(TURNED)
    logs = {"log_rerun": False, "log_plots": False}
    node = start(scene, out=tmp_path, start_paused=True, wrench_timeout=0.05, **logs)
    client.send(force=(4, 0, 1), torque=(0.1, 0.2, 0.3), frame="ball")
    for _ in range(8):
        client.trigger("step")
    client.trigger("reset")
    client.send(force=(0, 1, 0), torque=(0.1, 0, 0))
    for _ in range(4):
        client.trigger("step")
    assert node.stop() == 0
    assert resim(ResimOptions(tmp_path / "bag")) == 0
    assert "14 of 14 samples are identical" in capsys.readouterr().out
