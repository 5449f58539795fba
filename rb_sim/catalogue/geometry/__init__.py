"""Pairs of surfaces: gap, normal and point of contact, with their rates."""
