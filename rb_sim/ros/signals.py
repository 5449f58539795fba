"""SIGINT and SIGTERM: a request to stop after the present sample."""

from __future__ import annotations

import signal


class StopRequest:
    """Set by the first signal; a second one interrupts at once (KeyboardInterrupt)."""

    def __init__(self) -> None:
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
        if self.cause:
            raise KeyboardInterrupt
        self.cause = signal.Signals(number).name
