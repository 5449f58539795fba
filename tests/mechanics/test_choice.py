"""Lines in loops are chosen anew after every step: the choice, and linkages in full turns."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg.lapack import dpstrf

from rb_sim import Simulation
from rb_sim.graph.machine import compile_law, evaluate
from rb_sim.graph.symbols import Graph
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.systems.elimination import changing_lines, chosen_lines
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.load import scene_from_mapping
from tests.interpreted import interpreted
from tests.mechanics.bennett import Bennett
from tests.properties.test_newton_euler import CLOSE, defects

TURNING = 4.0
"""[rad/s] at which the linkages turn: more than a full turn in TIME."""
TIME = 2.0


def choice(matrix: np.ndarray, rank: int) -> tuple[np.ndarray, float, int]:
    """The choice of lines as laws call it, its least pivot and the line of that."""
    n = len(matrix)
    law = compile_law(list(chosen_lines(n, rank, list(Graph().vector("y", n * n)))))
    found = np.zeros(n + 2)
    evaluate(law, 0.0, np.ascontiguousarray(matrix.ravel()), np.zeros(1), found)
    return found[:n], float(found[n]), int(found[n + 1])


def lines_too_many(seed: int) -> tuple[np.ndarray, int]:
    """A = G G^T of lines of very different sizes, and its rank."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 24))
    rank = int(rng.integers(1, n + 1))
    G = rng.normal(size=(n, rank)) @ rng.normal(size=(rank, 30))
    G *= 10.0 ** rng.uniform(-4.0, 4.0, (n, 1))
    return G @ G.T, rank


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_the_choice_is_that_of_cholesky_with_pivots(seed: int, plain: bool) -> None:
    """Beside LAPACK's dpstrf of the matrix with a diagonal of ones."""
    matrix, rank = lines_too_many(seed)
    sizes = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(sizes, sizes)
    np.fill_diagonal(scaled, 1.0)  # of equal ones the first goes first
    factors, order, _, _ = dpstrf(scaled, lower=1, tol=1e-10)
    found, least, line = interpreted(choice, matrix, rank) if plain else choice(matrix, rank)
    assert set(np.flatnonzero(found)) == {k - 1 for k in order[:rank]}
    assert set(found) <= {0.0, 1.0}
    assert least == pytest.approx(factors[rank - 1, rank - 1] ** 2, rel=1e-6)
    if rank > 1:  # at the first all pivots are the same
        assert line == order[rank - 1] - 1


def test_of_equal_lines_round_off_does_not_choose() -> None:
    for noise in (1e-12, -1e-12):
        G = np.array([[1.0, 0.0], [1.0, noise], [0.3, 1.0], [0.3, 1.0 + noise]])
        assert choice(G @ G.T, 2)[0].tolist() == [1.0, 0.0, 1.0, 0.0]


def changing(mapping: dict[str, Any]) -> list[int]:
    """Lines of a scene that are chosen anew."""
    compiled = compile_motion(scene_from_mapping(mapping), "maximal")
    laws = MultiBodyLaws(compiled.system, 0, redundant=True)
    return changing_lines(compiled.system, compiled.dependent, laws.holonomic)


def hinge(body: str, parent: str | None = None) -> dict[str, Any]:
    joint = {"type": "fixed_axis", "body": body, "axis_B": [0.0, 0.0, 1.0]}
    return joint | ({} if parent is None else {"parent": parent})


def test_only_lines_in_loops_that_hold_too_much_are_chosen_anew() -> None:
    linkage = Bennett(0).scene(TURNING)
    assert changing(linkage) == list(range(20))
    body = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    linkage["bodies"] |= {"door": body | {"position": [9.0, 0.0, 0.0]}}
    linkage["bodies"] |= {"pendant": body | {"position": linkage["bodies"]["bar1"]["position"]}}
    linkage["constraints"] |= {f"hang{k}": hinge("door") for k in range(2)}
    linkage["constraints"]["hung"] = {"type": "fixed_point", "body": "pendant", "parent": "bar1"}
    linkage["simulation"]["project_initial"] = True
    assert changing(linkage) == list(range(20))
    blade = {"type": "velocity", "linear": [0.0, 1.0, 0.0]}
    linkage["bodies"]["sled"] = body | {"position": [20.0, 0.0, 0.0]}
    linkage["constraints"]["blade"] = blade | {"body": "sled"}
    assert changing(linkage) == list(range(20))
    linkage["constraints"]["keel"] = blade | {"body": "bar1"}
    assert changing(linkage) == list(range(20))  # a drive is kept, whichever of the others are
    for name in ("hinge1", "hinge3", "keel"):
        del linkage["constraints"][name]
    assert changing(linkage) == []


