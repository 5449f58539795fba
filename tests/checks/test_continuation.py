"""A motion from its start on once more, beside a run that stays where it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from rb_sim import Simulation
from tests.contact.scenes import ball, scene, touch


def sliding(**settings: Any) -> dict[str, Any]:
    """A ball that rolls and slides on a floor."""
    bodies = {"ball": ball([0.0, 0.0, 0.1], linear_velocity=[1.0, 0.5, 0.0])}
    mapping = scene(bodies, {"floor": touch("ball", 0.3)})
    return mapping | {"simulation": {"duration": 0.1, "rate": 20.0} | settings}


@pytest.mark.parametrize("method", ["time_stepping", "rk4"])
def test_steps_are_sampled_as_they_were(method: str) -> None:
    """Each, to the bit, as far as the run has come; without contacts of any other method, too."""
    mapping = sliding(method=method, step=0.01)
    if method == "rk4":
        mapping["constraints"].clear()
    simulation = Simulation(mapping)
    assert simulation.again(3) is None  # it has not begun
    simulation.run()
    state = simulation.time, simulation.steps
    expected = Simulation(mapping).run(0.1, 100.0)
    for count, found in ((4, simulation.again(4)), (10, simulation.again(1000))):
        assert found is not None and len(found) == count + 1
        assert_array_equal(found.t, np.minimum(0.01 * np.arange(count + 1.0), 0.1))
        assert_array_equal(found.position[:, 0], expected.position["ball"][: count + 1])
    assert (simulation.time, simulation.steps) == state


def test_what_is_not_to_be_had() -> None:
    """Where events stop the motion, and where somebody interfered."""
    events = Simulation(sliding(tolerance=1e-8))
    events.run()
    assert events.again(10) is None
    pushed = Simulation(sliding(method="time_stepping", step=0.01))
    pushed.run()
    pushed.set_state({"ball": {"linear_velocity": [0.0, 0.0, 1.0]}})
    assert pushed.again(10) is None
