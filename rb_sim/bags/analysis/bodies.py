# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Mass properties of bodies; energy, momenta and wrench of one body from its poses."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.bags.analysis.derivatives import (
    FILTER,
    NORMAL,
    ORDER,
    WINDOW,
    Body,
    Jump,
    Motion,
    coefficients,
    differentiated,
    error_at,
    even,
    filled,
    inverse_dynamics,
    pieces,
)
from rb_sim.bags.analysis.figures import Figures
from rb_sim.base.errors import RbSimError
from rb_sim.base.names import first_few
from rb_sim.base.rounding import COMPUTED_ROUNDING, WRITTEN_ROUNDING
from rb_sim.numerics.rotations import from_rotation_vector, norms, product, rotate
from rb_sim.scene.schema import Scene

# Mass properties for foreign poses: from a scene, a URDF, or an rb_sim bag.


MOST = 20_000_000
"""Maximum size of a URDF [bytes]."""


def masses_of(path: str) -> dict[str, Body]:
    """Mass properties by body name. path: scene file, shipped name, or .urdf. Raises RbSimError."""
    scene = scene_of(path)
    return _of_urdf(Path(path)) if scene is None else bodies_of(scene)


def scene_of(path: str) -> Scene | None:
    """Scene of a file or shipped name; None for a .urdf. Raises RbSimError."""
    if Path(path).suffix == ".urdf":
        return None
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene

    return load_scene(find_scene(path))


def bodies_of(scene: Scene) -> dict[str, Body]:
    """Mass properties of a scene's bodies, by name."""
    return {
        name: Body(body.mass, np.array(body.inertia), np.array(body.center_of_mass))
        for name, body in scene.bodies.items()
    }


def scene_with(name: str, body: Body) -> Scene:
    """A scene with this one body and no effects. Raises SceneError."""
    from rb_sim.scene.load import scene_from_plain

    numbers = {"mass": body.mass, "inertia": body.inertia.tolist(),
               "center_of_mass": body.center_of_mass.tolist()}  # fmt: skip
    return scene_from_plain({"bodies": {name: numbers}}, name=name)


def _of_urdf(path: Path) -> dict[str, Body]:
    try:
        if path.stat().st_size > MOST:
            raise RbSimError(f"{path}: larger than {MOST} bytes")
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as error:
        raise RbSimError(f"{path}: cannot read this URDF: {error}") from None
    bodies = {}
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        try:
            bodies[link.get("name", "")] = _body(inertial)
        except (AttributeError, KeyError, TypeError, ValueError):
            name = link.get("name")
            raise RbSimError(
                f"{path}: link {name}: mass or inertia is not as URDF has it"
            ) from None
    if not bodies:
        raise RbSimError(f"{path}: no link with an inertial")
    return bodies


