"""No LinAlgError leaves the contacts: what linear algebra cannot do is one line."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SimulationError
from rb_sim.contact.events.instant import eigenvalues, pseudo_inverse, require_finite
from rb_sim.contact.events.instant import singular_values as svd
from tests.contact.scenes import ball, box, scene, touch
from tests.interpreted import interpreted
from tests.numerics.problems import Bounded, Normal, residual_of

BAD = (np.nan, np.inf, -np.inf)


def fail(*_: Any, **__: Any) -> Any:
    raise np.linalg.LinAlgError("SVD did not converge")


CALLS = {
    "svd": lambda A: svd(A, "reactions"),
    "eigh": lambda A: eigenvalues(A, "reactions"),
    "pinv": lambda A: pseudo_inverse(A, "reactions"),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("bad", BAD)
def test_entries_that_are_not_finite_are_told(name: str, bad: float) -> None:
    A = np.eye(3)
    A[1, 2] = A[2, 1] = bad
    with pytest.raises(SimulationError, match=r"^reactions have no solution: .*finite") as caught:
        CALLS[name](A)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", CALLS)
def test_a_decomposition_that_does_not_converge_is_told(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(np.linalg, name, fail)
    with pytest.raises(SimulationError, match="^reactions have no solution: SVD did not converge$"):
        CALLS[name](np.eye(3))


@pytest.mark.parametrize("bad", BAD)
def test_a_contact_problem_that_is_not_finite_is_told(bad: float) -> None:
    items: Any = ([Normal(0)], [Bounded((1, 2), 0, 0.5)])
    b, one = np.array([-1.0, bad, 0.0]), np.array([-1.0, 1.0, 0.0])
    assert np.isnan(residual_of(np.eye(3), b, *items)[0])
    assert np.isnan(residual_of(np.diag([1.0, bad, 1.0]), one, *items)[0])


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("ends", ["choose_modes", "_strike"])
def test_a_run_whose_loads_are_not_finite_is_told(bad: float, ends: str) -> None:
    """A mass that is none makes the Delassus matrix none, of impacts and of modes."""
    text = interpreted(told_of, bad, ends)
    assert text.startswith("the laws of contact have no solution") and "finite" in text


def told_of(bad: float, ends: str) -> str:
    """What is said of a ball that strikes the floor, or lies on it, with an inertia of this."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.events.shares import choose_modes

    falls = ends == "_strike"
    mapping = scene(
        ball([0, 0, 0.1], linear_velocity=[0, 0, -1.0 if falls else 0.0]), touch(mu=0.3)
    )
    motion: Any = Simulation(load_scene(mapping))._motion
    y = np.array(motion.compiled.y)
    motion.system.bodies[:, 7] = bad  # of the inverse of the inertia
    try:
        instant = motion._instant(0.0, y)
        motion._strike(instant) if falls else choose_modes(instant)
    except SimulationError as error:
        return str(error)
    return "ran"


def run_with_a_failing(module: str, name: str) -> str:
    """What a box that falls onto its corners says when this function fails."""
    from rb_sim import Simulation, load_scene

    with pytest.MonkeyPatch.context() as patch:
        mapping = scene(box([0.2, 0.3, 0.1], [0, 0, 0.051]), touch(mu=0.4))
        mapping["simulation"]["duration"] = 0.02
        simulation = Simulation(load_scene(mapping))
        patch.setattr(importlib.import_module(module), name, fail)
        try:
            simulation.run()
        except SimulationError as error:
            return str(error)
    return "ran"


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("numpy.linalg", "svd"),
        ("rb_sim.contact.events.event_motion", "record_contacts"),
    ],
)
def test_a_run_tells_it_in_one_line(module: str, name: str) -> None:
    """svd: the shares of redundant corners; record_contacts: kernels."""
    text = interpreted(run_with_a_failing, module, name)
    assert "have no solution: SVD did not converge" in text and "\n" not in text


def test_entries_whose_squares_overflow_are_no_error() -> None:
    """A pseudo-inverse of numbers of 1e200 has a solution."""
    A = 1e200 * np.diag([1.0, 2.0])
    np.testing.assert_allclose(pseudo_inverse(A, "reactions"), 1e-200 * np.diag([1.0, 0.5]))
    require_finite("reactions", A, np.array([-1e300, 1e300]))
