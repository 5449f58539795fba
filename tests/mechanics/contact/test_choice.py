"""Linkages that hold more than they need turn full turns beside contacts as they do without."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from scipy.linalg.lapack import dpstrf

from rb_sim import Simulation
from rb_sim.contact.events.steps import choose_lines
from rb_sim.mechanics.contact.contact_bodies import (
    AMONG_LINES,
    AMONG_POSITIONS,
    CHANGING,
    DEPENDENT,
)
from rb_sim.mechanics.systems.many_bodies import BODY, PARENT
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.interpreted import interpreted
from tests.mechanics.bennett import Bennett

TURNING, TIME = 4.0, 2.0
"""[rad/s, s]: more than a full turn."""


def beside_a_ball(seed: int, **run: Any) -> dict[str, Any]:
    """A linkage, and a ball that bounces far away."""
    scene = Bennett(seed).scene(TURNING, duration=TIME, **run)
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.2}, "position": [50.0, 0.0, 1.0]}
    scene["bodies"]["ball"] = ball
    scene["constraints"]["floor"] = {"type": "contact", "body": "ball", "restitution": 0.8}
    scene["effects"] = {"weight": {"type": "gravity", "bodies": ["ball"]}}
    return scene


def watched(mapping: dict[str, Any]) -> Any:
    """The run of a scene; whatever a watch finds is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Simulation(scene_from_mapping(mapping)).run()


@pytest.mark.parametrize(
    ("setting", "close"),
    [
        ({"method": "rk4", "step": 0.0025}, 3e-8),
        ({"method": "dopri853", "tolerance": 1e-9}, 5e-9),
    ],
)
@pytest.mark.parametrize("seed", [2, 3])
def test_full_turns(seed: int, setting: dict[str, Any], close: float) -> None:
    """With lines chosen at the start alone rk4 was wrong by 2e-2 and by 3e-4."""
    run = watched(beside_a_ball(seed, rate=10.0, **setting))
    found = np.stack([run.position[f"bar{k}"] for k in range(3)], axis=1)
    assert np.abs(found - Bennett(seed).middles(TURNING, run.t)).max() < close


def test_what_is_chosen_hangs_on_the_steps_alone() -> None:
    """Samples between, and another run of the same scene between, change no bit."""
    options = {"method": "rk4", "step": 0.005}
    scene = scene_from_mapping(beside_a_ball(2, rate=10.0, **options))
    whole = Simulation(scene).run()
    fine = Simulation(scene_from_mapping(beside_a_ball(2, rate=130.0, **options))).run()
    first, second = Simulation(scene), Simulation(scene)
    for k in range(1, 21):
        for run, share in ((first, 1.0), (second, 0.37)):
            run.advance(share * 0.1 * k - run.time)
    for name in whole.position:
        last = whole.position[name][-1]
        np.testing.assert_array_equal(fine.position[name][-1], last)
        np.testing.assert_array_equal(first.sample().position[name][0], last)


LEFT_OUT = CHANGING + AMONG_LINES + AMONG_POSITIONS
"""What a line says that is chosen anew, and was not chosen."""


def made(flags: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(flags of the lines as compiled, those after a choice where they were `flags` before, lines,
    inverse masses) of a door on two equal hinges and a linkage."""
    scene = beside_a_ball(2, method="rk4", step=0.0025)
    body = {"mass": 1.0, "inertia": [0.1, 0.2, 0.3], "position": [9.0, 0.0, 0.0]}
    scene["bodies"] = {"door": body} | scene["bodies"]
    hinge = {"type": "fixed_axis", "body": "door", "axis_B": [0.0, 0.0, 1.0]}
    scene["constraints"] = {"hang0": hinge, "hang1": hinge} | scene["constraints"]
    compiled: Any = compile_scene(scene_from_mapping(scene))
    system, count = compiled.system, len(flags)
    before = system.lines[:count, DEPENDENT].copy()
    system.lines[:count, DEPENDENT] = flags
    choose_lines(system, 0.0, compiled.y)
    names = compiled.layout.bodies
    light, lines = np.zeros((6 * len(names), 6 * len(names))), np.zeros((count, 6 * len(names)))
    for i, name in enumerate(names):
        given = scene["bodies"][name]
        moments = np.array(given.get("inertia", [1.0, 1.0, 1.0]))
        own = slice(6 * i, 6 * i + 6)
        light[own, own] = np.diag(1.0 / np.array([*[given["mass"]] * 3, *moments]))
    for k in range(count):
        b, a = system.lines[k, [BODY, PARENT]]
        lines[k, 6 * b : 6 * b + 6] = system.rows[k, :6]
        if a >= 0:
            lines[k, 6 * a : 6 * a + 6] = system.rows[k, 6:12]
    return before, system.lines[:count, DEPENDENT].copy(), lines, light


OF_DOOR, OF_LINKAGE, HOLD = 10, 20, 17
"""Lines, and how many of the linkage's hold its bars: 18 coordinates less one that moves."""


def test_the_lines_chosen_are_those_of_cholesky_with_pivots() -> None:
    """Beside LAPACK's, of the lines that are chosen anew alone; another choice is forgotten."""
    flags = interpreted(made, [0] * (OF_DOOR + OF_LINKAGE))[0].copy()
    assert np.flatnonzero(flags & CHANGING).tolist() == list(range(10, 30))
    assert np.count_nonzero(flags == CHANGING) == HOLD
    flags[OF_DOOR:] = LEFT_OUT
    flags[OF_DOOR : OF_DOOR + HOLD] = CHANGING  # as many as hold
    _, after, lines, light = interpreted(made, flags.tolist())
    matrix = (lines @ light @ lines.T)[OF_DOOR:, OF_DOOR:]
    sizes = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(sizes, sizes)
    np.fill_diagonal(scaled, 1.0)
    _, order, _, _ = dpstrf(scaled, lower=1, tol=1e-10)
    chosen = {k - 1 for k in order[:HOLD]}
    expected = [CHANGING if k in chosen else LEFT_OUT for k in range(OF_LINKAGE)]
    assert after[OF_DOOR:].tolist() == expected != flags[OF_DOOR:].tolist()
    assert np.array_equal(after[:OF_DOOR], flags[:OF_DOOR])


def test_lines_that_leave_no_choice_stay_as_they_were() -> None:
    """Of two equal lines one has no pivot left; where none changes, none is chosen."""
    flags = [0] * (OF_DOOR + OF_LINKAGE)
    flags[0] = flags[5] = CHANGING
    assert interpreted(made, flags)[1].tolist() == flags
    flags[5] = LEFT_OUT
    assert interpreted(made, flags)[1].tolist() == flags
    flags = [AMONG_LINES + AMONG_POSITIONS] * len(flags)
    assert interpreted(made, flags)[1].tolist() == flags
