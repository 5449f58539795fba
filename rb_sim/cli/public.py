"""The verbs of the command line as functions of the package: they return what the verbs print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rb_sim.bags.analysis.result import Analysis
    from rb_sim.bags.compare import Differences
    from rb_sim.fit.unknowns import Fitted
    from rb_sim.linear import LinearModel
    from rb_sim.scene.schema import Scene
    from rb_sim.statics.result import StaticsResult

Source = str | PathLike[str] | Mapping[str, Any]
"""Of a scene: a file, the name of a shipped one, or a mapping."""


def statics(scene: Scene | Source) -> StaticsResult:
    """The reactions that hold the bodies of a scene at rest, with their ranges, or why there is
    no equilibrium.

    scene: at its initial pose. Raises SceneError.
    """
    from rb_sim.scene.load import load_statics
    from rb_sim.statics.solve import solve

    return solve(load_statics(scene) if isinstance(scene, (str, PathLike, Mapping)) else scene)


def compare(
    bag: str | PathLike[str],
    other: str | PathLike[str],
    *,
    align: str | None = None,
    match: Mapping[str, str] | None = None,
    wrenches: Sequence[str] = (),
) -> Differences:
    """Compare a recorded motion with a bag, a CSV file, or a scene simulated as it was recorded.

    align: none, first, offset or clock; match: name in the bag to name in the other. wrenches:
    topics of applied wrenches in a bag not recorded by rb_sim (TOPIC or BODY=TOPIC), or "none";
    default: by frame and name.
    """
    from rb_sim.bags.compare import differences
    from rb_sim.cli.verbs import compare as verb

    pairs = tuple(f"{name}={of}" for name, of in (match or {}).items())
    options = verb.CompareOptions(
        Path(bag), str(other), align=align, match=pairs, wrench=tuple(wrenches)
    )
    a = verb.first_tracks(options)
    return differences(a, verb.other_tracks(options, a), align=align, match=match)


def analyze(
    bag: str | PathLike[str],
    *,
    topics: Sequence[str] | None = None,
    masses: str | PathLike[str] | None = None,
) -> Analysis:
    """Rates, gaps, energy, momenta, wrenches and spectra of any bag with poses.

    masses: a scene or a .urdf, for bags of others.
    """
    from rb_sim.bags.analysis.analyze import analyze as read
    from rb_sim.bags.analysis.masses import masses_of, scene_of

    given = None if masses is None else str(masses)
    return read(
        Path(bag),
        topics=frozenset(topics or ()) or None,
        masses=None if given is None else masses_of(given),
        scene=None if given is None else scene_of(given),
    )


def fit(
    bag: str | PathLike[str],
    free: str | Sequence[str],
    *,
    scene: str | PathLike[str] | None = None,
    match: Mapping[str, str] | None = None,
    wrenches: Sequence[str] = (),
    noise: tuple[float, float] | None = None,
) -> Fitted:
    """The numbers of a scene, as bodies.top.mass, that make it follow a recorded motion.

    scene: instead of that in the bag; match: body to pose; wrenches: as of `compare`; noise: of
    poses [m, rad].
    """
    from rb_sim.cli.verbs import fit as verb
    from rb_sim.fit.fit import fit as solve

    keys = [free] if isinstance(free, str) else list(free)
    pairs = tuple(f"{name}={body}" for body, name in (match or {}).items())
    named = None if scene is None else str(scene)
    options = verb.FitOptions(
        Path(bag), ",".join(keys), named, match=pairs, wrench=tuple(wrenches), noise=noise
    )
    built, data, recording = verb.set_up(options)
    return solve(recording, built, data, keys, noise)


def linearize(
    scene: Scene | Source, at: float = 0.0, *, axes: str = "world", turning: float = 0.0
) -> LinearModel:
    """The linear model of small deviations from the motion of a scene, at the instant `at` [s].

    axes, turning, errors: as of `Simulation.linearize`.
    """
    from rb_sim.simulation.simulation import Simulation

    simulation = Simulation(scene)
    simulation.advance(at)
    return simulation.linearize(axes, turning)
