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
from rb_sim.loops.law_rows import LeastOf
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.initial import part_of
from rb_sim.scene.place import InitialPlace
from rb_sim.watches.vanishing import KEPT, MOST_STRIDE, RESOLVED, Follower, Vanishing, suspects

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, Indices, SampleBlock, SampleLayout
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene

MOST_LINES = 120
"""Lines up to which a scene is watched: the law that tells s is traced as a whole."""
STRIDE = MOST_STRIDE
"""Samples of which one is looked at, at a glance, once a run is long."""
ALL = slice(None)
ROUGH, ROUGHEST = 2 * STRIDE, 8 * STRIDE
"""As STRIDE, where the account has nothing: so that bodies go on by half of RESOLVED, but no closer
and no farther than this; where those show something, STRIDE is taken. Where bodies go on by more
than RESOLVED in ROUGH samples these show nothing of a V, and none is looked at."""
SPARSE = 4 * ROUGHEST
"""Of so many samples one tells how fast bodies go on."""
UNSEEN = 7
"""Blocks that are passed without a look after one that goes too fast for it."""
LOOKS, CREDIT = 0.01, 500.0
"""Looks at s between samples for each sample of a long run, and those that it begins with. One with
what is done about it costs a tenth to a third of a sample, so that all are less than half a
percent of the run."""


UNDECIDED = (
    "the laws of motion do not decide how it goes on: end the run before, or change lengths or "
    "drives so that it is not reached"
)


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
        advice = f"there {UNDECIDED}"
        if self.too_many:
            advice = (
                "of lines that hold a motion twice those left out at the start are needed there, "
                "so that digits are lost: try one joint of the loop with fewer lines, or end the "
                "run before"
            )
        what = "the number of constraint lines that come to depend on others"
        return Finding("dead point", self.t, 1.0, 0.0, what, self.constraint, advice)

    @property
    def refusal(self) -> str:
        """What a run that ends there says."""
        return (
            f"the motion comes to a dead point at t = {self.t:.4g} s, where lines of "
            f"{self.constraint!r} come to depend on others and {UNDECIDED}"
        )


class Conditioning:
    """Follows s over the samples of a run; `found` is the first dead point, if there was one.

    compiled: the scene as it is run; None, or one in reduced coordinates, has it compiled anew.
    """

    def __init__(
        self, scene: Scene, layout: SampleLayout, compiled: Compiled | None = None
    ) -> None:
        self.found: DeadPoint | None = None
        self._layout, self._scene = layout, scene
        self._watched: list[int] = []
        """lines of which s tells."""
        self._lines: list[int] = []
        self._samples = self._unseen = 0
        """samples so far, and blocks that are still to be passed without a look."""
        self._too_fast = False
        """whether the last block was, for a look at few of its samples."""
        self._laws: list[LeastOf] = []
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
        left_out = Dependent(compiled.dependent.lines | set(laws.changing))
        self._lines, law = lines_left(system, left_out)
        inputs = np.array([*laws.inputs.values(system, 0.0), 0.0])
        if self._lines:
            self._laws.append(LeastOf(law, inputs, len(self._lines), told=False))
        if laws.choice is not None:
            self._laws.append(LeastOf(laws.choice, inputs, len(laws.changing) + 2, told=True))
        self._system = system
        self._follower, self._account = Follower(self.shares, system.length), CREDIT
        self._watched = [*self._lines, *laws.changing]
        self._rank = len(self._watched) - laws.inputs.chosen.count(0.0)

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
        self._samples += len(block)
        between = stride == 1 or self._account > 0.0
        if not between and self._unseen:
            self._unseen -= 1
            return
        if not between:
            few, last = self._few(block), slice(-KEPT * STRIDE, None)
            if few is None:
                follower.leave_out()
                self._unseen = UNSEEN
                return
            tail = block.t[last], coordinates(block, last)
            if follower.clear(block.t[few], coordinates(block, few), tail):
                return
        place = follower.add(block.t, coordinates(block, ALL), stride, between)
        if stride > 1 and between:
            self._account -= follower.spent - spent
        if place is not None:
            owner = self._owner(self._watched[place.line])
            self.found = DeadPoint(place.at, place.s, owner, self._others_hold(place))

    def _few(self, block: SampleBlock) -> slice | None:
        """Which samples to look at where the account has nothing; None: they would show nothing."""
        if len(block) < 2:
            return slice(None)
        interval = float(block.t[-1] - block.t[0]) / (len(block) - 1)
        v = block.linear_velocity[::SPARSE]
        speed = np.ptp(v, axis=1) if v.shape[1] > 1 else np.abs(v)
        spin = np.abs(block.angular_velocity[::SPARSE]).max()
        way = interval * float(max(spin, speed.max() / self._system.length))
        too_fast, before = ROUGH * way > RESOLVED, self._too_fast
        self._too_fast = too_fast
        if too_fast and before:  # what only now is too fast may be about to come to a dead point
            return None
        stride = ROUGH
        while stride < ROUGHEST and 4.0 * stride * way <= RESOLVED:
            stride *= 2
        # so that the looks of all blocks are equally far apart
        return slice(-(self._samples - len(block)) % stride, None, stride)

    def _owner(self, line: int) -> str:
        """The constraint to which the line belongs."""
        place = InitialPlace(self._scene)
        specs: dict[str, Any] = dict(self._scene.constraints)
        owners = [name for name, spec in specs.items() for _ in spec.parts(place)]
        return owners[part_of(self._system, line)]

    def told(self, t: float, least: float, line: int) -> DeadPoint:
        """The dead point at t where s of this line comes to zero."""
        return DeadPoint(t, least, self._owner(self._watched[line]))

    def shares(self, t: Array, y: Array) -> tuple[Array, Indices]:
        """s and the line to which it belongs at every sample; 1 where it is no number."""
        y, t = np.ascontiguousarray(y), np.ascontiguousarray(t)
        least, line = self._laws[0](t, y)
        if len(self._laws) > 1:
            pivots, numbers = self._laws[1](t, y)
            line = np.where(pivots < least, len(self._lines) + numbers, line)
            least = np.minimum(pivots, least)
        elif not self._lines:
            line = len(self._lines) + line
        return np.sqrt(np.maximum(least, 0.0)), line

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
