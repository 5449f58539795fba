"""Systems: one body in reduced coordinates, or many bodies in maximal ones with multipliers."""
