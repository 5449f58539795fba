"""The room for events is as large as its fields say."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from rb_sim.contact.problem.event_workspace import (
    MODES_WIDTH,
    NOTE_WIDTH,
    WAYS,
    WORKSPACE_LAYOUT,
    workspace_for,
)
from rb_sim.mechanics.contact.contact_table import SLIP_DIRECTION
from rb_sim.numerics.complementarity import BOUND_WIDTH

LINES, BODIES, C = 20, 3, 5
V = 6 * BODIES
SHAPES = {
    "J": (LINES, V), "W": (LINES, V), "line_bias": (LINES,), "line_rate": (LINES,),
    "free_accelerations": (V,), "impulses": (LINES,), "used": (LINES + C,), "place_of": (LINES,),
    "rules": (LINES + C,), "least": (LINES + C,), "bounds": (WAYS * C, BOUND_WIDTH),
    "limits": (WAYS * C,), "moves": (WAYS * C, 2), "taking_part": (C,), "plastic": (C,),
    "together": (C,), "rebounding": (C,), "opened": (C,), "parted": (C,), "moved": (C, WAYS),
    "bounces": (C + 1,), "rests": (C, 3), "before": (C, MODES_WIDTH), "undetermined": (7,),
    "notes": (64 + 8 * C, NOTE_WIDTH), "written": (1,),
}  # fmt: skip
INTEGERS = {
    "used", "place_of", "rules", "bounds", "moves", "taking_part", "plastic", "together",
    "rebounding", "opened", "parted", "moved", "bounces", "written",
}  # fmt: skip


def test_fields_have_the_shapes_and_kinds_that_they_tell() -> None:
    """Modes before an event are the columns up to the direction of slip, and that."""
    sizes = {"lines": LINES, "touch": C, "bodies": BODIES}
    system: Any = SimpleNamespace(**{name: np.zeros((n, 1)) for name, n in sizes.items()})
    workspace = workspace_for(system)._asdict()
    assert {name: table.shape for name, table in workspace.items()} == SHAPES
    assert {name for name, table in workspace.items() if table.dtype == np.int64} == INTEGERS
    assert not any(table.any() for table in workspace.values())
    assert tuple(workspace) == tuple(WORKSPACE_LAYOUT.fields)
    assert MODES_WIDTH == SLIP_DIRECTION + 3
