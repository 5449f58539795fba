"""What an analysis of a bag found, as plain data too."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rb_sim.bags.analysis.bodies import BodyFigures
from rb_sim.bags.analysis.figures import Figures, sizes_beside, sizes_of


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
