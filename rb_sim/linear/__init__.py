"""Linear models of a scene about a state of its motion."""

from rb_sim.linear.linearize import linearize
from rb_sim.linear.state_space import LinearModel

__all__ = ["LinearModel", "linearize"]
