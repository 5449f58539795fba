"""SIGINT and SIGTERM: at once during the start (compiling may take long), else after the sample."""

from __future__ import annotations

import signal


class StopRequest:
    """Set by the first signal. Interrupts (KeyboardInterrupt) if hasty, or at a second one."""

    def __init__(self) -> None:
        self.hasty = True
        """nothing has to be finished first."""
        self.cause = ""
        """name of the signal."""

    @property
    def requested(self) -> bool:
        """A signal has come."""
        return bool(self.cause)

    def listen(self) -> None:
        """Take both signals over from Python and rclpy."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, number: int, _: object) -> None:
        again, self.cause = bool(self.cause), signal.Signals(number).name
        if again or self.hasty:
            raise KeyboardInterrupt
