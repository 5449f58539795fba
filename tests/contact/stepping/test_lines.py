# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which pairs take part in a step: those left out as far would not have, and what is an impact."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.heaps import scenes
from tests.interpreted import interpreted


def heap_after(steps: int, looks_at_all: bool) -> tuple[np.ndarray, int]:
    """(state of ten piled spheres after so many steps of 10 ms, pairs that were left out)."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.stepping import constraint_rows

    left_out, is_far = [0], constraint_rows.is_far

    def far(*arguments: object) -> bool:
        found = bool(is_far(*arguments))
        left_out[0] += found
        return found and not looks_at_all

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(constraint_rows, "is_far", far)
        mapping = scenes.piled_balls()
        mapping["simulation"] |= {"method": "time_stepping", "step": 0.01}
        simulation = Simulation(load_scene(mapping))
        simulation.advance(0.01 * steps)
    return simulation.sample().block.position, left_out[0]


def test_what_is_far_takes_no_part() -> None:
    found, left_out = interpreted(heap_after, 15, False)
    expected, _ = interpreted(heap_after, 15, True)
    assert found.tobytes() == expected.tobytes()
    assert left_out > 600
