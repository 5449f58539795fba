# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Packages that are also the function of their name: rb_sim.fit(...) and rb_sim.fit.fit.fit."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

from rb_sim.base.errors import named_if_lacking


class Called(ModuleType):
    """A package that calls the function of its name in rb_sim.cli.public."""

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """As that function."""
        name = self.__name__.rpartition(".")[2]
        with named_if_lacking():
            function = getattr(import_module("rb_sim.cli.public"), name)
        return function(*arguments, **keywords)
