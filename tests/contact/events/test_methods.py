"""Methods as the loop of bodies in contact takes them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rb_sim.contact.events.stepping import jacobian_by_differences, slow_slips, stepping_of
from rb_sim.integrate.methods.radau5 import radau5_of_slips
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import ball, scene, touch


def test_slips_that_are_lost_and_that_creep() -> None:
    """Thirty tolerances, or what is none by itself; a milliardth of the scene's speed, 2 m/s."""
    system = SimpleNamespace(still=1e-4, speed=2.0)

    def found(**method: float) -> Any:
        return slow_slips(system, SimpleNamespace(**method))

    assert found(tolerance=1e-5) == {"still": pytest.approx(3e-4), "creep": 2e-9}
    assert found(tolerance=1e-6) == {"still": 1e-4, "creep": 2e-9}
    assert found(tolerance=0.0) == found(step=0.1) == {"still": 1e-4, "creep": 0.0}


@pytest.mark.parametrize(
    ("method", "rubs", "fixed", "implicit", "beside"),
    [
        ({"method": "dopri853", "tolerance": 1e-6}, True, 0.0, 0.0, True),
        ({"method": "dopri853", "tolerance": 1e-6}, False, 0.0, 0.0, False),
        ({"method": "rk4", "step": 0.01}, True, 0.01, 0.0, False),
        ({"method": "gauss6", "step": 0.01}, False, 0.01, 1.0, False),
    ],
)
def test_what_the_loop_takes_of_a_method(
    method: dict[str, Any], rubs: bool, fixed: float, implicit: float, beside: bool
) -> None:
    """Explicit adaptive methods have an implicit step beside them, where slips may be stiff."""
    mapping = scene(ball([0, 0, 0.1]), touch()) | {"simulation": {"duration": 1.0} | method}
    loaded = scene_from_mapping(mapping)
    found = stepping_of(compile_scene(loaded), compile_method(loaded.simulation, 1.0), rubs)
    assert found.setting[0] == fixed
    assert found.setting[1] == method.get("tolerance", 0.0)
    assert found.setting[4] == implicit
    if beside:
        assert found.implicit == radau5_of_slips.reference
        assert found.jacobian == jacobian_by_differences.address
    else:
        assert (found.implicit, found.jacobian) == (0, 0)
