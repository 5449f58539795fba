"""What an analysis of a bag found, as plain data too."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rb_sim.bags.analysis.bodies import BodyFigures
from rb_sim.bags.analysis.figures import COLUMNS, Figures, sizes_beside, sizes_of

Reading = tuple[str, str, np.ndarray, np.ndarray]
"""Source, kind, times [s] of shape (n,) and numbers of shape (n, size of the kind)."""


@dataclass
class Analysis:
    """What was found; `figures` and `bodies` also give curves and spectra to draw."""

    name: str
    figures: dict[str, Figures] = field(default_factory=dict)
    bodies: dict[str, BodyFigures] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    balance: dict[str, Any] | None = None
    """of a run of ours."""
    balances: dict[str, dict[str, Any]] = field(default_factory=dict)
    """of somebody else's poses, by what they are of."""
    constraints: dict[str, Any] | None = None
    """errors of the constraints, recomputed from the poses."""
    contacts: dict[str, Any] | None = None
    other_topics: dict[str, str] = field(default_factory=dict)
    length: float = 0.0
    """how far the scene's bodies reach from their origins [m]; 0 where no scene is known."""
    title: str = ""
    """of the scene; "" where none is known."""
    facts: list[str] = field(default_factory=list)
    """lines about the run that was recorded."""
    bytes: int = 0
    messages: int = 0

    def add(self, name: str, kind: str, t: np.ndarray, values: np.ndarray) -> None:
        """The next readings of a source."""
        self.kinds[name] = kind
        self.figures.setdefault(name, Figures(COLUMNS[kind])).add(t, values)

    def begin_anew(self) -> None:
        """What comes is another motion."""
        for figures in self.figures.values():
            figures.begin_anew()
        for body in self.bodies.values():
            body.finish()

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        sizes = sizes_of(self.figures.items(), self.length)
        return {
            "bag": self.name,
            "notes": self.notes,
            "sources": {
                name: {
                    "kind": self.kinds[name],
                    **figures.as_dict(sizes_beside(name, figures, sizes)),
                }
                for name, figures in self.figures.items()
            },
            "bodies": {name: body.as_dict() for name, body in self.bodies.items()},
            "balance": self.balance,
            "balances": self.balances,
            "constraints": self.constraints,
            "contacts": self.contacts,
            "other_topics": self.other_topics,
        }
