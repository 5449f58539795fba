"""Simulation: a scene in motion, its commands, and what surrounds a run."""
