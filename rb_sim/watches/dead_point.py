"""Whether constraints come to depend on each other on the way: a dead point, or the end of a way.

Let s be the root of the least pivot of A = G M^-1 G^T relative to its diagonal element, over the
lines that were independent at the start.  Where the lines lose rank s passes through zero as |x|
does, so that around a dead point the samples of s make a V whose two lowest add up to one step of
its sides.  What comes after one, the laws of motion do not decide.

Where lines depend on each other for good some are left out, in loops those that are chosen after
each step: s is of the best choice, then.  Where the choice is that of the start (long loops), those
that are kept may lose rank on the way although all together do not: the laws decide, but the choice
is a bad one there and the motion loses digits.  That is told apart by the eigenvalues of A over all
lines.

States between samples are looked at, too (see `vanishing`), where bodies turn by much from one to
the next.  Once a run is long only every few samples are, and of some blocks a part closely.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.engine.independent import Dependent
from rb_sim.engine.manifold import lines_left, lines_matrix
from rb_sim.engine.multibody_laws import MultiBodyLaws
from rb_sim.errors import RbSimError
from rb_sim.finding import Finding
from rb_sim.graph.machine import evaluate_rows
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.initial import part_of
from rb_sim.scene.place import InitialPlace
from rb_sim.watches.vanishing import KEPT, MOST_STRIDE, Follower, Vanishing, suspects

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, Indices, SampleBlock, SampleLayout
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene

MOST_LINES = 120
"""Lines up to which a scene is watched: the law that tells s is traced as a whole."""
STRIDE = MOST_STRIDE
"""Samples of which one is looked at, at a glance, once a run is long."""
ALL = slice(None)
ROUGH = 2 * STRIDE
"""As STRIDE, where the account has nothing; where those show something, STRIDE is taken."""
LOOKS, CREDIT = 0.015, 2000.0
"""Looks at s between samples for each sample of a long run, and those that it begins with. One with
what is done about it costs a tenth to a quarter of a sample, so that all are less than half a
percent of the run."""


class DeadPoint(NamedTuple):
    """Where lines came to depend on each other."""

    t: float
    least: float
    """s at the sample next to it."""
    constraint: str
    too_many: bool = False
    """whether it is not all lines that lose rank, but those that were kept of too many."""

    @property
    def finding(self) -> Finding:
        """The finding that tells of it."""
        advice = (
            "there the laws of motion do not decide how it goes on: end the run before, or change "
            "lengths or drives so that it is not reached"
        )
        if self.too_many:
            advice = (
                "of lines that hold a motion twice those left out at the start are needed there, "
                "so that digits are lost: try one joint of the loop with fewer lines, or end the "
                "run before"
            )
        what = "the number of constraint lines that come to depend on others"
        return Finding("dead point", self.t, 1.0, 0.0, what, self.constraint, advice)


class Conditioning:
    """Follows s over the samples of a run; `found` is the first dead point, if there was one.

    compiled: the scene as it is run; None, or one in reduced coordinates, has it compiled anew.
    """

    def __init__(
        self, scene: Scene, layout: SampleLayout, compiled: Compiled | None = None
    ) -> None:
        self.found: DeadPoint | None = None
        self._layout, self._scene = layout, scene
        self._owners: list[str] = []
        self._lines: list[int] = []
        self._laws: list[Any] = []
        if not layout.contacts and has_loops(scene):
            self._make(scene, compiled)

    def _make(self, scene: Scene, compiled: Compiled | None) -> None:
        """Make the laws of the shares of the pivots, where they can be made and are not long."""
        if compiled is None or compiled.reduced:
            options = scene.simulation.model_copy(update={"project_initial": True})
            try:
                projected = scene.model_copy(update={"simulation": options})
                compiled = compile_motion(projected, "maximal")
            except RbSimError:
                return
        system, laws = compiled.system, compiled.laws
        if not 0 < compiled.rows <= MOST_LINES or not isinstance(laws, MultiBodyLaws):
            return
        place = InitialPlace(scene)
        owners = [n for n, spec in scene.constraints.items() for _ in spec.parts(place)]  # type: ignore[attr-defined]
        left_out = Dependent(compiled.dependent.lines | set(laws.changing))
        self._lines, law = lines_left(system, left_out)
        self._laws = [law] if self._lines else []
        self._laws += [laws.choice] if laws.choice is not None else []
        self._system = system
        self._follower, self._account = Follower(self._shares, system.length), CREDIT
        self._owners = [owners[part_of(system, k)] for k in (*self._lines, *laws.changing)]
        self._rank = len(self._owners) - laws.inputs.chosen.count(0.0)
        self._inputs = np.array([*laws.inputs.values(system, 0.0), 0.0])

    @property
    def watching(self) -> bool:
        """Whether there is something to look at, and nothing has been found."""
        return bool(self._laws) and self.found is None

    def add(self, block: SampleBlock, stride: int = 1) -> None:
        """The next samples; of them every stride-th is looked at.

        With a stride above 1 between them only where the account pays for it.
        """
        if not self.watching or not len(block):
            return
        follower, spent = self._follower, self._follower.spent
        self._account += LOOKS * len(block)
        between = stride == 1 or self._account > 0.0
        if not between:
            few, last = slice(None, None, ROUGH), slice(-KEPT * STRIDE, None)
            tail = block.t[last], coordinates(block, last)
            if follower.clear(block.t[few], coordinates(block, few), tail):
                return
        place = follower.add(block.t, coordinates(block, ALL), stride, between)
        if stride > 1 and between:
            self._account -= follower.spent - spent
        if place is not None:
            owner = self._owners[place.line]
            self.found = DeadPoint(place.at, place.s, owner, self._others_hold(place))

    def _shares(self, t: Array, y: Array) -> tuple[Array, Indices]:
        """s and the line to which it belongs at every sample."""
        y, t = np.ascontiguousarray(y), np.ascontiguousarray(t)
        least, line = np.ones(len(t)), np.zeros(len(t), int)
        if self._lines:
            shares = self._rows(0, t, y, len(self._lines))
            least, line = shares.min(axis=1), shares.argmin(axis=1)
        changing = len(self._owners) - len(self._lines)
        if changing:
            *_, pivots, numbers = self._rows(-1, t, y, changing + 2).T
            line = np.where(pivots < least, len(self._lines) + numbers.astype(int), line)
            least = np.minimum(pivots, least)
        return np.sqrt(np.maximum(least, 0.0)), line

    def _rows(self, law: int, t: Array, y: Array, width: int) -> Array:
        """What the law gives at every sample; 1 instead of no number, which is told elsewhere."""
        found = np.zeros((len(t), width))
        evaluate_rows(self._laws[law], t, y, self._inputs, found)
        found[~np.isfinite(found)] = 1.0
        return found

    def _others_hold(self, place: Vanishing) -> bool:
        """True where lines were left out and all together keep their rank around the place."""
        rank = self._rank
        if rank == len(self._system.lines) or len(place.t) < 4:
            return False
        with np.errstate(all="ignore"):
            pairs = zip(place.t, place.y, strict=True)
            least = np.array([least_kept(self._system, t, y, rank) for t, y in pairs])
        return bool(np.isfinite(least).all()) and not suspects(least)


def least_kept(system: Any, t: float, y: Array, rank: int) -> float:
    """The root of the eigenvalue of A, scaled to a diagonal of ones, that is the least of the
    `rank` largest; nan where A is not finite."""
    matrix = lines_matrix(system, t, y)
    sizes = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(sizes, sizes)
    if not np.isfinite(scaled).all():
        return float("nan")
    return float(np.sqrt(max(0.0, np.linalg.eigvalsh(scaled)[-rank])))


def coordinates(block: SampleBlock, which: slice) -> Array:
    """The coordinates of all bodies in turn at these samples, shape (n, 13 N)."""
    columns = block.position, block.orientation, block.linear_velocity, block.angular_velocity
    found = np.concatenate([column[which] for column in columns], axis=2)
    return found.reshape(len(found), -1)


def has_loops(scene: Scene) -> bool:
    """True unless the joints hang together as trees, whose lines cannot lose rank."""
    group: dict[str | None, str | None] = {}

    def root(name: str | None) -> str | None:
        while group.setdefault(name, name) != name:
            name = group[name]
        return name

    for spec in scene.constraints.values():
        first, second = root(spec.body), root(getattr(spec, "parent", None))  # type: ignore[attr-defined]
        if first == second:
            return True
        group[first] = second
    return False
