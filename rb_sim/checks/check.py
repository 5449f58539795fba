"""The shape of all accuracy checks: what each is made for, and what it is shown.

A check is a function of a Run that gives a function of what is Seen, which yields findings: what it
measures, its scale and its one bound are in its file, its words in `base.diagnostic.CHECKS`.  One
line in `check_list.CHECKS` registers it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rb_sim.base.diagnostic import Finding
    from rb_sim.checks.balance import Ledger
    from rb_sim.checks.effort import Effort
    from rb_sim.checks.resolution import Resolutions
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene


class Run(NamedTuple):
    """What is checked."""

    scene: Scene
    layout: SampleLayout
    compiled: Compiled | None = None
    """the scene as it is run, which spares compiling a linkage once more to watch its rank."""


class Seen(NamedTuple):
    """Of a run, up to the end of the last samples."""

    block: SampleBlock
    """the last samples, at least one."""
    effort: Effort
    ledger: Ledger
    """balances of all samples, or since the last command."""
    resolution: Resolutions
    samples: int
    """of the whole run."""


Look = Callable[[Seen], Iterable["Finding"]]
"""Tells what has passed its bound in the last samples; asked until all its names have been told."""

Check = tuple[tuple[str, ...], Callable[[Run], Look]]
"""Names of the findings, and what makes the check of a run."""
