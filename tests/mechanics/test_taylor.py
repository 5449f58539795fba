# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Taylor's method: its series, steps and error against closed forms and other families."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import TypeAdapter
from scipy.special import ellipj

from rb_sim import Simulation, load_scene
from rb_sim.accuracy.closed_forms import closed_form
from rb_sim.base.errors import SceneError, SimulationError
from rb_sim.catalogue.spec import UnitVector3
from rb_sim.compiler.graph.machine import compile_law
from rb_sim.compiler.graph.symbols import Graph, where
from rb_sim.compiler.graph.taylor_code import SeriesLaws
from rb_sim.integrate.methods.taylor import AdaptiveTaylor
from rb_sim.mechanics.laws import (
    AS_PENDULUM,
    IN_ANGLES,
    IN_WORLD_AXES,
    CompiledLaws,
    variables_of,
)
from rb_sim.motion.traced import TracedMotion, TracedStepper
from rb_sim.scene.compile import compile_scene
from tests.mechanics.test_guides import VALLEY, sliding
from tests.one_body_scenes import EFFECTS, INERTIA, JOINTS, ON_BODY, WEIGHT, Mapping
from tests.runs import trajectory

CONFIG = Path(__file__).resolve().parents[2] / "config"
CLOSED = ("pendulum", "rolling_sphere", "free_tumble")
"""Shipped scenes with a closed form."""
HINGED = JOINTS["fixed_axis, B floats"]
EPSILON = np.finfo(float).eps
RUNS = {f"hinge, {name}": HINGED | {"effects": {"one": EFFECTS[name]}} for name in EFFECTS}
COMMAND = HINGED | {"effects": {"command": {"type": "commanded_wrench"} | ON_BODY}}


NORMAL = TypeAdapter(UnitVector3).validate_python([0.1, 0.2, 0.97])
WEIGHT_ALONG = {"type": "gravity", "acceleration": [-8.0 * x for x in NORMAL]}
"""Along the normal to the last bit."""
SLANTED = {"type": "gravity", "acceleration": [0.4, -0.2, -9.7]}
PUSH = {"type": "wrench", "body": "b", "force": [0.4, -0.3, 0.2], "torque": [0.01, -0.02, 0.03]}
ROLLING = {"type": "rolling", "normal_A": NORMAL, "point_A": [0.3, 0.1, -0.2]}
AXIS = {"type": "fixed_axis", "axis_B": [0.2, 0.3, 0.9], "point_B": [0.1, 0.02, -0.3]}
ROUND, ALONG_Z, UNEVEN = [0.03, 0.03, 0.03], [0.02, 0.02, 0.035], INERTIA
K = np.array([2.0, 3.0, 6.0]) / 7.0
ALONG_K = (0.02 * np.eye(3) + 0.015 * np.outer(K, K)).tolist()
OFF = {"center_of_mass": [0.04, -0.03, 0.05]}


def moving(joint: Mapping, effects: list[Mapping], **own: Any) -> Mapping:
    """A body that turns about all its axes, on a joint that its start is moved onto."""
    turn = {"axis": [0.3, -0.5, 0.8], "angle": 0.9}
    start = {"angular_velocity": [1.5, -2.0, 3.0], "linear_velocity": [0.4, -0.3, 0.2]}
    return {
        "bodies": {"b": {"mass": 1.7, "orientation": turn} | start | own},
        "constraints": {"joint": {"body": "b"} | joint},
        "effects": {f"e{i}": effect for i, effect in enumerate(effects)},
        "simulation": {"project_initial": True},
    }


def disk(effects: list[Mapping], inertia: Any = ALONG_Z, **own: Any) -> Mapping:
    shape = {"type": "disk", "radius": 0.2} | own.pop("shape", {})
    return moving(ROLLING, effects, inertia=inertia, shape=shape, **own)


def sphere(effects: list[Mapping], inertia: Any = ROUND, **own: Any) -> Mapping:
    return moving(ROLLING, effects, inertia=inertia, shape={"type": "sphere", "radius": 0.2}, **own)


