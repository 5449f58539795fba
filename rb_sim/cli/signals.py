"""SIGINT and SIGTERM while a scene runs: finish what is logged, then leave."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """Takes both signals over for the time of a `with` block.

    The first one raises KeyboardInterrupt, or is only noted while `noted_only` is set, so that no
    sink is left in the middle of a write. A second one always raises.
    """

    def __init__(self) -> None:
        self.cause: signal.Signals | None = None
        self.noted_only = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interruption:
        self._before = {number: signal.signal(number, self._take) for number in SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @property
    def exit_code(self) -> int:
        """As a shell gives it: 128 + the signal's number; 0 without one."""
        return 0 if self.cause is None else 128 + self.cause

    def _take(self, number: int, _: FrameType | None) -> None:
        again = self.cause is not None
        self.cause = signal.Signals(number)
        if again or not self.noted_only:
            raise KeyboardInterrupt
