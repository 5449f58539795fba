# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Missing or outdated packages, and how to install them.

Checked only after an import has failed, so that a successful start costs nothing.
"""

from __future__ import annotations

import ast
import re
from importlib import metadata
from pathlib import Path

_BOUND = re.compile(r"([A-Za-z0-9_.-]+)\s*(?:\[[^]]*\])?\s*\(?([^;)]*)")
_NUMBERS = re.compile(r"\d+")


def lacking(requirements: list[str] | None = None) -> list[tuple[str, str]]:
    """(problem, requirement) of each unmet requirement; of rb_sim's own requirements by default."""
    found = []
    for requirement in _recorded() if requirements is None else requirements:
        if "extra ==" in requirement:
            continue
        match = _BOUND.match(requirement)
        if match is None:
            continue
        name, bounds = match[1], match[2].strip()
        lowest = re.search(r">=\s*([0-9.]+)", bounds)
        needs = name + bounds.replace(" ", "")
        try:
            version = metadata.version(name)
        except metadata.PackageNotFoundError:
            found.append((f"{name} is not installed", needs))
            continue
        if lowest and _numbers(version) < _numbers(lowest[1]):
            found.append((f"{name} is {version} and must be at least {lowest[1]}", needs))
    return found


def _recorded() -> list[str]:
    """Requirements of rb_sim, as recorded by pip and colcon; in a bare checkout from its
    setup.py."""
    try:
        return metadata.requires("rb_sim") or []
    except metadata.PackageNotFoundError:
        setup = Path(__file__).parents[2] / "setup.py"
        tree = ast.parse(setup.read_text(encoding="utf-8") if setup.is_file() else "")
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg == "install_requires":
            return ast.literal_eval(node.value)
    return []


def _numbers(version: str) -> list[int]:
    return [int(number) for number in _NUMBERS.findall(version)[:3]]


def complaint(requirements: list[str] | None = None, error: BaseException | None = None) -> str:
    """One line on missing packages with the command that installs them; "" if none is missing.

    error: exception of the failed start; a module that it misses is named even if it is not
    recorded.
    """
    found = lacking(requirements)
    if not found and isinstance(error, ModuleNotFoundError) and error.name:
        package = error.name.partition(".")[0]
        found = [] if package == "rb_sim" else [(f"{package} is not installed", package)]
    if not found:
        return ""
    wrong = "; ".join(text for text, _ in found)
    wanted = " ".join(f"'{needs}'" for _, needs in found)
    return (
        f"error: {wrong}: pip install {wanted} (beside apt's packages of ROS: in a venv made with"
        " --system-site-packages)"
    )
