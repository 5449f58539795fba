"""Runs of scene mappings as a user has them: traced laws, loops from the cache.

Tests that are about plain Python, and those of single kernels, use `tests.interpreted` instead.
"""

from __future__ import annotations

from typing import Any


def trajectory(
    scene: dict[str, Any], coordinates: str = "auto", watched: bool = False, **options: Any
) -> Any:
    """The samples (a SampleBlock) of a run of a scene mapping."""
    from rb_sim import Simulation, load_scene

    mapping = scene | {"simulation": scene.get("simulation", {}) | options}
    return Simulation(load_scene(mapping), coordinates=coordinates).run(watched=watched).block
