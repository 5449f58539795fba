"""A case: a scene, how it is run, what must hold, and why it is hard; one YAML file each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rb_sim.errors import RbSimError
from rb_sim.scene.schema import METHODS
from rb_sim.scene.yaml_reader import parse, read_text

SUFFIX = ".yaml"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Setting(_Strict):
    """One way to run the scene."""

    method: Literal[METHODS]  # type: ignore[valid-type]
    step: float | None = Field(default=None, gt=0.0)
    tolerance: float | None = Field(default=None, gt=0.0)
    duration: float | None = Field(default=None, gt=0.0)
    """instead of the scene's, where the method needs more steps [s]."""


class Check(_Strict):
    """What must hold of every run.

    energy: change of energy less work, over what was exchanged. momentum: the worse of both
    balances. residual: violation of constraints. formula: largest size of a formula over the
    samples. against: largest pose difference to another setting. told: that a watch speaks, or the
    run is refused; the figure is 0 then, else 1. refused: likewise, only by an error.
    """

    figure: Literal["energy", "momentum", "residual", "formula", "against", "told", "refused"]
    formula: str = ""
    against: Setting | None = None
    words: str = ""
    """what an error must say, of refused and told."""
    bound: float = Field(default=0.5, gt=0.0)
    because: str = ""
    """how the bound follows from order, step and conditioning."""

    @model_validator(mode="after")
    def _complete(self) -> Check:
        if self.figure == "formula" and not self.formula:
            raise ValueError("figure formula needs a formula")
        if self.figure == "against" and self.against is None:
            raise ValueError("figure against needs a setting: against: {method: ...}")
        return self


class Case(_Strict):
    """One hard case."""

    title: str
    why: str
    """why it is hard."""
    engines: Mapping[str, str] = {}
    """engines known to fail it, and how; or to hold it, where they do."""
    quick: bool = False
    """whether it is cheap enough for `--quick` and for every run of the tests."""
    limit: str = ""
    """what is not held today, and why: the row is then told as it is and does not fail."""
    scene: Mapping[str, Any] | str
    """as in a scene file, or the name of a shipped scene."""
    runs: tuple[Setting, ...] = Field(min_length=1)
    checks: tuple[Check, ...] = Field(min_length=1)
    name: str = ""


def load_case(path: Path) -> Case:
    """The case in a file. Raises RbSimError in one line for what is not one."""
    mapping = parse(read_text(path), str(path))
    if not isinstance(mapping, Mapping):
        raise RbSimError(f"{path}: a case must be a mapping with title, why, scene, runs, checks")
    try:
        return Case.model_validate({**mapping, "name": path.stem})
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise RbSimError(f"{path}: {key}: {first['msg']}") from None


def load_cases(folder: Path, only: Sequence[str] = ()) -> list[Case]:
    """The cases of a folder whose names have one of the parts `only`; all without.

    Raises RbSimError if there are none, or none with one of the parts.
    """
    paths = sorted(folder.glob(f"*{SUFFIX}"))
    allowed = ", ".join(path.stem for path in paths)
    if not paths:
        raise RbSimError(f"{folder}: has no case (a file *{SUFFIX})")
    for part in only:
        if not any(part in path.stem for path in paths):
            what = f"case with {part!r} in its name"
            raise RbSimError(f"{folder}: has no {what}; there are {allowed}")
    wanted = [path for path in paths if not only or any(part in path.stem for part in only)]
    return [load_case(path) for path in wanted]
