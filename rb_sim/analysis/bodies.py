"""What the poses of one body tell, stretch by stretch: energy, momenta, the wrench they take."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rb_sim.analysis.derivatives import (
    FILTER,
    WINDOW,
    Body,
    Jump,
    Motion,
    differentiated,
    error_at,
    filled,
    inverse_dynamics,
    pieces,
)
from rb_sim.analysis.figures import Figures
from rb_sim.analysis.peaks import Peaks
from rb_sim.analysis.struck import LOOK, Struck
from rb_sim.sinks.frames import norms

Listener = Callable[[Motion, list[Jump]], None]
STRETCH = 8192
"""Samples that are differentiated at once; stretches overlap by the filter's window."""
COARSE = 0.01
"""Relative error of accelerations from which on it is told."""
NOISY = 0.1
"""Noise of accelerations, of their RMS, from which on it is told."""
UNIT = Body(1.0, np.zeros((3, 3)), np.zeros(3))
"""Where no mass is known: force is acceleration, and there is no torque."""
WRENCH = ("Fx", "Fy", "Fz", "Kx", "Ky", "Kz")
STATE = ("kinetic", "Px", "Py", "Pz", "Lx", "Ly", "Lz")
MOTION = ("vx", "vy", "vz", "wx", "wy", "wz")


class BodyFigures:
    """Follows the poses of one body, and the total wrench that was recorded for it if any.

    listener: gets the motion, stretch by stretch, and where the stamps went back before it.
    struck: told when the body was struck; else that is looked for in its poses.
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
        """pose, total wrench, twist in the body's axes; NaN where not known."""
        self._difference = np.zeros(2)
        self._compared = 0
        self._jumps: list[Jump] = []
        self._by_twist = np.zeros(2, bool)
        """whether velocity and spin were those of recorded twists."""
        self._turn = 0.0
        """largest turn between two samples [rad]."""
        self._poses, self._row = 0, 0
        """how many came, and how many of them in one stretch at most."""
        self._squares = np.zeros((2, 2))
        """summed over the samples: accelerations and angular ones, of their noise and of them."""

    def add(
        self,
        t: np.ndarray,
        pose: np.ndarray,
        recorded: np.ndarray | None = None,
        twist: np.ndarray | None = None,
    ) -> None:
        """Times (n,), poses (n, 7), total wrenches about C (n, 6) or None, twists of the origin in
        the body's axes (n, 6) or None."""
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
        """No more poses come, or they go on with another motion."""
        if len(self._t):
            self._t, self._rows = filled(self._t, self._rows)
        self._differentiate(len(self._t))
        self._t, self._rows = self._t[:0], self._rows[:0]
        self._begin_anew()

    def _begin_anew(self) -> None:
        for figures in (self.motion, self.state, self.wrench, self.recorded):
            figures.begin_anew()

    def listen(self, listener: Listener) -> None:
        """Another one gets the motion from now on."""
        self._listeners.append(listener)

    @property
    def center_of_mass(self) -> np.ndarray:
        """From the body's origin, in its axes."""
        return self._body.center_of_mass

    def struck(self, times: np.ndarray) -> None:
        """The body is struck at these instants, before the next poses come."""
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
            self._by_twist |= np.array(motion.by_twist)
            self._jumps = []
            struck = self._struck.beside(motion.t, period)
            self._peaks.look(motion, squares, ~struck, period)
            self._take(motion, rows[WINDOW // 2 : -(WINDOW // 2), 7:13], ~struck)

    def _take(self, motion: Motion, recorded: np.ndarray, kept: np.ndarray) -> None:
        """Figures of a motion, but for where the body is struck."""
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
        """Keep the step back before sample k, if it is one; stretches overlap: only once."""
        if k and self._t[k] < self._t[k - 1]:
            jump = float(self._t[k - 1]), float(self._t[k])
            if jump not in self._jumps:
                self._jumps.append(jump)

    @property
    def notes(self) -> list[str]:
        """What is not to be trusted, and what was left out."""
        peaks = "" if error_at(self._turn) > COARSE else self._peaks.note
        return [line for line in (self._struck.note, peaks, self._quality) if line]

    @property
    def _quality(self) -> str:
        """Where the samples are too few for the motion, or too noisy: by how much the accelerations
        are off; or ""."""
        error = error_at(self._turn)
        if error > COARSE:
            return (
                f"turns by up to {self._turn:.2g} rad between samples: its accelerations and "
                f"torques from poses are off by {100.0 * min(error, 1.0):.0f} % or more"
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
            "its poses or stamps are noisy, or too few for so fast a motion: of its accelerations "
            f"{of} are not to be trusted (RMS)"
        )

    @property
    def _too_few(self) -> str:
        if self._struck.samples:
            return "nothing is differentiated: it " + self._struck.note
        many = "1 pose" if self._poses == 1 else f"{self._poses} poses"
        broken = f", {self._row} at most without a gap" if self._row < self._poses else ""
        return f"{many}{broken}: nothing is differentiated, which takes {WINDOW + 2} in a row"

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
