"""A finding, by the name under which watches give it."""

from rb_sim.finding import Finding

__all__ = ["Finding"]
