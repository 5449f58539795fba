"""Recorded bags: what is in them, the run again, two of them beside each other."""
