"""Arrays in kernels as loops: what is compiled knows no expressions of whole arrays."""

from __future__ import annotations

from rb_sim.maths.jit import inline


@inline
def times(A, x, out):
    """out = A x."""
    for i in range(A.shape[0]):
        s = 0.0
        for j in range(A.shape[1]):
            s += A[i, j] * x[j]
        out[i] = s


@inline
def copy(to, of):
    """The numbers of a vector, in `to`."""
    for i in range(of.shape[0]):
        to[i] = of[i]


@inline
def copy_rows(to, of):
    """The numbers of a matrix, in `to`."""
    for i in range(of.shape[0]):
        for j in range(of.shape[1]):
            to[i, j] = of[i, j]


@inline
def largest(x):
    """The largest absolute value of a vector; NaN if one is."""
    most = 0.0
    for i in range(x.shape[0]):
        size = abs(x[i])
        if size > most or size != size:
            most = size
    return most
