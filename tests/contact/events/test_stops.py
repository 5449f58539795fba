# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Steps of fixed length see every end of a slip, also of one that friction turns aside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.contact.stick_slips import case, judged
from tests.runs import trajectory

CASES = (0, 1, 3, 11, 13, 20, 43, 53)


def ellipsoid(number: int) -> dict[str, Any]:
    """An ellipsoid that falls on a floor, which gives way in odd cases, slides there, comes to roll
    and leaves it: a slip in two directions, which each turns the other."""
    rng = np.random.default_rng(number)
    body = {
        "mass": 1.0,
        "shape": {"type": "ellipsoid", "semi_axes": rng.uniform(0.06, 0.14, 3).tolist()},
        "inertia": (0.004 * rng.uniform(0.7, 1.0, 3)).tolist(),
        "center_of_mass": rng.normal(0.0, 0.01, 3).tolist(),
        "position": [0.0, 0.0, 0.3],
        "orientation": {"axis": rng.normal(size=3).tolist(), "angle": 1.0},
        "linear_velocity": rng.normal(0.0, 0.5, 3).tolist(),
        "angular_velocity": rng.normal(0.0, 5.0, 3).tolist(),
    }
    floor: dict[str, Any] = {"type": "contact", "body": "b"}
    floor["friction"] = {"type": "coulomb", "static": 0.4, "kinetic": 0.3}
    if number % 2:
        floor["compliance"] = {"stiffness": 3000.0, "damping": 5.0}
    return {
        "bodies": {"b": body},
        "constraints": {"floor": floor},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 0.45, "rate": 50.0},
    }


@pytest.fixture(scope="module")
def exact() -> list[Any]:
    return [events(n, method="dopri853", tolerance=1e-11) for n in CASES]


def events(number: int, **options: Any) -> list[tuple[str, float]]:
    """What happens, and when."""
    return [(e.kind, e.t) for e in trajectory(ellipsoid(number), **options).events]


@pytest.mark.parametrize(("step", "late"), [(1e-3, 1e-4), (2e-4, 1e-6)])
def test_no_stick_is_missed(exact: list[Any], step: float, late: float) -> None:
    """In most of these none was found in steps of rk4, or 4 to 35 ms late, at any step: once a step
    had turned a slip aside it went on beside zero."""
    for number, expected in zip(CASES, exact, strict=True):
        found = events(number, method="rk4", step=step)
        assert [kind for kind, _ in found] == [kind for kind, _ in expected], number
        at = [[t for _, t in run] for run in (found, expected)]
        np.testing.assert_allclose(at[0], at[1], rtol=0.0, atol=late)
    assert any(kind == "sticks" for run in exact for kind, _ in run)


def pulled(number: int) -> dict[str, Any]:
    """The ellipsoid, pulled along and turned, on a floor whose two coefficients are equal: a slip
    that begins does not grow at first, and friction turns it as fast as it likes."""
    scene = ellipsoid(number)
    scene["constraints"]["floor"]["friction"] = {"type": "coulomb", "static": 0.25}
    load = {"force": [1.0, 0.5, 0.0], "torque": [0.05, 0.1, 0.02]}
    scene["effects"]["pull"] = {"type": "wrench", "body": "b"} | load
    scene["simulation"]["rate"] = 2000.0
    return scene


@pytest.mark.parametrize("number", [2, 4, 10, 16, 17])
def test_a_slip_that_begins_keeps_its_direction(number: int) -> None:
    """A step of rk4 from there turned the slip aside: forces were wrong by 1 to 17 N of 10, the
    slip by 1 to 17 mm/s, and in case 4 slips and sticks came 25 times at one instant."""
    exact = trajectory(pulled(number), method="dopri853", tolerance=1e-11)
    found = trajectory(pulled(number), method="rk4", step=1e-3)
    assert [e.kind for e in found.events] == [e.kind for e in exact.events]
    assert "slips" in [e.kind for e in exact.events]
    begins = next(e.t for e in reversed(exact.events) if e.kind == "slips")
    after = (exact.t > begins) & (exact.t < begins + 5e-3)
    assert after.any()
    forces = found.reaction_force[after], exact.reaction_force[after]
    np.testing.assert_allclose(*forces, rtol=0.0, atol=5e-3)
    speeds = found.linear_velocity[after], exact.linear_velocity[after]
    np.testing.assert_allclose(*speeds, rtol=0.0, atol=1e-4)


def test_a_slip_ends_where_the_clock_does_not_resolve_what_is_left() -> None:
    """After 135 s two instants are 3e-14 s apart: less was left of a slip, and no step went on."""
    found = case(1311, 450, fixed=True)
    assert found.sticks[-1] > 100.0
    assert judged(found)[0] == "fine"
