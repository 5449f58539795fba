# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A run that ends in an error is looked at to its last sample, too."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rb_sim import Simulation
from rb_sim.base.errors import SimulationError
from rb_sim.cli.verbs.run import FAILED, RunOptions, run
from rb_sim.mechanics.samples import SampleBlock

SCENE = """
bodies: {b: {mass: 1.0, inertia: [1, 2, 3], angular_velocity: [1, 0, 0]}}
simulation: {duration: 100.0, rate: 100.0, method: rk4, step: 0.01}
"""
"""10,001 samples."""

EARLIER = 5
"""Samples before the end."""


def test_what_the_last_block_of_a_run_that_fails_shows_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    assert run(RunOptions(str(path), quiet=True)) == 0
    assert "warning" not in capfd.readouterr().err
    blocks = Simulation.blocks

    def ends_early(simulation: Simulation, *given: Any) -> Iterator[SampleBlock]:
        last = None
        for block in blocks(simulation, *given):
            if last is not None:
                yield last
            last = block
        assert last is not None
        spin = last.angular_velocity.copy()
        spin[-EARLIER] = 1e4
        yield replace(last, angular_velocity=spin)
        raise SimulationError("no step is small enough")

    monkeypatch.setattr(Simulation, "blocks", ends_early)
    assert run(RunOptions(str(path), quiet=True)) == FAILED
    said = capfd.readouterr().err
    assert "rotation in one step" in said and "no step is small enough" in said