def _body(inertial: ElementTree.Element) -> Body:
    mass, inertia, origin = (inertial.find(name) for name in ("mass", "inertia", "origin"))
    if mass is None or inertia is None:
        raise ValueError("no mass or no inertia")
    xx, xy, xz, yy, yz, zz = (
        float(inertia.attrib[key]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    xyz, rpy = np.zeros(3), np.zeros(3)
    if origin is not None:
        xyz = np.array([float(x) for x in origin.get("xyz", "0 0 0").split()])
        rpy = np.array([float(x) for x in origin.get("rpy", "0 0 0").split()])
    about_x, about_y, about_z = from_rotation_vector(np.diag(rpy))
    q = product(about_z, product(about_y, about_x))
    turn = rotate(q, np.eye(3)).T
    return Body(float(mass.attrib["value"]), turn @ tensor @ turn.T, xyz)


# Velocity jumps (impacts) of a body: poses near them must not be differentiated.
#
# A polynomial through samples on both sides of an impact gives a spurious acceleration of about the
# jump over a few periods. Bags of rb_sim record their impacts as events. In foreign bags a jump is
# detected by its second difference d_k minus the prediction from its neighbours,
#
#     D_k = d_k - 0.9 (d_k-2 + d_k+2) + 0.4 (d_k-3 + d_k+3)
#
# (the cubic through four of them), if |D_k| exceeds noise, and LARGER times all four neighbours.


LOOK = 4
"""Number of samples needed on either side of a jump."""
NEIGHBOURS = {2: 0.9, 3: -0.4}
"""Weights of the neighbouring second differences, by their distance in samples."""
SURE_JUMP = 6.0
"""Standard deviations of D above which it is not noise."""
LARGER = 2.0
"""Minimum ratio of D to its neighbours; an oscillation of up to 1 rad per sample stays below it."""
KEPT = 20
"""Maximum number of intervals listed individually."""
EVENT_COLUMNS = 3


class Struck:
    """Impact times of one body, and the samples excluded around them; bounded memory.

    by_events: the times come from recorded contact events; else they are detected in the poses.
    """

    def __init__(self, by_events: bool = False) -> None:
        self.by_events = by_events
        self.count = self.samples = self.of = 0
        """number of jumps; samples near them; all samples."""
        self.intervals: list[list[float]] = []
        self._times = np.empty(0)
        self._first: list[float] = []
        self._reach = 0.0

    def add(self, times: np.ndarray) -> None:
        """Append impact times [s], increasing."""
        self._times = np.concatenate([self._times, times])
        self.count += len(times)
        self._first += times[: EVENT_COLUMNS - len(self._first)].tolist()

    def look(self, t: np.ndarray, pose: np.ndarray) -> None:
        """Detect jumps in poses (n, 7); successive calls overlap by at least LOOK samples."""
        if self.by_events:
            return
        for part in pieces(t):
            if part.stop - part.start <= 2 * LOOK:
                continue
            at, rows, h = even(t[part], pose[part, :3], pose[part, 3:7])
            last = self._times[-1] if len(self._times) else -np.inf
            fresh = []
            for time in at[jumps(rows)].tolist():
                if time - last > 2.5 * h:
                    fresh.append(time)
                last = max(time, last)
            self.add(np.array(fresh))

    def beside(self, t: np.ndarray, h: float) -> np.ndarray:
        """Mask of the times t (period h) [s] with an impact within the filter's window."""
        reach = self._reach = (WINDOW // 2 + (0.0 if self.by_events else 1.0)) * h
        self._times = self._times[self._times >= t[0] - reach - WINDOW * h]
        k = np.searchsorted(self._times, t - reach)
        padded = np.append(self._times, np.inf)
        found = padded[k] <= t + reach
        self.of += len(t)
        self.samples += int(found.sum())
        self._keep(t, found, h)
        return found

    def _keep(self, t: np.ndarray, found: np.ndarray, h: float) -> None:
        edges = np.flatnonzero(np.diff(np.concatenate([[False], found, [False]]).astype(int)))
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            if self.intervals and t[a] - self.intervals[-1][1] < 1.5 * h:
                self.intervals[-1][1] = float(t[b - 1])
            elif len(self.intervals) < KEPT:
                self.intervals.append([float(t[a]), float(t[b - 1])])

    @property
    def note(self) -> str:
        """A line with the impact times and the excluded samples; "" if there are none."""
        if not self.samples:
            return ""
        at = first_few([f"{t:.6g}" for t in self._first], self.count, EVENT_COLUMNS)
        times = "once" if self.count == 1 else f"{self.count} times"
        what = f"jumps, or moves too fast for the sample rate, {times}"
        if self.by_events:
            what = f"has {self.count} impact{'' if self.count == 1 else 's'}"
        return (
            f"{what} (t = {at} s): poses within {self._reach:.2g} s are not "
            "differentiated; "
            f"{self.samples} of {self.of} samples are excluded from its motion and wrench"
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers."""
        return {"count": self.count, "samples": self.samples, "intervals": self.intervals}


def jumps(rows: np.ndarray) -> np.ndarray:
    """Indices of velocity jumps in evenly sampled poses, shape (7, n)."""
    d = np.diff(rows, 2, axis=1)  # of sample 1 + k
    n, width = d.shape[1], max(NEIGHBOURS)
    middle = d[:, width : n - width]
    beside = {j: d[:, width + j : n - width + j] for k in NEIGHBOURS for j in (-k, k)}
    D = middle - sum(NEIGHBOURS[abs(j)] * part for j, part in beside.items())
    sigma = np.median(np.abs(D), axis=1) / NORMAL
    found = np.zeros(D.shape[1], bool)
    for part, still in ((slice(0, 3), COMPUTED_ROUNDING), (slice(3, 7), 0.0)):
        # of the noisiest component: noise moves between quaternion components as the body turns
        least = max(
            SURE_JUMP * sigma[part].max(), WRITTEN_ROUNDING * np.abs(rows[part]).max(), still
        )
        size = np.linalg.norm(D[part], axis=0)
        others = np.max([np.linalg.norm(b[part], axis=0) for b in beside.values()], axis=0)
        found |= (np.abs(D[part]).max(axis=0) > least) & (size > LARGER * others)
    return np.flatnonzero(found) + width + 1


# Error of the largest acceleration that the filter computes from poses.
#
# A polynomial of order ORDER through WINDOW samples flattens a peak of few samples. The error is
# estimated by the difference from a polynomial of order NEXT through the same samples, and only at
# the largest acceleration, where the extremes of the wrench occur.


NEXT = ORDER + 2
"""Order of the comparison polynomial."""
NOTABLE_ERROR = 0.01
"""Error relative to the largest acceleration above which it is reported."""
SURE_PEAK = 5.0
"""Standard deviations of the noise of the difference below which it is not significant."""
UNITS = ("m/s^2", "rad/s^2")
NAMES = ("acceleration", "angular_acceleration")
HALF = WINDOW // 2


class Peaks:
    """Tracks the largest acceleration of C and the largest angular acceleration of a body."""

    def __init__(self) -> None:
        self._size = [0.0, 0.0]
        self._off: list[float | None] = [None, None]
        """None if it is not significant, or the peak is near an end of the poses."""

    def look(
        self, motion: Motion, squares: Sequence[np.ndarray], kept: np.ndarray, h: float
    ) -> None:
        """Append motion with sample period h [s].

        squares: squared accelerations and angular accelerations, (n,) each; kept: mask of valid
        samples, (n,).
        """
        for j in (0, 1):
            of_kept = np.where(kept, squares[j], 0.0)
            k = int(np.argmax(of_kept))
            size = float(np.sqrt(of_kept[k]))
            if size > self._size[j]:
                self._size[j], self._off[j] = size, _off(motion, j, k, h)

    @property
    def note(self) -> str:
        """A line with the errors that exceed NOTABLE_ERROR; "" if none does."""
        parts = [
            f"{off:.2g} of {size:.3g} {unit}"
            for off, size, unit in zip(self._off, self._size, UNITS, strict=True)
            if off is not None and off > NOTABLE_ERROR * size
        ]
        if not parts:
            return ""
        return (
            f"peak acceleration uncertain by about {' and '.join(parts)} (peaks shorter than the "
            "filter)"
        )

    def as_dict(self) -> dict[str, dict[str, float | None]]:
        """Plain numbers [m/s^2, rad/s^2]."""
        return {
            name: {"largest": size, "off": off}
            for name, size, off in zip(NAMES, self._size, self._off, strict=True)
        }


def _off(motion: Motion, j: int, k: int, h: float) -> float | None:
    """Error estimate of the acceleration (j = 0) or angular acceleration (j = 1) at sample k; None
    if it is not significant."""
    if not HALF <= k < len(motion.t) - HALF:
        return None
    gain, rows, order = ((1.0, motion.position, 2), (2.0, motion.orientation, 2))[j]
    if (read := motion.recorded[j]) is not None:
        gain, rows, order = 1.0, read, 1
    near, own = rows[k - HALF : k + HALF + 1], coefficients(order)
    weights = coefficients(order, NEXT) - own
    of_noise = float(np.linalg.norm(weights) / np.linalg.norm(own))
    scale = gain / h**order
    off = scale * float(np.linalg.norm(weights @ near))
    rounding = scale * WRITTEN_ROUNDING * float(np.abs(near).max() * np.linalg.norm(weights))
    return off if off > max(SURE_PEAK * of_noise * motion.noise[j], rounding) else None


Listener = Callable[[Motion, list[Jump]], None]
STRETCH = 8192
"""Samples differentiated at once; successive blocks overlap by the filter's window."""
COARSE = 0.01
"""Relative error of accelerations above which it is reported."""
NOISY = 0.1
"""Noise of accelerations relative to their RMS above which it is reported."""
UNIT = Body(1.0, np.zeros((3, 3)), np.zeros(3))
"""Substitute for an unknown body: force equals acceleration, torque is 0."""
WRENCH = ("Fx", "Fy", "Fz", "Kx", "Ky", "Kz")
STATE = ("kinetic", "Px", "Py", "Pz", "Lx", "Ly", "Lz")
MOTION = ("vx", "vy", "vz", "wx", "wy", "wz")


class BodyFigures:
    """Statistics of one body from its poses: motion, state, wrench; and the recorded wrench.

    listener: called with each block of motion and the steps back in time before it. struck: impact
    times of the body; without it they are detected in its poses.
    """

    def __init__(
        self, body: Body | None, listener: Listener | None = None, struck: Struck | None = None
    ) -> None:
        self.known = body is not None
        self._struck = struck or Struck()
        self._peaks = Peaks()
        self._listeners = [] if listener is None else [listener]
        self._body = body or UNIT
        self.motion, self.state = Figures(MOTION), Figures(STATE)
        self.wrench, self.recorded = Figures(WRENCH), Figures(WRENCH)
        self._t = np.empty(0)
        self._rows = np.empty((0, 19))
        """pose, total wrench, twist in body axes; NaN if not recorded."""
        self._difference = np.zeros(2)
        self._compared = 0
        self._jumps: list[Jump] = []
        self._by_twist = np.zeros(2, bool)
        """whether velocity and spin come from recorded twists."""
        self._turn = 0.0
        """largest rotation between two samples [rad]."""
        self._poses, self._row = 0, 0
        """number of poses; length of the longest stretch without a gap."""
        self._squares = np.zeros((2, 2))
        """sums of squares: noise of both accelerations; the accelerations themselves."""

    def add(
        self,
        t: np.ndarray,
        pose: np.ndarray,
        recorded: np.ndarray | None = None,
        twist: np.ndarray | None = None,
    ) -> None:
        """Append times (n,) [s], poses (n, 7), total wrenches about C (n, 6) or None, and twists of
        the origin in body axes (n, 6) or None."""
        self._poses += len(t)
        none = np.full((len(t), 6), np.nan)
        others = [none if each is None else each for each in (recorded, twist)]
        self._t = np.concatenate([self._t, t])
        self._rows = np.concatenate([self._rows, np.hstack([pose, *others])])
        if len(self._t) >= STRETCH + LOOK:
            self._t, self._rows = filled(self._t, self._rows)
        while len(self._t) >= STRETCH + LOOK:
            self._differentiate(STRETCH)
            self._t, self._rows = (
                self._t[STRETCH - WINDOW + 1 :],
                self._rows[STRETCH - WINDOW + 1 :],
            )

    def finish(self) -> None:
        """End of the poses, or of one motion."""
        if len(self._t):
            self._t, self._rows = filled(self._t, self._rows)
        self._differentiate(len(self._t))
        self._t, self._rows = self._t[:0], self._rows[:0]
        self._begin_anew()

    def _begin_anew(self) -> None:
        for figures in (self.motion, self.state, self.wrench, self.recorded):
            figures.begin_anew()

    def listen(self, listener: Listener) -> None:
        """Add a listener for later motion."""
        self._listeners.append(listener)

    @property
    def center_of_mass(self) -> np.ndarray:
        """From the body's origin, body axes [m]."""
        return self._body.center_of_mass

    def struck(self, times: np.ndarray) -> None:
        """Register impact times [s]; call before adding the poses around them."""
        self._struck.add(times)

    def _differentiate(self, n: int) -> None:
        self._struck.look(self._t[: n + LOOK], self._rows[: n + LOOK])
        for part in pieces(self._t[:n]):
            t, rows = self._t[:n][part], self._rows[:n][part]
            self._row = max(self._row, len(t))
            if part.start:
                self._begin_anew()
            self._note_jump(part.start)
            twist = rows[:, 13:] if np.isfinite(rows[:, 13:]).all() else None
            motion = differentiated(t, rows[:, :3], rows[:, 3:7], self._body.center_of_mass, twist)
            if motion is None:
                continue
            period = float(motion.t[-1] - motion.t[0]) / max(1, len(motion.t) - 1)
            fastest = float(norms(motion.spin).max())
            self._turn = max(self._turn, period * fastest)
            squares = [np.einsum("ij,ij->i", a, a) for a in (motion.acceleration, motion.turning)]
            noise = len(motion.t) * np.square(motion.noise)
            self._squares += [noise, [each.sum() for each in squares]]
            for listener in self._listeners:
                listener(motion, self._jumps)
            self._by_twist |= [of is not None for of in motion.recorded]
            self._jumps = []
            struck = self._struck.beside(motion.t, period)
            self._peaks.look(motion, squares, ~struck, period)
            self._take(motion, rows[WINDOW // 2 : -(WINDOW // 2), 7:13], ~struck)

    def _take(self, motion: Motion, recorded: np.ndarray, kept: np.ndarray) -> None:
        """Add a block of motion to the statistics, without samples near impacts."""
        if not kept.any():
            return
        which = slice(None) if kept.all() else kept  # a slice copies nothing
        t = motion.t[which]
        wrench, energy, linear, angular = inverse_dynamics(motion, self._body)
        state = np.hstack([energy[:, None], linear, angular])
        self.motion.add(t, np.hstack([motion.velocity, motion.spin])[which])
        self.state.add(t, state[which])
        self.wrench.add(t, wrench[which])
        if np.isfinite(recorded).all():
            self.recorded.add(t, recorded[which])
            apart = (wrench - recorded)[which]
            self._difference += [np.sum(apart[:, :3] ** 2), np.sum(apart[:, 3:] ** 2)]
            self._compared += len(apart)

    def _note_jump(self, k: int) -> None:
        """Record the step back in time before sample k, if any; once, as blocks overlap."""
        if k and self._t[k] < self._t[k - 1]:
            jump = float(self._t[k - 1]), float(self._t[k])
            if jump not in self._jumps:
                self._jumps.append(jump)

    @property
    def notes(self) -> list[str]:
        """Warnings on accuracy, and on samples that are excluded for a jump."""
        peaks = "" if error_at(self._turn) > COARSE else self._peaks.note
        jumps = "" if self._struck.by_events else self._struck.note
        return [line for line in (jumps, peaks, self._quality) if line]

    @property
    def events(self) -> list[str]:
        """A line with the recorded impacts and the samples excluded for them, if any."""
        return [self._struck.note] if self._struck.by_events and self._struck.note else []

    @property
    def _quality(self) -> str:
        """A line if accelerations are inaccurate (sample rate too low, or noise); else ""."""
        error = error_at(self._turn)
        if error > COARSE:
            return (
                f"turns by up to {self._turn:.2g} rad between samples: accelerations and torques "
                f"from poses have an error of {100.0 * min(error, 1.0):.0f} % or more"
            )
        noise, size = np.sqrt(self._squares / max(1, self.motion.rates.count))
        parts = [
            f"{n:.2g} of {s:.2g} {unit}"
            for n, s, unit in zip(noise, size, ("m/s^2", "rad/s^2"), strict=True)
            if n > NOISY * s
        ]
        if not parts:
            return ""
        of = " and ".join(parts)
        return (
            f"acceleration from poses is mostly noise: {of} RMS (noisy poses or stamps, or a "
            "sample "
            "rate too low for the motion)"
        )

    @property
    def _too_few(self) -> str:
        if self._struck.samples:
            return "not differentiated: it " + self._struck.note
        many = "1 pose" if self._poses == 1 else f"{self._poses} poses"
        broken = f", {self._row} at most without a gap" if self._row < self._poses else ""
        return f"{many}{broken}: not differentiated, which needs {WINDOW + 2} in a row"

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers; without mass properties only the motion."""
        if not self.motion.rates.count:
            return {"note": self._too_few}
        found: dict[str, Any] = {"filter": FILTER, "motion": self.motion.as_dict()["values"]}
        found["by_twist"] = dict(zip(("velocity", "spin"), self._by_twist.tolist(), strict=True))
        found["peaks"] = self._peaks.as_dict()
        if self._struck.samples:
            found["struck"] = self._struck.as_dict()
        if not self.known:
            return found
        found |= {
            "state": self.state.as_dict()["values"],
            "wrench": self.wrench.as_dict()["values"],
        }
        if self._compared:
            force, torque = np.sqrt(self._difference / self._compared)
            found["recorded"] = self.recorded.as_dict()["values"]
            found["apart"] = {"force": float(force), "torque": float(torque)}
        return found
