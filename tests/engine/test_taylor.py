"""Taylor's method: its series, steps and error against closed forms and other families."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.errors import SceneError
from tests.engine.series.test_hinge_torque import HINGED, SERIES
from tests.interpreted import interpreted, trajectory
from tests.one_body_scenes import EFFECTS, JOINTS, WEIGHT, rolling

CONFIG = Path(__file__).resolve().parents[2] / "config"
CLOSED = ("pendulum", "rolling_sphere", "free_tumble")
"""Shipped scenes with a series and a closed form."""
BALL = rolling({"type": "sphere", "radius": 0.2}) | {"effects": {"weight": WEIGHT}}
BALL["bodies"]["body"] |= {"center_of_mass": [0.0, 0.0, 0.0], "inertia": [0.03, 0.03, 0.03]}
PUSH = {"type": "wrench", "body": "body", "force": [1.0, -2.0, 1.5], "torque": [0.1, 0.2, -0.15]}
PUSHED_BALL = BALL | {"effects": {"weight": WEIGHT, "push": PUSH}}
RUNS = {f"fixed_axis, {name}": HINGED | {"effects": effects} for name, effects in SERIES.items()}
LEVEL = {"normal_A": [0.0, 0.0, 1.0], "point_A": [0.0, 0.0, -0.2]}
DISK = rolling({"type": "disk", "radius": 0.2, "axis_B": [1.0, 0.0, 0.0]})
DISK |= {"effects": {"weight": WEIGHT | {"acceleration": [0.0, 0.0, -9.7]}}}
DISK["constraints"]["joint"] |= LEVEL
DISK["bodies"]["body"] |= {"center_of_mass": [0.0, 0.0, 0.0], "inertia": [0.05, 0.03, 0.03]}
DISK["bodies"]["body"] |= {"angular_velocity": [9.0, 1.5, -1.0]}
RUNS |= {"ball": BALL, "pushed ball": PUSHED_BALL, "disk": DISK}
RUNS |= {name: JOINTS[name] | {"effects": {"weight": WEIGHT}} for name in ("free", "fixed_point")}
"""One scene per kind of series."""


def increments(name: str, spans: list[float]) -> tuple[list[Any], list[Any]]:
    """y(h) - y(0) of a shipped scene for each h by one series of the highest order, and exactly."""
    from rb_sim.accuracy.closed_forms import closed_form
    from rb_sim.engine.methods.method import increment
    from rb_sim.engine.methods.taylor import AdaptiveTaylor
    from rb_sim.scene.compile import compile_scene

    compiled = compile_scene(load_scene(CONFIG / f"{name}.yaml"))
    exact = closed_form(compiled)
    assert exact is not None
    method, y = AdaptiveTaylor(1e-16, 1.0), compiled.y
    found = [increment(method, compiled.system, 0.0, y, h, ()) for h in spans]
    return found, (exact.coordinates(np.array(spans)) - np.array(y)).tolist()


@pytest.mark.parametrize("name", CLOSED)
def test_series_sums_to_the_closed_form(name: str) -> None:
    """Well inside the radius of convergence, to the rounding of the coordinates."""
    found, exact = interpreted(increments, name, [0.0, 1e-3, 0.01, 0.03, 0.1, 0.2])
    assert_allclose(found, exact, rtol=0.0, atol=4e-16)
    assert np.abs(exact).max() > 1e-3


def pose_errors(name: str, tolerances: list[float]) -> list[float]:
    """Largest error of the coordinates over 3 s, sampled off the steps."""
    from rb_sim.accuracy.closed_forms import closed_form
    from rb_sim.engine.grid import start_grid
    from rb_sim.engine.integrate import record
    from rb_sim.engine.methods.taylor import AdaptiveTaylor
    from rb_sim.scene.compile import compile_scene

    compiled = compile_scene(load_scene(CONFIG / f"{name}.yaml"))
    exact = closed_form(compiled)
    assert exact is not None
    times = np.linspace(0.0, 3.0, 101)
    worst = []
    for tolerance in tolerances:
        method, grid, error = AdaptiveTaylor(tolerance, 3.0), start_grid(0.0, compiled.y), 0.0
        for t, y in zip(times, exact.coordinates(times), strict=True):
            out = np.zeros((0, 0))
            grid, _, _ = record(
                method, compiled.system, grid, np.array([t]), math.inf, False, out, ()
            )
            error = max(error, float(np.abs(np.array(grid.y) - y).max()))
        worst.append(error)
    return worst


@pytest.mark.parametrize("name", CLOSED)
def test_tolerance_is_kept(name: str) -> None:
    """3 s are some 30 steps, each within the tolerance; the pendulum near the top multiplies it."""
    tolerances = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14]
    worst = np.array(interpreted(pose_errors, name, tolerances))
    growth = {"pendulum": 1e3}.get(name, 30.0)
    assert np.all(worst <= growth * np.array(tolerances) + 3e-13), worst
    assert np.all(np.diff(worst) < 0.0)


@pytest.mark.parametrize("name", RUNS)
def test_same_motion_as_a_method_of_another_family(name: str) -> None:
    """State and reactions at samples off the steps."""
    options = {"duration": 1.5, "rate": 37.0}
    ours = trajectory(RUNS[name], method="taylor", tolerance=1e-15, **options)
    other = trajectory(RUNS[name], method="dopri853", tolerance=1e-14, **options)
    for field in ("position", "orientation", "linear_velocity", "angular_velocity", "anchor"):
        a, b = getattr(ours, field), getattr(other, field)
        assert_allclose(
            a, b, rtol=0.0, atol=2e-12 * (1.0 + np.abs(b).max(initial=0.0)), err_msg=field
        )
    size = 1.0 + np.abs(other.reaction_force).max(initial=0.0)
    assert_allclose(ours.reaction_force, other.reaction_force, rtol=0.0, atol=1e-11 * size)
    assert ours.residual.max() <= 1e-12


def split_states(mapping: Any, pieces: tuple[float, ...]) -> tuple[int, list[Any]]:
    """Steps, and state and reactions at the end of a run made in these pieces."""
    simulation = Simulation(load_scene(mapping))
    for piece in pieces:
        simulation.advance(piece)
    last = simulation.sample().block
    names = ("position", "orientation", "linear_velocity", "angular_velocity", "reaction_force")
    return simulation.steps, [simulation.time, *(getattr(last, n).tolist() for n in names)]


@pytest.mark.parametrize("name", ["fixed_axis, several", "pushed ball", "disk", "fixed_point"])
def test_run_split_in_two_is_the_run_in_one(name: str) -> None:
    """Bit for bit, with the cuts off the grid of steps."""
    options = {"method": "taylor", "tolerance": 1e-9, "project_initial": True}
    mapping = RUNS[name] | {"simulation": options}
    whole = interpreted(split_states, mapping, (1.5,))
    cut = interpreted(split_states, mapping, (0.25, 0.125, 0.625, 0.5))
    assert cut == whole and whole[0] > 2


@pytest.mark.parametrize("spin", [0.0, 5.0])
def test_a_motion_whose_series_ends_takes_one_step(spin: float) -> None:
    """At rest and turning evenly: no term is left that would limit the step."""
    body = HINGED["bodies"]["body"] | {"linear_velocity": [0.0, 0.0, 0.0]}
    body |= {"angular_velocity": [spin, 0.0, 0.0]}
    options = {"method": "taylor", "tolerance": 1e-12, "duration": 50.0, "project_initial": True}
    mapping = HINGED | {"bodies": {"body": body}, "effects": {}, "simulation": options}
    _, start = interpreted(split_states, mapping, (0.0,))
    steps, end = interpreted(split_states, mapping, (50.0,))
    assert steps == 1
    assert (np.abs(end[4]).max() == 0.0) == (spin == 0.0)
    assert_allclose(end[4], start[4], rtol=1e-15)


def commanded() -> tuple[list[float], list[float]]:
    """The end of a run with a command given on the way, by two methods."""
    ends = []
    for method in ("taylor", "dopri853"):
        options = {"method": method, "tolerance": 1e-14, "project_initial": True}
        mapping = RUNS["fixed_axis, command"] | {"simulation": options}
        simulation = Simulation(load_scene(mapping))
        simulation.advance(0.3)
        simulation.apply_wrench("body", [1.0, 2.0, -1.0], [0.3, 0.1, 0.2])
        simulation.advance(0.4)
        simulation.apply_wrench("body", [1.0, 2.0, -1.0], [0.3, 0.1, 0.2], "body")
        simulation.advance(0.4)
        ends.append(simulation.sample().block.orientation[0, 0].tolist())
    return ends[0], ends[1]


def test_commands_begin_a_new_series() -> None:
    ours, other = interpreted(commanded)
    assert_allclose(ours, other, rtol=0.0, atol=1e-13)


UNSUITED = {
    "N bodies": (RUNS["ball"], "maximal"),
    "free under a load": (JOINTS["free"], "auto"),
    "top under a load": (JOINTS["fixed_point"], "auto"),
    "uneven sphere": (JOINTS["rolling sphere"], "auto"),
    "uneven disk": (JOINTS["rolling disk"], "auto"),
    "disk on a slope": (DISK | {"effects": {"weight": WEIGHT}}, "auto"),
    "ellipsoid": (JOINTS["rolling ellipsoid"], "auto"),
    "force at a point of the ball": (
        BALL | {"effects": {"push": PUSH | {"point_B": [0.1, 0.0, 0.0]}}},
        "auto",
    ),
    "harmonic": (HINGED | {"effects": {"drive": EFFECTS["harmonic wrench"]}}, "auto"),
    "table": (HINGED | {"effects": {"drive": EFFECTS["wrench_table"]}}, "auto"),
}


@pytest.mark.parametrize("name", UNSUITED)
def test_a_scene_without_a_series_is_refused_in_one_line(name: str) -> None:
    mapping, coordinates = UNSUITED[name]
    scene = load_scene(mapping, method="taylor")
    message = r"simulation\.method: got 'taylor'; must be dopri853, auto or"
    with pytest.raises(SceneError, match=message) as caught:
        Simulation(scene, coordinates=coordinates)
    assert "\n" not in str(caught.value)


def test_a_tolerance_is_needed() -> None:
    with pytest.raises(SceneError, match="left out for method taylor"):
        load_scene(HINGED, method="taylor", step=0.01)
