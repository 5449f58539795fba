"""Samples by hand: of their columns only those that a watch reads."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np


class Block(SimpleNamespace):
    """Samples at some times, with columns of numbers."""

    def __init__(self, t: Any, **columns: Any) -> None:
        arrays = {k: v if k == "events" else np.array(v, dtype=float) for k, v in columns.items()}
        super().__init__(t=np.array(t, dtype=float), **arrays)

    def __len__(self) -> int:
        return len(self.t)
