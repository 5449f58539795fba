"""The work space of a step is as large as its fields say, and starts as a first step needs it."""

from __future__ import annotations

import numpy as np

from rb_sim.catalogue.constraints.rows import ROW_WIDTH
from rb_sim.contact.solvers.gauss_seidel import MOST_TOGETHER
from rb_sim.contact.solvers.graph import BLOCK, LINES, RULES, WIDTH
from rb_sim.contact.stepping.geometry import MEMORY, SPOT
from rb_sim.contact.stepping.step_workspace import FRESH, NOTES, memory_of, workspace_for

N, C, J = 3, 7, 11
"""Bodies, points of contact, lines of joints."""
SHAPES = {
    "spots": (C, SPOT), "polygons": (4, 12, 5), "active": (C,), "rows": (LINES * C, WIDTH),
    "targets": (LINES * C,), "rules": (C, RULES), "bends": (C, 4), "held": (N,),
    "blocks": (C, BLOCK), "ends": (C, 2),
    "x": (LINES * C,), "joint_rows": (J, WIDTH), "joint_targets": (J,), "joint_x": (J,),
    "joint_back": (J,), "joint_factor": (J, J), "joint_spare": (2, J), "u": (N, 6),
    "turning": (N, 6), "before": (13 * N + 1,), "notes": (NOTES,), "meets": (C,),
    "summed": (C, 6), "joint_summed": (J,), "traction": (9,),
    "joint_out": (13 * N + ROW_WIDTH * J + 1,),
}  # fmt: skip


def test_fields_have_the_shapes_that_they_tell() -> None:
    workspace = workspace_for(N, C, J)
    assert {name: field.shape for name, field in workspace._asdict().items()} == SHAPES
    assert workspace.active.dtype == workspace.ends.dtype == np.int64
    assert memory_of(C).shape == (C, MEMORY) and not memory_of(C).any()


def test_before_the_first_step() -> None:
    """It is fresh, and no pair is known to meet; all else is zero."""
    workspace = workspace_for(N, C, J)
    assert np.flatnonzero(workspace.notes).tolist() == [FRESH] and workspace.notes[FRESH] == 1.0
    assert (workspace.meets == -1.0).all()
    others = (
        field for name, field in workspace._asdict().items() if name not in ("notes", "meets")
    )
    assert not any(field.any() for field in others)


def test_too_many_lines_have_no_factor_together() -> None:
    for joints, together in ((MOST_TOGETHER, MOST_TOGETHER), (MOST_TOGETHER + 1, 0)):
        assert workspace_for(1, 0, joints).joint_factor.shape == (together, together)
