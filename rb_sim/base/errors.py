# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What can go wrong, said in one line that names the field, the value and what is allowed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class RbSimError(Exception):
    """Base of all errors of rb_sim; its text is one line: mistake and allowed values."""


class SceneError(RbSimError):
    """The scene is not valid, or cannot be simulated.

    Attributes:
        file: Path of the scene file, or "<scene>" for one made in memory.
        key: Path of the key concerned, e.g. "bodies.ball.mass"; "" for the file itself.
        message: The mistake and the allowed values.
    """

    def __init__(self, message: str, *, key: str = "", file: str = "<scene>") -> None:
        self.message = message
        self.key = key
        self.file = file
        super().__init__(": ".join(part for part in (file, key, message) if part))


class UnknownNameError(RbSimError, KeyError):
    """A name that does not exist in a mapping of a run; also a KeyError."""

    def __str__(self) -> str:
        return str(self.args[0])


class MissingExtraError(RbSimError):
    """A library is not installed that is loaded when it is used; the text says what to install.

    extra: that brings it, or "" for one that comes with rb_sim.
    """

    def __init__(self, library: str, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs the package {library!r}: install it with pip install "
            + (f"'rb_sim[{extra}]'" if extra else library)
        )


class SimulationError(RbSimError):
    """The integration cannot go on; the text has time, reason and, if it helps, a step."""


class StepTooLargeError(SimulationError):
    """The state is no longer finite under a fixed step, which another step may mend."""


class AccuracyWarning(UserWarning):
    """An accuracy check failed; the text has quantity, value, limit, time, body and advice."""


class SceneWarning(UserWarning):
    """A value of a scene that users of other programs often mean differently; the text states its
    meaning here."""


class SinkError(RbSimError):
    """A recording that cannot be opened, written on or read; the text names the file.

    After a write the sink that raised it is closed; the caller drops it and goes on.
    """


def check_ending(path: Path | None, ending: str) -> None:
    """Refuse a file name with another ending. Raises SinkError."""
    if path is not None and path.suffix != ending:
        raise SinkError(f"{path}: the name must end in {ending}")


@contextmanager
def named_if_lacking() -> Iterator[None]:
    """Within it, and in a function that it decorates: an ImportError for a package that rb_sim
    needs says in one line which and how to get it."""
    try:
        yield
    except ImportError as error:
        from rb_sim.base.installed import complaint

        if not (line := complaint(error=error)):
            raise
        raise ImportError(line.removeprefix("error: "), name=error.name) from None
