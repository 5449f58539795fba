"""What can go wrong, said in one line that names the field, the value and what is allowed."""

from __future__ import annotations


class RbSimError(Exception):
    """An error of the user's making or of the outside world; its text is the whole message."""


class SceneError(RbSimError):
    """A scene that cannot be simulated.

    file: path of the scene file, or "<scene>" for one made in memory.
    key: dotted path of the offending field, e.g. "bodies.ball.mass"; "" for the file itself.
    """

    def __init__(self, message: str, *, key: str = "", file: str = "<scene>") -> None:
        self.message = message
        self.key = key
        self.file = file
        super().__init__(": ".join(part for part in (file, key, message) if part))


class UnknownNameError(RbSimError, KeyError):
    """A name that is not among those there are; also a KeyError, as of every mapping."""

    def __str__(self) -> str:
        return str(self.args[0])


class MissingExtraError(RbSimError):
    """An optional library is not installed; the text says what to install."""

    def __init__(self, library: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs the package {library!r}: "
            f"install it with pip install 'rb_sim[{extra}]'"
        )


class SimulationError(RbSimError):
    """The integration cannot go on (state no longer finite, step underflow)."""


class StepTooLargeError(SimulationError):
    """The state is no longer finite under a fixed step, which another step may mend."""


class AccuracyWarning(UserWarning):
    """A run goes on with a loss of accuracy; the text has quantity, value, limit, time, body and
    advice."""


class SceneWarning(UserWarning):
    """A value of a scene that is often meant differently; the text has its meaning here."""


class SinkError(RbSimError):
    """A recording that cannot be opened, written on or read; the text names the file.

    After a write the sink that raised it is closed; the caller drops it and goes on.
    """
