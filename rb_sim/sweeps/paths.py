"""Numbers in a scene by their path: `bodies.coin.position[2]`, `effects.weight.acceleration[2]`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from rb_sim.catalogue.spec import one_of
from rb_sim.errors import SceneError

Path = tuple[str | int, ...]

_STEP = re.compile(r"\.?([A-Za-z_][A-Za-z0-9_]*)|\[(\d+)\]")


def parse(text: str, file: str) -> Path:
    """The keys and indices that `text` names.

    Raises SceneError where it is no path.
    """
    steps: list[str | int] = []
    at = 0
    while at < len(text):
        match = _STEP.match(text, at)
        if match is None or (at == 0 and match[0].startswith((".", "["))):
            break
        steps.append(match[1] if match[1] is not None else int(match[2]))
        at = match.end()
    if not text or at < len(text):
        allowed = "must be a path like bodies.coin.position[2]"
        raise SceneError(f"got {text!r}; {allowed}", key="path", file=file)
    return tuple(steps)


def replaced(data: Any, path: Path, value: Any, whole: str, file: str) -> Any:
    """A copy of `data` that has `value` at `path`; what the path does not touch is shared.

    A last key that is absent is added (the scene's own check says whether it exists).
    whole: the path as the user wrote it. Raises SceneError where the scene has nothing there.
    """
    if not path:
        return value
    first, rest = path[0], path[1:]
    if isinstance(data, Mapping) and isinstance(first, str):
        if first in data or not rest:
            below = data.get(first)
            return {**data, first: replaced(below, rest, value, whole, file)}
        raise _absent(whole, f"must be {one_of(first, data)} at {first}", file)
    if isinstance(data, (list, tuple)) and isinstance(first, int) and first < len(data):
        changed = list(data)
        changed[first] = replaced(data[first], rest, value, whole, file)
        return changed
    raise _absent(whole, f"the scene has no list or mapping with {first!r} there", file)


def check_apart(named: Sequence[tuple[str, Path]], file: str) -> None:
    """Raise SceneError where two paths lead to the same number: one value would undo the other.

    named: the paths as written and as parsed.
    """
    for i, (text, path) in enumerate(named):
        for other, before in named[:i]:
            if path[: len(before)] == before[: len(path)]:
                why = f"{other!r} goes there, too: must be a number that nothing else sets"
                raise SceneError(f"got {text!r}; {why}", key="path", file=file)


def with_default(data: Any, defaults: Any, path: Path) -> Any:
    """A copy of `data` in which what `path` goes through is there, taken from `defaults` if absent.

    defaults: the same scene with every default written out.
    """
    if not path or not isinstance(data, Mapping) or not isinstance(defaults, Mapping):
        return data
    first, rest = path[0], path[1:]
    if first in data:
        return {**data, first: with_default(data[first], defaults.get(first), rest)}
    return {**data, first: defaults[first]} if rest and first in defaults else data


def _absent(path: str, why: str, file: str) -> SceneError:
    return SceneError(f"got {path!r}; {why}", key="path", file=file)
