"""Values by name that say which names there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from rb_sim.base.errors import UnknownNameError

T = TypeVar("T")


class ByName(dict[str, T]):
    """A dict whose KeyError tells what was asked for and what is allowed.

    what: a value of it is called so.
    """

    def __init__(self, what: str, values: Mapping[str, T]) -> None:
        super().__init__(values)
        self._what = what

    def __missing__(self, name: object) -> T:
        from rb_sim.catalogue.spec import one_of  # pydantic loads for it

        allowed = f"must be {one_of(name, self)}" if self else "there is none in this run"
        raise UnknownNameError(f"{self._what}: got {name!r}; {allowed}")

    def __reduce__(self) -> tuple[type[ByName[T]], tuple[str, dict[str, T]]]:
        return ByName, (self._what, dict(self))
