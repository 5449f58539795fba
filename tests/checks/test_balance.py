"""Balances of runs with known work and impulse."""

import numpy as np
import pytest

from benchmarks.contact.stick_slips import case
from rb_sim import Simulation, load_scene
from rb_sim.checks.balance import Ledger
from rb_sim.scene.listing import find_scene

DRAGGED = {
    "bodies": {
        "stone": {
            "mass": 2.0,
            "inertia": [0.1, 0.1, 0.1],
            "linear_velocity": [3.0, 0.0, 0.0],
        }
    },
    "effects": {"air": {"type": "linear_drag", "body": "stone", "coefficient": 1.0}},
    "simulation": {"duration": 2.0, "rate": 100, "method": "rk4", "step": 0.001},
}


def ledger_of(scene) -> Ledger:
    simulation = Simulation(scene)
    ledger = Ledger(scene, simulation.layout)
    options = scene.simulation
    for block in simulation.blocks(options.duration, options.rate):
        ledger.add(block)
    return ledger


def test_rolling_sphere_balances_energy_and_momentum():
    """Known force and torque, weight and the contact reaction: LL section 38 problem 1.

    Limit: the integrator's tolerance, 1e-13 per step, over some tens of steps.
    """
    ledger = ledger_of(load_scene(find_scene("rolling_sphere"), duration=1.0, tolerance=1e-13))
    energy, momentum = ledger.energy(), ledger.momentum()
    assert energy["work"] > 1e-2
    assert energy["relative"] < 1e-11
    assert momentum["linear"]["relative"] < 1e-11
    assert momentum["angular"]["relative"] < 1e-11


def test_offset_body_with_wrenches_in_body_axes():
    """A tumbling body, pushed at a point away from its offset centre of mass."""
    scene = load_scene(
        {
            "bodies": {
                "beam": {
                    "mass": 2.0,
                    "inertia": [0.1, 0.2, 0.25],
                    "center_of_mass": [0.1, -0.2, 0.3],
                    "position": [1.0, 2.0, 3.0],
                    "angular_velocity": [1.0, 2.0, 0.5],
                }
            },
            "effects": {
                "weight": {"type": "gravity"},
                "jet": {
                    "type": "wrench",
                    "body": "beam",
                    "frame": "body",
                    "point_B": [0.3, 0.1, -0.4],
                    "force": [0.5, -0.2, 0.7],
                    "torque": [0.1, 0.2, -0.3],
                },
            },
            "simulation": {"duration": 2.0, "rate": 200, "method": "rk4", "step": 0.001},
        }
    )
    ledger = ledger_of(scene)
    for balance in ledger.momentum().values():
        assert balance["relative"] < 1e-9
    assert ledger.energy()["relative"] < 1e-9


def test_drag_does_the_work_that_the_body_loses():
    """v = v0 exp(-c t / m), so E(0) - E = m v0^2 / 2 (1 - exp(-2 c t / m))."""
    ledger = ledger_of(load_scene(DRAGGED))
    energy = ledger.energy()
    assert energy["work"] == pytest.approx(-9.0 * (1.0 - np.exp(-2.0)), rel=1e-9)
    assert energy["relative"] < 1e-9
    assert ledger.unknown_force == "air"
    assert ledger.momentum() is None


def test_nothing_logged_balances_nothing():
    scene = load_scene(DRAGGED)
    ledger = Ledger(scene, Simulation(scene).layout)
    assert ledger.energy() is None and ledger.momentum() is None and ledger.end is None


@pytest.mark.parametrize("interpolation", ["hold", "linear"])
@pytest.mark.parametrize("rate", [100.0, 37.0])
def test_the_work_of_a_table_is_integrated_over_its_pieces(interpolation: str, rate: float):
    """Velocities are polynomials of each piece, so that work is exact whether a sample lies at a
    jump (100 Hz: at three of four) or not."""
    table = {
        "type": "wrench_table",
        "body": "stone",
        "interpolation": interpolation,
        "times": [0.05, 0.153, 0.3, 0.61],
        "forces": [[10, 0, 0], [-20, 5, 0], [3, 3, 3], [7, 0, 0]],
    }
    options = {"duration": 1.0, "rate": rate, "tolerance": 1e-12}
    mapping = {"bodies": DRAGGED["bodies"], "effects": {"push": table}, "simulation": options}
    energy = ledger_of(load_scene(mapping)).energy()
    assert energy is not None and energy["relative"] < 1e-14


def test_what_is_left_of_velocities_that_a_weld_takes_is_no_energy() -> None:
    """It is rounding, which a step then changes by all of it."""
    body = {
        "mass": 38.0,
        "inertia": [0.0406, 0.0586, 0.0463],
        "position": [0.1786, -0.2654, 0.1129],
        "orientation": {"axis": [-0.34, -0.51, -0.79], "angle": -1.76},
        "linear_velocity": [0.3332, 0.2893, 0.3382],
        "angular_velocity": [-2.036, 0.7815, -0.8538],
    }
    scene = {
        "bodies": {"block": body},
        "constraints": {"weld": {"type": "weld", "body": "block"}},
        "simulation": {
            "method": "rk4", "step": 0.1, "duration": 1.0, "rate": 10.0, "project_initial": True,
        },
    }  # fmt: skip
    run = Simulation(scene, announce=None).run()
    moved = np.abs([run.block.linear_velocity, run.block.angular_velocity]).max()
    assert 0.0 < moved < 1e-14
    assert run.findings == ()


def test_work_that_is_done_while_nobody_looks_is_none_that_is_lost() -> None:
    """A block that a growing force pulls sticks at each of three samples and slips between: the
    samples show no power, and nothing says that there was none."""
    run = Simulation(case(261127, 4, False).mapping, announce=None).run()
    assert not run.block.power.any() and run.block.energy[-1] > 100.0
    assert "energy" not in {finding.watch for finding in run.findings}
