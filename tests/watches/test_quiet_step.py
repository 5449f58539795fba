"""The step that a run's warnings name has been tried: it ends them, on scenes of several kinds."""

from __future__ import annotations

import re
from typing import Any

import pytest

from rb_sim import Simulation, load_scene
from rb_sim.cli.run import RunOptions
from rb_sim.cli.run import run as command
from rb_sim.watches import quiet_step as search
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.finding import Finding
from rb_sim.watches.watch_list import WatchList

W = 1e3
"""Frequency of the oscillator [rad/s]."""

OSCILLATOR = {
    "bodies": {"bob": {"mass": 1.0, "inertia": [0.1] * 3, "position": [0.01, 0.0, 0.0]}},
    "effects": {
        "spring": {"type": "spring", "body": "bob", "stiffness": W * W, "rest_length": 0.0}
    },
    "simulation": {"duration": 0.4, "rate": 250},
}
SPINNER = {
    "bodies": {"wheel": {"mass": 1.0, "inertia": [1, 1, 2], "angular_velocity": [0, 0, 40]}},
    "simulation": {"duration": 2.0, "rate": 50},
}
DRAGGED = {
    "bodies": {"ball": {"mass": 1.0, "inertia": [1, 1, 1], "linear_velocity": [3.0, 0, 0]}},
    "effects": {"air": {"type": "linear_drag", "body": "ball", "coefficient": 8.0}},
    "simulation": {"duration": 2.0, "rate": 200},
}
TWO_ARMS = {
    "bodies": {
        "upper": {
            "mass": 1.0,
            "inertia": [0.1, 0.1, 0.01],
            "center_of_mass": [0.0, 0.0, -0.5],
            "orientation": {"axis": [0.0, 1.0, 0.0], "angle": 2.0},
        },
        "lower": {
            "mass": 1.0,
            "inertia": [0.1, 0.1, 0.01],
            "center_of_mass": [0.0, 0.0, -0.5],
            "position": [-0.9092974268256817, 0.0, 0.4161468365471424],
        },
    },
    "constraints": {
        "shoulder": {
            "type": "fixed_axis",
            "body": "upper",
            "axis_B": [0.0, 1.0, 0.0],
            "bearing_distance": 0.2,
        },
        "elbow": {
            "type": "fixed_axis",
            "body": "lower",
            "parent": "upper",
            "axis_B": [0.0, 1.0, 0.0],
            "bearing_distance": 0.2,
        },
    },
    "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    "simulation": {"duration": 5.0, "rate": 100},
}


def told(capfd: pytest.CaptureFixture[str], scene: Any, **how: Any) -> list[str]:
    """The lines of warning of a run on the command line."""
    command(RunOptions(scene, quiet=True, **how))
    return [line for line in capfd.readouterr().err.splitlines() if line.startswith("warning")]


@pytest.mark.parametrize(
    ("scene", "method", "step", "watch"),
    [
        ("heavy_top", "rk4", 0.004, "energy"),
        ("heavy_top", "gauss6", 0.02, "momentum"),
        ("pendulum", "euler", 0.05, "momentum"),
        ("free_tumble", "rk4", 0.5, "angular momentum"),
        (OSCILLATOR, "gauss6", 0.004, "step"),
        (OSCILLATOR, "euler", 4e-4, "step"),
        (SPINNER, "rk4", 0.1, "turn"),
        (DRAGGED, "euler", 0.05, "step"),
        (TWO_ARMS, "rk4", 0.05, "energy"),
    ],
)
def test_the_step_named_ends_every_warning(
    capfd: pytest.CaptureFixture[str],
    tmp_path: Any,
    scene: Any,
    method: str,
    step: float,
    watch: str,
) -> None:
    if isinstance(scene, dict):
        file = tmp_path / "scene.yaml"
        file.write_text(load_scene(scene).text, encoding="utf-8")
        scene = str(file)
    lines = told(capfd, scene, method=method, step=step)
    assert any(line.startswith(f"warning: {watch}: ") for line in lines), lines
    named = {float(re.findall(r"with step ([0-9.e-]+) s this warning", line)[0]) for line in lines}
    assert len(named) == 1
    (finer,) = named
    assert finer <= 0.5 * step
    assert told(capfd, scene, method=method, step=finer) == []


def watched(scene: dict[str, Any], **how: Any) -> tuple[Simulation, tuple[Finding, ...]]:
    """A run to its end, and what its watches found."""
    simulation = Simulation(load_scene(scene, **how), announce=None)
    watches = WatchList(simulation.scene, simulation.layout)
    options = simulation.scene.simulation
    for block in simulation.blocks(options.duration, options.rate):
        watches.add(block, effort_of(simulation))
    watches.finish()
    return simulation, watches.findings


@pytest.mark.parametrize(
    ("good", "expected"),
    [
        (lambda step: step <= 1e-3, "with step 0.001 s this warning does not come"),
        (lambda step: step >= 8e-3, "smaller steps do not end it; with step 0.008 s it does not"),
        (lambda step: False, "s do not end it; use method dopri853 with a tolerance"),
    ],
)
def test_smaller_is_not_said_where_it_does_not_help(
    monkeypatch: pytest.MonkeyPatch, good: Any, expected: str
) -> None:
    simulation, findings = watched(OSCILLATOR, method="gauss6", step=0.004)

    def quiet(self: Any, step: float) -> bool:
        self.loud += [] if good(step) else [step]
        return good(step)

    monkeypatch.setattr(search._Trials, "quiet", quiet)
    assert expected in search.quiet_step(simulation, findings)


def test_a_step_that_could_not_be_tried_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, findings = watched(OSCILLATOR, method="gauss6", step=0.004)
    said = search.quiet_step(simulation, findings, lambda: False)
    assert "not tried" in said and f"step {min(f.finer_step or 1.0 for f in findings):g} s" in said


def test_no_step_is_named_where_none_is_to_blame() -> None:
    simulation, findings = watched(OSCILLATOR, method="rk4", step=1e-4)
    assert findings == () and search.quiet_step(simulation, findings) == ""