WAYS: dict[str, tuple[dict[str, Any], float]] = {
    "rk4": ({"step": 0.005}, 4e-7),
    "gauss6": ({"step": 0.01}, 5e-10),
    "dopri853": ({"tolerance": 1e-10}, 5e-10),
    "taylor": ({"tolerance": 1e-10}, 5e-10),
    "radau5": ({"tolerance": 1e-8}, 1e-9),
}
"""Of each method its setting and the error [m]; with lines chosen at the start alone they were
up to 8e-2, and gauss6 went on at no step."""


@cache
def middles(seed: int) -> np.ndarray:
    """Where the bars of a linkage are at ten instants a second."""
    return Bennett(seed).middles(TURNING, np.linspace(0.0, TIME, 21))


def watched(mapping: dict[str, Any]) -> Any:
    """The run of a scene; whatever a watch finds is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Simulation(scene_from_mapping(mapping)).run()


@pytest.mark.parametrize("method", WAYS)
@pytest.mark.parametrize("seed", [2, 4, 7])
def test_linkages_turn_full_turns(seed: int, method: str) -> None:
    linkage, (setting, close) = Bennett(seed), WAYS[method]
    run = watched(linkage.scene(TURNING, duration=TIME, rate=10.0, method=method, **setting))
    found = np.stack([run.position[f"bar{k}"] for k in range(3)], axis=1)
    assert np.abs(found - middles(seed)).max() < close


@pytest.mark.parametrize("seed", [2, 4])
def test_reactions_of_linkages_move_them(seed: int) -> None:
    scene = Bennett(seed).scene(TURNING, duration=TIME, rate=10.0)
    for t in (0.7, 1.6):
        assert max(defects(scene, t)) < CLOSE


def test_reactions_of_linkages_do_not_hang_on_the_order_of_hinges() -> None:
    """They are those of least norm, whichever lines get a multiplier."""
    scene = Bennett(3).scene(TURNING, duration=TIME, rate=10.0)
    turned_round = scene | {"constraints": dict(reversed(scene["constraints"].items()))}
    one, other = watched(scene), watched(turned_round)
    for name, reaction in one.reaction.items():
        largest = np.abs(reaction.force).max()
        np.testing.assert_allclose(
            other.reaction[name].force, reaction.force, rtol=0.0, atol=1e-6 * largest
        )


def test_a_run_in_pieces_is_the_run_in_one() -> None:
    """To the last bit, wherever samples are taken: what is chosen hangs on the steps alone."""
    options = {"duration": TIME, "method": "rk4", "step": 0.005}
    scene = Bennett(4).scene(TURNING, rate=40.0, **options)
    whole = watched(scene)
    parts = Simulation(scene_from_mapping(scene))
    for t in (0.3, 0.7123, 1.4):
        parts.advance(t - parts.time)
    rest = parts.run(TIME - 1.4, 40.0)
    coarse = watched(Bennett(4).scene(TURNING, rate=5.0, **options))
    for name in whole.position:
        np.testing.assert_array_equal(rest.position[name][-1], whole.position[name][-1])
        np.testing.assert_array_equal(coarse.position[name], whole.position[name][::8])


def placed(simulation: Simulation) -> np.ndarray:
    """Where the bars of a linkage are now."""
    sample = simulation.sample()
    return np.stack([sample.position[f"bar{k}"][0] for k in range(3)])


def test_looking_at_the_present_changes_nothing() -> None:
    """A sample of the present takes its inputs anew; the lines stay as they are chosen."""
    ends = []
    for looking in (True, False):
        linkage, step = Bennett(2), 0.01
        scene = linkage.scene(TURNING, method="rk4", step=step)
        simulation = Simulation(scene_from_mapping(scene))
        for _ in range(100):
            simulation.advance(step)
            if looking:
                simulation.sample()
        ends.append(placed(simulation))
    np.testing.assert_array_equal(*ends)


def test_a_state_that_is_set_has_lines_of_its_own() -> None:
    """One step from places at some of which the lines of the start serve badly."""
    linkage, step = Bennett(0), 0.01
    simulation = Simulation(scene_from_mapping(linkage.scene(TURNING, method="rk4", step=step)))
    fields = ("position", "orientation", "linear_velocity", "angular_velocity")
    for angle in np.arange(2.5, 3.5, 0.1):
        linkage.start = angle
        there = linkage.scene(TURNING)["bodies"]
        simulation.set_state({name: {f: body[f] for f in fields} for name, body in there.items()})
        simulation.advance(step)
        after = linkage.middles(TURNING, np.array([0.0, step]))[-1]
        assert np.abs(placed(simulation) - after).max() < 1e-7