SUITED: dict[str, tuple[Any, Mapping]] = {
    "pendulum": (AS_PENDULUM, moving(AXIS, [SLANTED], inertia=UNEVEN, **OFF)),
    "two weights": (AS_PENDULUM, moving(AXIS, [SLANTED, WEIGHT_ALONG], inertia=UNEVEN, **OFF)),
    "disk": (IN_ANGLES, disk([WEIGHT_ALONG])),
    "slanted axis": (IN_ANGLES, disk([WEIGHT_ALONG], ALONG_K, shape={"axis_B": K.tolist()})),
    "disk without weight": (IN_ANGLES, disk([])),
    "sphere": (IN_WORLD_AXES, sphere([SLANTED, PUSH])),
}
"""Scenes whose series have variables of their own."""
NEARLY = {
    "pendulum that is pushed": moving(AXIS, [SLANTED, PUSH], inertia=UNEVEN),
    "disk under a slanted weight": disk([SLANTED]),
    "disk that is pushed": disk([WEIGHT_ALONG, PUSH]),
    "disk off its centre": disk([WEIGHT_ALONG], **OFF),
    "uneven disk": disk([WEIGHT_ALONG], [0.02, 0.021, 0.035]),
    "disk with a product": disk([WEIGHT_ALONG], [[0.02, 1e-3, 0], [1e-3, 0.02, 0], [0, 0, 0.035]]),
    "disk about another axis": disk([WEIGHT_ALONG], shape={"axis_B": [1.0, 0.0, 0.0]}),
    "uneven sphere": sphere([SLANTED], [0.03, 0.03, 0.031]),
    "sphere with a product": sphere([SLANTED], [[0.03, 0, 0], [0, 0.03, 1e-3], [0, 1e-3, 0.03]]),
    "sphere off its centre": sphere([SLANTED], **OFF),
    "sphere pushed off its centre": sphere([PUSH | {"point_B": [0.0, 0.0, 0.1]}]),
    "sphere pushed along its axes": sphere([PUSH | {"frame": "body"}]),
}
"""Scenes for which those variables would be wrong."""
RUNS |= JOINTS | NEARLY | {name: scene for name, (_, scene) in SUITED.items()}


def series_motion(name: str, tolerance: float) -> tuple[TracedMotion, Any]:
    """A shipped scene on the series of its graph, and its closed form."""
    compiled = compile_scene(load_scene(CONFIG / f"{name}.yaml"))
    return TracedMotion(compiled, AdaptiveTaylor(tolerance, 3.0)), closed_form(compiled)


@pytest.mark.parametrize("name", CLOSED)
def test_series_sums_to_the_closed_form(name: str) -> None:
    """Within the first step, to the rounding of the coordinates."""
    motion, exact = series_motion(name, 1e-16)
    times = np.array([0.0, 1e-3, 0.01, 0.06, 0.2])
    found = []
    for t in times:
        motion.run_to([t])
        found.append(motion.coordinates)
    assert motion.steps == 1
    assert_allclose(found, exact.coordinates(times), rtol=EPSILON, atol=4e-16)


@pytest.mark.parametrize("name", CLOSED)
def test_tolerance_is_kept(name: str) -> None:
    """3 s are some 30 steps, each within the tolerance; the pendulum near the top multiplies it."""
    tolerances = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14]
    times, worst = np.linspace(0.0, 3.0, 101), []
    for tolerance in tolerances:
        motion, exact = series_motion(name, tolerance)
        error = 0.0
        for t, y in zip(times, exact.coordinates(times), strict=True):
            motion.run_to([t])
            error = max(error, float(np.abs(np.array(motion.coordinates) - y).max()))
        worst.append(error)
    growth = {"pendulum": 1e3}.get(name, 30.0)
    assert np.all(np.array(worst) <= growth * np.array(tolerances) + 3e-13), worst
    if name != "rolling_sphere":  # its error at 1e-10 is ten times below the tolerance by chance
        assert np.all(np.diff(worst) < 0.0)


@pytest.mark.parametrize("name", RUNS)
def test_same_motion_as_a_method_of_another_family(name: str) -> None:
    """Every joint and every effect: state and reactions at samples off the steps."""
    options: dict[str, Any] = {"duration": 1.5, "rate": 37.0, "tolerance": 1e-14}
    ours, other = (
        trajectory(RUNS[name], method=method, **options) for method in ("taylor", "dopri853")
    )
    for field in ("position", "orientation", "linear_velocity", "angular_velocity", "anchor"):
        a, b = getattr(ours, field), getattr(other, field)
        assert_allclose(
            a, b, rtol=0.0, atol=2e-12 * (1.0 + np.abs(b).max(initial=0.0)), err_msg=field
        )
    size = 1.0 + np.abs(other.reaction_force).max(initial=0.0)
    assert_allclose(ours.reaction_force, other.reaction_force, rtol=0.0, atol=1e-11 * size)
    assert ours.residual.max() <= 1e-12


