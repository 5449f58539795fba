# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs of scene mappings as a user has them: traced laws, loops from the cache.

Tests that are about plain Python, and those of single kernels, use `tests.interpreted` instead.
"""

from __future__ import annotations

from typing import Any


def trajectory(
    scene: dict[str, Any], coordinates: str = "auto", checks: bool = False, **options: Any
) -> Any:
    """The samples (a SampleBlock) of a run of a scene mapping."""
    from rb_sim import Simulation, load_scene

    mapping = scene | {"simulation": scene.get("simulation", {}) | options}
    return Simulation(load_scene(mapping), coordinates=coordinates).run(checks=checks).block
