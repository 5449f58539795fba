"""Stepping loops and methods: compiled once for all scenes, they call the laws of a scene by
address."""
