"""Bodies with contacts as a system: its layout, equations and the levels of its events."""
