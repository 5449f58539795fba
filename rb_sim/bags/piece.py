"""What a bag gives at once of one source: times and numbers, by what they are of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

POSE, TWIST, WRENCH, IMU, SCALAR = "pose", "twist", "wrench", "imu", "scalar"


class Piece(NamedTuple):
    """Readings of one source, in the order of the file."""

    source: str
    """the topic; of transforms TOPIC:CHILD; of the twist of an Odometry TOPIC:twist; others under
    that name as `Sources` has it."""
    kind: str
    """POSE [position, quaternion], TWIST [v, w], WRENCH [force, torque], IMU [q, w, a], SCALAR."""
    frame: str
    child: str
    t: np.ndarray
    """header stamp, or log time where the type has none [s], shape (n,)."""
    log: np.ndarray
    """log time [s], shape (n,)."""
    values: np.ndarray
    """shape (n, size of the kind)."""
    stamp: np.ndarray
    """t as integers [ns], exact since the epoch, too, shape (n,)."""
    transform: bool = False
    """whether it is of a tree of transforms."""