@pytest.mark.parametrize("name", SUITED)
def test_which_variables_a_scene_has(name: str) -> None:
    known, mapping = SUITED[name]
    assert variables_of(compile_scene(load_scene(mapping)).system) is known


def split_states(mapping: Any, pieces: tuple[float, ...]) -> tuple[int, list[Any]]:
    """Steps, and state and reactions at the end of a run made in these pieces."""
    simulation = Simulation(load_scene(mapping))
    for piece in pieces:
        simulation.advance(piece)
    last = simulation.sample().block
    names = ("position", "orientation", "linear_velocity", "angular_velocity", "reaction_force")
    return simulation.steps, [simulation.time, *(getattr(last, n).tolist() for n in names)]


@pytest.mark.parametrize("name", ["hinge, wrench", "disk"])
def test_run_split_in_two_is_the_run_in_one(name: str) -> None:
    """Bit for bit, with the cuts off the grid of steps."""
    options = {"method": "taylor", "tolerance": 1e-9, "project_initial": True}
    mapping = RUNS[name] | {"simulation": options}
    whole = split_states(mapping, (1.5,))
    cut = split_states(mapping, (0.25, 0.125, 0.625, 0.5))
    assert cut == whole and whole[0] > 2


@pytest.mark.parametrize("spin", [0.0, 5.0])
def test_a_motion_whose_series_ends_takes_one_step(spin: float) -> None:
    """At rest and turning evenly: no term is left that would limit the step."""
    body = HINGED["bodies"]["body"] | {"linear_velocity": [0.0, 0.0, 0.0]}
    body |= {"angular_velocity": [spin, 0.0, 0.0]}
    options = {"method": "taylor", "tolerance": 1e-12, "duration": 50.0, "project_initial": True}
    mapping = HINGED | {"bodies": {"body": body}, "effects": {}, "simulation": options}
    _, start = split_states(mapping, (0.0,))
    steps, end = split_states(mapping, (50.0,))
    assert steps == 1
    assert (np.abs(end[4]).max() == 0.0) == (spin == 0.0)
    assert_allclose(end[4], start[4], rtol=1e-15)


class Laws:
    """The laws of y' = f(y) alone."""

    velocities: tuple[float, ...] = (0.0, 1.0)
    project = inside = sample = jacobian = along = share = None
    splines, n, width, carried, system = 0, 2, 2, 0, None
    inputs: Any = SimpleNamespace(values=lambda *at: [], kept=lambda system: [])

    def __init__(self, f: Any) -> None:
        self._outputs = f(*Graph().vector("y", 2))
        self.rate: CompiledLaws = compile_law(self._outputs)
        self.series = SeriesLaws(self._outputs)

    def whole(self, step: Any, estimated: bool = True) -> None:
        return None


def reached(f: Any, y: list[float], t: float, tolerance: float = 1e-12) -> tuple[Any, int]:
    """y at t, and steps."""
    stepper = TracedStepper(Laws(f))
    stepper.start(0.0, y, None)
    status, _ = stepper.record(AdaptiveTaylor(tolerance, 100.0), np.array([t]), math.inf, None)
    assert status == 0
    return stepper.y, stepper.steps


def test_terms_that_vanish_in_turn_do_not_make_a_step_too_long() -> None:
    """x'' = -2 x^3 from x = 0, v = 1: of the lemniscate sine every fourth term alone is not zero,
    so that both of the last two may be missing."""
    (x, _), steps = reached(lambda x, v: [v, -2.0 * x * x * x], [0.0, 1.0], 3.0)
    sn, _, dn, _ = ellipj(math.sqrt(2.0) * 3.0, 0.5)
    assert abs(x - sn / (math.sqrt(2.0) * dn)) < 1e-11
    assert steps > 5


