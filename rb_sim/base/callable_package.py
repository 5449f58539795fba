"""Packages that are also the function of their name: rb_sim.fit(...) and rb_sim.fit.fit.fit."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any


class Called(ModuleType):
    """A package that calls the function of its name in rb_sim.cli.public."""

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """As that function."""
        name = self.__name__.rpartition(".")[2]
        return getattr(import_module("rb_sim.cli.public"), name)(*arguments, **keywords)
