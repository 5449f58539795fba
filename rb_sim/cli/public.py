# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The verbs of the command line as functions that return their results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import named_if_lacking

if TYPE_CHECKING:
    from rb_sim.bags.analysis.analysis_page import Analysis
    from rb_sim.bags.compare import Differences
    from rb_sim.bags.fit.unknowns import Fitted
    from rb_sim.equilibrium.state_space import LinearModel
    from rb_sim.equilibrium.statics_tables import StaticsResult
    from rb_sim.scene.schema import Scene

Source = str | PathLike[str] | Mapping[str, Any]
"""Source of a scene: a file, the name of a shipped scene, or a mapping."""


@named_if_lacking()
def statics(scene: Scene | Source) -> StaticsResult:
    """Reactions that hold the bodies of a scene at rest, with their ranges, or why there are none.

    Args:
        scene: File, name of a shipped scene, mapping, or loaded scene; bodies stand at their
            initial poses, velocities and commands count as zero.

    Returns:
        Verdict, reactions and ranges: forces [N] and torques [N m] by the support on the body,
        world axes.

    Raises:
        SceneError: The scene is not valid, or its initial pose violates a constraint.
    """
    from rb_sim.equilibrium.statics import solve
    from rb_sim.scene.load import load_statics

    return solve(load_statics(scene) if isinstance(scene, (str, PathLike, Mapping)) else scene)


@named_if_lacking()
def compare(
    bag: str | PathLike[str],
    other: str | PathLike[str],
    *,
    align: str | None = None,
    match: Mapping[str, str] | None = None,
    wrenches: Sequence[str] = (),
) -> Differences:
    """Compare a recorded motion with a bag, a CSV file, or a scene simulated with its commands.

    Args:
        bag: Folder or file of the recorded motion.
        other: Bag, CSV or TUM file (t, x, y, z, qx, qy, qz, qw), scene file, or shipped scene.
        align: How the clocks are matched: "none", "first" (first stamps together), "offset"
            (estimated) or "clock" (offset and drift); None: an offset if the times do not overlap.
        match: Name in the bag -> name in `other`, for bodies that are named differently.
        wrenches: Topics of applied wrenches in a bag of another program, TOPIC or BODY=TOPIC, or
            "none"; by default those whose frame or name is that of a body.

    Returns:
        Differences of position [m], attitude [rad], velocities and reactions over time.

    Raises:
        RbSimError: A file cannot be read, or the two have no body or no time in common.
    """
    from rb_sim.bags.compare import differences
    from rb_sim.cli.verbs import compare as verb

    pairs = [f"{name}={of}" for name, of in (match or {}).items()]
    options = verb.CompareOptions(
        Path(bag), str(other), align=align, match=pairs, wrench=list(wrenches)
    )
    a = verb.first_tracks(options)
    return differences(a, verb.other_tracks(options, a), align=align, match=match)


@named_if_lacking()
def analyze(
    bag: str | PathLike[str],
    *,
    topics: Sequence[str] | None = None,
    masses: str | PathLike[str] | None = None,
) -> Analysis:
    """Rates, gaps, energy, momenta, wrenches and spectra of any bag with poses.

    Args:
        bag: Folder or file, MCAP or SQLite, also of another program.
        topics: Topics to read; None: all with a known type.
        masses: Scene file or URDF with the masses; needed for balances in bags of other programs.

    Returns:
        The figures of each source of the bag, SI units.

    Raises:
        RbSimError: The file is not a bag, has no readings, or `masses` cannot be read.
    """
    from rb_sim.bags.analysis.bodies import masses_of, scene_of
    from rb_sim.bags.analysis.recorded_run import analyze as read

    given = None if masses is None else str(masses)
    return read(
        Path(bag),
        topics=frozenset(topics or ()) or None,
        masses=None if given is None else masses_of(given),
        scene=None if given is None else scene_of(given),
    )


@named_if_lacking()
def fit(
    bag: str | PathLike[str],
    free: str | Sequence[str],
    *,
    scene: str | PathLike[str] | None = None,
    match: Mapping[str, str] | None = None,
    wrenches: Sequence[str] = (),
    noise: tuple[float, float] | None = None,
) -> Fitted:
    """Fit numbers of a scene to a recorded motion by least squares of the poses.

    Args:
        bag: Folder or file of the recorded motion.
        free: Paths of the numbers to fit in the scene, e.g. "bodies.top.mass".
        scene: Scene file or shipped scene instead of that in the bag.
        match: Body of the scene -> name of its pose in the bag.
        wrenches: Topics of applied wrenches, as in `compare`.
        noise: Standard deviation of the recorded poses ([m], [rad]); None: estimated.

    Returns:
        Fitted values with standard errors and correlations.

    Raises:
        RbSimError: A path names no number of the scene, or the bag cannot be read.
        SimulationError: The scene cannot be simulated with its initial values.
    """
    from rb_sim.bags.fit.fit import fit as solve
    from rb_sim.cli.verbs import fit as verb

    keys = [free] if isinstance(free, str) else list(free)
    pairs = [f"{name}={body}" for body, name in (match or {}).items()]
    named = None if scene is None else str(scene)
    options = verb.FitOptions(
        Path(bag), keys, named, match=pairs, wrench=list(wrenches), noise=noise
    )
    built, data, recording = verb.set_up(options)
    return solve(recording, built, data, keys, noise)


@named_if_lacking()
def linearize(
    scene: Scene | Source, at: float = 0.0, *, axes: str = "world", turning: float = 0.0
) -> LinearModel:
    """Linear model of small deviations from the motion of a scene.

    Args:
        scene: File, name of a shipped scene, mapping, or loaded scene; joints only, no contacts.
        at: Simulated time at which the model is taken [s].
        axes: "world", or "body" for axes that turn with each body.
        turning: Rate at which the world's axes turn about z [rad/s], for a motion that is steady
            as seen from there.

    Returns:
        Matrices A, B, C, D with names of states, inputs and outputs, and eigenvalues [1/s].

    Raises:
        RbSimError: The scene has contacts, or an argument is not allowed.
        SimulationError: The motion does not reach `at`, or a law has no derivative there.
    """
    from rb_sim.simulation.simulation import Simulation

    simulation = Simulation(scene)
    simulation.advance(at)
    return simulation.linearize(axes, turning)
