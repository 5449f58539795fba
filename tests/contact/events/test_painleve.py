"""A rod that slides on its end into Painleve's paradox: where it jams, and what is left."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.contact_runs import contact_run

ROD = Path(__file__).resolve().parents[3] / "config" / "painleve_rod.yaml"
MU, HALF, INERTIA = 1.6, 0.5, 1.0 / 12.0


def test_rod_jams_where_the_normal_force_would_be_infinite() -> None:
    """1 + 3 cos^2 a - 3 mu sin a cos a = 0; the impact goes through the end and stops it."""
    mapping = yaml.safe_load(ROD.read_text(encoding="utf-8"))
    first = contact_run(mapping, [0.0, 0.02], tolerance=1e-12)
    (jam,) = first.times("jams")
    run = contact_run(mapping, [jam - 1e-9, jam + 1e-9, 1.0], tolerance=1e-12).trajectory
    p, v = run.position["rod"], run.linear_velocity["rod"]
    w = run.angular_velocity["rod"][:, 1]
    lean = np.arcsin(p[:2, 2] / HALF)
    tangent = (3.0 * MU - math.sqrt(9.0 * MU**2 - 16.0)) / 2.0
    # the force grows without bound there; the event lies 1e-6 of the pivot before, and by that part
    # of its impulse the impact lifts the end
    assert abs(lean[0] - math.atan(tangent)) < 2e-6
    ends = v[:2] + np.stack([-w[:2] * p[:2, 2], 0.0 * w[:2], w[:2] * HALF * np.cos(lean)], axis=1)
    assert ends[0, 0] < -1.0 and abs(ends[0, 2]) < 1e-6
    assert abs(ends[1, 0]) < 1e-6 and 0.0 <= ends[1, 2] < 1e-6 * abs(v[0, 0])
    arm = HALF * np.cos(lean[0]), HALF * np.sin(lean[0])
    about_end = [INERTIA * w[i] + arm[1] * v[i, 0] - arm[0] * v[i, 2] for i in (0, 1)]
    assert abs(about_end[1] - about_end[0]) < 1e-6
    assert np.isfinite(p).all()
    kinds = [event.kind for event in first.events]
    assert kinds == ["closes", "slips", "jams", "opens"]


@pytest.mark.parametrize(
    "method",
    [
        {"method": "rk4", "step": 1e-3},
        {"method": "dopri853", "step": 2e-3},
        {"method": "dopri853", "tolerance": 1e-3},
        {"method": "gauss6", "step": 1e-3},
    ],
)
def test_no_step_passes_the_instant_unseen(method: dict[str, Any]) -> None:
    """Beyond it the force pulls, and would be taken for a lift-off."""
    mapping = yaml.safe_load(ROD.read_text(encoding="utf-8"))
    exact = contact_run(mapping, [0.0, 0.01], tolerance=1e-12).times("jams")
    found = contact_run(mapping, [0.0, 0.01], **({"tolerance": None} | method))
    assert [event.kind for event in found.events] == ["closes", "slips", "jams", "opens"]
    assert abs(found.times("jams")[0] - exact[0]) < 1e-5
