"""Models that follow recordings: parameters and initial state by least squares."""
