"""Rerun recordings of a run."""
