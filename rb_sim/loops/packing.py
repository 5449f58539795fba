"""Rows of the kernel into the buffer of all messages: see rb_sim.sinks.packing."""

from __future__ import annotations

import numpy as np

from rb_sim.loops.compiled import helper, loop


@helper
def pack_row(
    row, command, centers, linear, energy, source, numbers, chosen, doubles, stamps, whole, rest
):
    """Fill `source` from the row and the commands, then the doubles of the messages from it.

    row: as the kernel writes it, shape (width,). command: world axes, shape (6 M,). centers: r_OC,
    shape (N, 3). linear: (from, to) of what is copied as it is: from >= 0 counts in the row,
    -1 - from in the command; shape (L, 2). energy: columns of the total, and of its two parts.
    source: columns as rb_sim.sinks.packing has them.
    numbers, chosen: places among the doubles, and the columns that go there.
    stamps: places of seconds among the 32-bit integers of the same buffer; `whole` goes there and
    `rest` [ns] behind it.
    The numbers are those of rb_sim.sinks.frames, to the last bit.
    """
    bodies = len(centers)
    p, v, w = 2, 2 + 7 * bodies, 2 + 10 * bodies
    q = 2 + 3 * bodies
    moved = False
    for k in range(bodies):
        for i in range(3):
            moved = moved or centers[k, i] != 0.0
    for k in range(bodies):
        at = 13 * k
        x, y, z, s = row[at + 3], row[at + 4], row[at + 5], row[at + 6]
        scale = 2.0 / (((x * x + y * y) + z * z) + s * s)
        a, b, c = row[at + 10], row[at + 11], row[at + 12]
        tx, ty, tz = scale * (y * c - z * b), scale * (z * a - x * c), scale * (x * b - y * a)
        wx = (a + s * tx) + (y * tz - z * ty)
        wy = (b + s * ty) + (z * tx - x * tz)
        wz = (c + s * tz) + (x * ty - y * tx)
        rx = ry = rz = 0.0
        for i in range(3):
            source[p + 3 * k + i] = row[at + i]
            source[v + 3 * k + i] = row[at + 7 + i]
        if moved:
            a, b, c = centers[k, 0], centers[k, 1], centers[k, 2]
            tx, ty, tz = scale * (y * c - z * b), scale * (z * a - x * c), scale * (x * b - y * a)
            rx = (a + s * tx) + (y * tz - z * ty)
            ry = (b + s * ty) + (z * tx - x * tz)
            rz = (c + s * tz) + (x * ty - y * tx)
            source[p + 3 * k] -= rx
            source[p + 3 * k + 1] -= ry
            source[p + 3 * k + 2] -= rz
            source[v + 3 * k] -= wy * rz - wz * ry
            source[v + 3 * k + 1] -= wz * rx - wx * rz
            source[v + 3 * k + 2] -= wx * ry - wy * rx
        source[w + 3 * k] = wx
        source[w + 3 * k + 1] = wy
        source[w + 3 * k + 2] = wz
        for i in range(4):
            source[q + 4 * k + i] = row[at + 3 + i]
    for i in range(len(linear)):
        come = linear[i, 0]
        source[linear[i, 1]] = row[come] if come >= 0 else command[-1 - come]
    source[energy[0]] = source[energy[1]] + source[energy[2]]
    for i in range(len(numbers)):
        doubles[numbers[i]] = source[chosen[i]]
    integers = doubles.view(np.int32)
    for i in range(len(stamps)):
        integers[stamps[i]] = whole
        integers[stamps[i] + 1] = rest


@loop
def pack_rows(
    rows, commands, centers, linear, energy, source, numbers, chosen, doubles, stamps, times
):
    """As pack_row for each row: doubles of shape (n, size), times (seconds, rest) of (n, 2)."""
    for k in range(len(rows)):
        pack_row(
            rows[k],
            commands[k],
            centers,
            linear,
            energy,
            source,
            numbers,
            chosen,
            doubles[k],
            stamps,
            times[k, 0],
            times[k, 1],
        )
