# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws that are found by what they were traced from: traced once, and what they were."""

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.catalogue.constraints.rows import DistanceRow, fill
from rb_sim.compiler.graph.machine import evaluate
from rb_sim.compiler.graph.symbols import Graph
from rb_sim.mechanics import initial_projection
from rb_sim.mechanics.initial_projection import kept_law, of_the_package
from rb_sim.numerics.vectors import sin
from rb_sim.scene.load import scene_from_mapping
from tests.accuracy.checks.test_singular_configuration import four_bar


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))


class Traced:
    """Outputs k y0 + sin(y0), and how often they were asked for."""

    def __init__(self, factor: float) -> None:
        self.factor, self.times = factor, 0

    def __call__(self) -> list[Any]:
        self.times += 1
        y = Graph().vector("y", 1)
        return [self.factor * y[0] + sin(y[0])]


def value(law: Any) -> float:
    out = np.zeros(1)
    evaluate(law, 0.0, np.array([2.0]), np.zeros(1), out)
    return float(out[0])


@pytest.mark.parametrize("process", ["this", "another"])
def test_a_law_is_traced_once_for_its_origin(process: str) -> None:
    traced = [Traced(3.0), Traced(3.0), Traced(4.0)]
    laws = []
    for outputs in traced:
        laws.append(kept_law(("test", outputs.factor), outputs))
        if process == "another":  # which has only what is on disk
            initial_projection._LOADED.clear()
    assert [value(law) for law in laws] == pytest.approx([6.0 + np.sin(2.0)] * 2 + [8 + np.sin(2)])
    assert [outputs.times for outputs in traced] == [1, 0, 1]


def test_what_cannot_be_named_is_traced_every_time() -> None:
    outputs = Traced(3.0)
    for _ in range(2):
        assert value(kept_law(lambda: None, outputs)) == pytest.approx(6.0 + np.sin(2.0))
    assert outputs.times == 2


def test_a_damaged_file_is_no_law(tmp_path: Any) -> None:
    kept_law("test", Traced(3.0))
    initial_projection._LOADED.clear()
    for path in tmp_path.rglob("law-*"):
        path.write_bytes(b"\xff\xfe nothing")
    outputs = Traced(3.0)
    assert value(kept_law("test", outputs)) == pytest.approx(6.0 + np.sin(2.0))
    assert outputs.times == 1


def test_kernels_from_elsewhere_are_no_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of kept laws goes by the sources of the package alone."""
    system = Simulation(scene_from_mapping(four_bar(2.0)), announce=None).compiled.system
    assert of_the_package(system)
    monkeypatch.setitem(fill.kernels, DistanceRow, lambda *_: None)
    assert not of_the_package(system)
