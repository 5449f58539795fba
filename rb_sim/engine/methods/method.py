"""A method: how y is carried over one step.

Every method is a NamedTuple class that registers `increment`; an adaptive one registers
`attempt` too.  The increment is returned apart from y, so that the sum y + dy can be compensated.
"""

from __future__ import annotations

from rb_sim.maths.jit import dispatch

AT, DY, FRESH, WORK_ROWS = 12, 13, 14, 17
"""Rows of the work array of systems with an array y: slopes 0 to 11, a stage's argument, the
increment, three fresh slopes.  One array, so that a kernel call passes few arguments."""


@dispatch
def increment(method, system, t, y, h, work):
    """dy over one step of length h from (t, y): a tuple, or work[DY] for an array y."""


@dispatch
def attempt(method, system, t, y, h, work):
    """(dy, error): the increment and its estimated local error in units of the tolerance."""


@dispatch
def next_step(method, h, error):
    """(accepted, step to take next) after an attempted step h with this error."""


@dispatch
def first_step(method, system, t, y, work):
    """Length of the first step to try [s]."""
