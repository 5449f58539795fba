"""Bodies with contacts as a system: its layout, equations and event functions."""
