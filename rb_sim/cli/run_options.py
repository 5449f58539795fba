"""What the command line says of a run: its options, checked, and the scene with them in place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.errors import RbSimError, SceneError

if TYPE_CHECKING:
    from rb_sim.scene.schema import Scene


@dataclass(frozen=True)
class RunOptions:
    """What the command line says. None: the scene's own value, or the default."""

    scene: str
    out: Path | None = None
    overwrite: bool = False
    """whether logs of another run in `out` are replaced."""
    duration: float | None = None
    rate: float | None = None
    method: str | None = None
    step: float | None = None
    tolerance: float | None = None
    bag: bool = True
    rerun: bool | None = None
    plots: bool = True
    npz: Path | None = None
    accelerations: bool = False
    quiet: bool = False
    wall_stamps: bool = False
    strict: bool = False
    certify: bool = False
    check: bool | None = None
    """whether a second run is made; None: where stepping took less than about a second."""
    max_wall: float | None = None
    changes: tuple[str, ...] = ()
    """KEY=VALUE in place of values of the scene."""
    split_size: int | None = None
    split_duration: float | None = None


def given(options: RunOptions) -> dict[str, Any]:
    """What the command line puts in place of the scene's own values."""
    from rb_sim.scene.load import OVERRIDES

    values = {name: getattr(options, name) for name in OVERRIDES}
    return {name: value for name, value in values.items() if value is not None}


def splitting(options: RunOptions) -> dict[str, Any]:
    """Where the bag is split, for BagSink. Raises RbSimError."""
    from rb_sim.sinks.bag import LEAST_SPLIT

    size, duration = options.split_size, options.split_duration
    if size is not None and size < LEAST_SPLIT:
        raise RbSimError(f"--split-size: got {size}; must be at least {LEAST_SPLIT} bytes")
    if duration is not None and not duration > 0.0:
        raise RbSimError(f"--split-duration: got {duration:g}; must be > 0 s")
    return {"split_size": size, "split_duration": duration}


def scene_of(options: RunOptions) -> Scene:
    """The scene with the options in place of its own values; SceneError, RbSimError."""
    from rb_sim.cli.scenes import scene_to_run
    from rb_sim.scene import yaml_reader
    from rb_sim.scene.load import OVERRIDES, as_run_text, scene_from_mapping
    from rb_sim.sinks.as_run import with_value

    overrides = {name: getattr(options, name) for name in OVERRIDES}
    try:
        scene = scene_to_run(options.scene, overrides)
        if not options.changes:
            return scene
        data = yaml_reader.parse(as_run_text(scene), scene.file)
        for change in options.changes:
            data = with_value(data, change)
        return scene_from_mapping(data, name=scene.name, file=scene.file)
    except SceneError as error:
        section, _, name = error.key.partition(".")
        if section == "override":
            raise RbSimError(f"--{name}: {error.message}") from None
        raise


def check_accelerations(options: RunOptions, scene: Scene) -> None:
    """Refuse accelerations that nothing would hold, or that a method has none of; RbSimError."""
    if not options.accelerations:
        return
    written = options.out is not None and (options.plots or options.bag)
    if options.npz is None and not written:
        raise RbSimError("--accelerations: give --out DIR for bag and plots, or --npz FILE.npz")
    if scene.simulation.method == "time_stepping":
        raise RbSimError("--accelerations: method time_stepping has none; give another --method")


def check_npz(path: Path | None) -> None:
    """Refuse a name that numpy would change; make its folder. Raises RbSimError."""
    if path is None:
        return
    if path.suffix != ".npz":
        raise RbSimError(f"--npz {path}: the name must end in .npz")
    try:
        path.absolute().parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RbSimError(f"--npz {path}: cannot make its folder: {error.strerror}") from None
