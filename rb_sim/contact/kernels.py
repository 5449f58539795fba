"""How the loops of contact are compiled: once for all scenes, since they see only arrays.

A scene is data to them (tables of bodies, contacts and effects), so no scene waits for a compiler,
and with RB_SIM_INTERPRETED=1 the same sources run as plain Python.
"""

from __future__ import annotations

from rb_sim.maths.jit import entry, inline

kernel = entry
"""Decorator of what Python calls."""
inner = once = inline
"""Decorators of what only kernels call; called from Python it stays plain Python."""