def test_a_step_ends_where_a_selection_changes_side() -> None:
    """x'' = -sign(x) 2 from x = 1 at rest: parabolas, of which each alone never ends."""
    (x, v), _ = reached(lambda x, v: [v, -2.0 * abs(x) / x], [1.0, 0.0], 1.5)
    # down to 0 at t = 1 with v = -2, and half a second of the other parabola
    assert_allclose([x, v], [-0.75, -1.0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("depth", [1e-2, 1e-4, 1e-6])
def test_an_event_that_changes_side_and_back_within_a_step_is_seen(depth: float) -> None:
    """x'' = -2, and -4 above 1 - depth: a throw to the height 1, one step but for its top, which is
    0.2 to 0.002 s of the 1.9 s."""

    def fall(x: Any, v: Any) -> list[Any]:
        return [v, where(x > 1.0 - depth, -4.0, -2.0)]

    (x, v), _ = reached(fall, [0.0, 2.0], 1.9)
    # up to the line in 1 - sqrt(depth) at v = 2 sqrt(depth), back at it after v / 2, and down
    speed = 2.0 * math.sqrt(depth)
    rest = 1.9 - (1.0 - math.sqrt(depth)) - 0.5 * speed
    assert_allclose(x, 1.0 - depth - speed * rest - rest * rest, rtol=0.0, atol=1e-9)
    assert_allclose(v, -speed - 2.0 * rest, rtol=0.0, atol=1e-9)


def commanded() -> tuple[list[float], list[float]]:
    """The end of a run with a command given on the way, by two methods."""
    ends = []
    for method in ("taylor", "dopri853"):
        options = {"method": method, "tolerance": 1e-14, "project_initial": True}
        simulation = Simulation(load_scene(COMMAND | {"simulation": options}))
        simulation.advance(0.3)
        simulation.apply_wrench("body", [1.0, 2.0, -1.0], [0.3, 0.1, 0.2])
        simulation.advance(0.4)
        simulation.apply_wrench("body", [1.0, 2.0, -1.0], [0.3, 0.1, 0.2], "body")
        simulation.advance(0.4)
        ends.append(simulation.sample().block.orientation[0, 0].tolist())
    return ends[0], ends[1]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-8])
def test_a_spring_that_turns_round_at_its_anchor_is_not_leapt_over(tolerance: float) -> None:
    """A body on a line through the anchor: its spring pulls back towards a length of 0.3 m on
    either side, |x| = 0.3 + 0.7 cos w t while x keeps its sign.  The series of |x| is that of x or
    of -x."""
    w, turned = math.sqrt(30.0), math.acos(-3.0 / 7.0)  # where |x| = 0, w t
    spring = {"type": "spring", "body": "b", "stiffness": w * w, "rest_length": 0.3}
    scene = {
        "bodies": {"b": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [1.0, 0.0, 0.0]}},
        "effects": {"s": spring},
        "simulation": {"duration": 5.0, "rate": 50.0, "method": "taylor", "tolerance": tolerance},
    }
    run = Simulation(scene).run(check=False, checks=False)
    passed, rest = np.divmod(w * run.t + turned, 2.0 * turned)
    exact = (-1.0) ** passed * (0.3 + 0.7 * np.cos(rest - turned))
    assert np.abs(run.position["b"][:, 0] - exact).max() < 200.0 * tolerance


def test_commands_begin_a_new_series() -> None:
    ours, other = commanded()
    assert_allclose(ours, other, rtol=0.0, atol=1e-13)


def test_where_there_is_no_series_the_error_says_so() -> None:
    """|v| v has no second derivative where v is zero."""
    drag = {"type": "quadratic_drag", "coefficient": 0.5} | ON_BODY
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    options = {"method": "taylor", "tolerance": 1e-9, "duration": 1.0}
    effects = {"weight": WEIGHT, "drag": drag}
    mapping = {"bodies": {"body": body}, "effects": effects, "simulation": options}
    with pytest.raises(
        SimulationError, match=r"no Taylor series at t = 0 s .*; use method dopri853"
    ) as caught:
        Simulation(load_scene(mapping)).advance(0.1)
    assert "\n" not in str(caught.value)


UNSUITED = {
    "contacts": (load_scene(CONFIG / "bouncing_ball.yaml", method="taylor", step=None), "auto"),
    "spline": (load_scene(sliding(VALLEY, 1.0, 1.0, method="taylor", duration=0.1)), "maximal"),
}


@pytest.mark.parametrize("name", UNSUITED)
def test_a_scene_without_a_series_is_refused_in_one_line(name: str) -> None:
    scene, coordinates = UNSUITED[name]
    message = r"simulation\.method: got 'taylor'; must be dopri853 or auto here"
    with pytest.raises(SceneError, match=message) as caught:
        Simulation(scene, coordinates=coordinates)
    assert "\n" not in str(caught.value)


def test_a_tolerance_is_needed() -> None:
    with pytest.raises(SceneError, match="omitted for method taylor"):
        load_scene(HINGED, method="taylor", step=0.01)
