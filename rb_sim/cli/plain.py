# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Console for tables and lines without markup."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


WIDTH = 160
"""Width of a line in a file or a pipe [characters]: long names are not folded there."""


def width() -> int | None:
    """Width of a line of standard output [characters]; None: that of the terminal."""
    return None if sys.stdout.isatty() else WIDTH


def plain_console(**options: Any) -> Console:
    """A console without markup: brackets of units, topics and paths would be taken for it (`[ms]`
    would vanish, `[/]` raise an error)."""
    from rich.console import Console

    given: dict[str, Any] = {"width": width(), **options}
    return Console(markup=False, emoji=False, **given)
