"""Laws and settings that are spoilt on purpose are seen by the watches, end to end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.constraints import rows
from rb_sim.catalogue.constraints.rows import DistanceRow, fill
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.types import wrench
from rb_sim.checks.check import effort_of
from rb_sim.checks.check_list import WatchList
from rb_sim.numerics.vectors import scale

SCENE = {
    "bodies": {
        "bob": {
            "mass": 1.0,
            "inertia": [0.02, 0.03, 0.01],
            "position": [1.0, 0.0, 0.0],
            "angular_velocity": [0.5, 1.0, -2.0],
        }
    },
    "constraints": {
        "rod": {"type": "distance", "body": "bob", "point_B": [0.0, 0.1, 0.2], "point_A": [0, 0, 0]}
    },
    "effects": {"weight": {"type": "gravity"}},
    "simulation": {"duration": 2.0, "rate": 100.0, "tolerance": 1e-10, "project_initial": True},
}


def findings(spoil: Callable[[Any], Any] = lambda effort: effort, **options: Any) -> dict[str, Any]:
    """What the watches say of the run, by watch; spoil: what they are told of its setting."""
    scene = load_scene(SCENE, **options)
    simulation = Simulation(scene, announce=None)
    watches = WatchList(scene, simulation.layout)
    for block in simulation.blocks(scene.simulation.duration, scene.simulation.rate):
        watches.add(block, spoil(effort_of(simulation)))
    return {finding.watch: finding for finding in watches.findings}


def test_unspoilt_it_passes() -> None:
    assert findings() == {}


def test_a_wrong_jacobian_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The arm of the reaction is half as long again: it does work and turns the body wrongly."""
    put = rows.put

    def spoilt(G: Any, k: Any, u: Any, torque_B: Any, *others: Any) -> None:
        put(G, k, u, scale(1.5, torque_B), *others)

    monkeypatch.setattr(rows, "put", spoilt)
    try:
        assert {"energy", "angular momentum"} & set(findings(method="rk4", step=1e-3))
    except SimulationError as error:  # or the run itself says that it cannot go on
        assert "t = " in str(error)


def test_a_dropped_term_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without what the rod's turning adds to the acceleration the projection alone holds it."""
    whole = fill.kernels[DistanceRow]

    def without_bias(row: Any, t: Any, B: Any, A: Any, G: Any, k: Any) -> None:
        whole(row, t, B, A, G, k)
        G[k, rows.BIAS] = 0.0

    monkeypatch.setitem(fill.kernels, DistanceRow, without_bias)
    assert {"energy", "momentum"} & set(findings(method="rk4", step=1e-3))


def test_a_force_that_is_not_its_potential_s_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = wrench.kernels[GravityRow]

    def weaker(*arguments: Any) -> Any:
        force, torque = whole(*arguments)
        return scale(0.999, force), torque

    monkeypatch.setitem(wrench.kernels, GravityRow, weaker)
    found = set(findings())
    assert "energy" in found
    assert {"momentum", "angular momentum"} & found


def test_a_truncated_tolerance_is_seen() -> None:
    """The watches hold the run to 1e-10, it is integrated to 1e-3."""
    found = findings(lambda effort: effort._replace(tolerance=1e-10), tolerance=1e-3)
    assert "energy" in found
