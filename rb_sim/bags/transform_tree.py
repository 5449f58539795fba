"""Which frame stands in which in the transforms of a bag, and the way from a frame to its root.

A robot's transforms form a tree (`map` to `odom` to `base_link`): the pose of a frame in the root
is the product of the transforms on the way. Each namespace (`/robot1/tf` with
`/robot1/tf_static`) has a tree of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from rb_sim.bags.piece import POSE, Piece

Links = dict[str, dict[str, str]]
"""Source of the transform by its parent frame, by child frame."""


class Chain(NamedTuple):
    """How the pose of a frame in the root of its tree is made.

    root_child = before[-1] ... before[0] driver after[0] ... after[-1], by names of sources.
    """

    name: str
    """of what is made."""
    driver: str
    """the source at whose stamps it is made."""
    before: tuple[str, ...]
    """the transforms from the frame of the driver's poses up to the root."""
    after: tuple[str, ...]
    """the static transforms from the driver's own frame down to the child."""
    root: str
    child: str
    replaced: str
    """the source whose poses are of the same child, but not in the root."""


def chains(pieces: Iterable[Piece], wanted: frozenset[str]) -> list[Chain]:
    """What can be made of the first readings of a bag.

    wanted: names of frames whose poses are made even where they are fixed to their parent. Frames
    with two parents, and those in a circle, have no place in a tree: nothing is made through them.
    """
    trees: dict[str, Links] = {}
    firsts: dict[str, Piece] = {}
    for piece in pieces:
        if piece.kind == POSE and piece.source not in firsts:
            firsts[piece.source] = piece
            if piece.transform:
                links = trees.setdefault(namespace(piece.source), {})
                links.setdefault(plain(piece.child), {})[plain(piece.frame)] = piece.source
    made = [_chain(piece, trees, firsts, wanted) for piece in firsts.values()]
    return [chain for chain in made if chain is not None]


def plain(frame: str) -> str:
    """The frame's name without the slash that ROS 1 put before it."""
    return frame.removeprefix("/")


def is_static(source: str) -> bool:
    """Whether a source of transforms is one that holds for all times."""
    return source.partition(":")[0].endswith("/tf_static")


def namespace(source: str) -> str:
    """What stands before /tf or /tf_static in the name of a source of transforms."""
    return source.partition(":")[0].rpartition("/")[0]


def _chain(
    piece: Piece, trees: dict[str, Links], firsts: dict[str, Piece], wanted: frozenset[str]
) -> Chain | None:
    """The chain of a source of poses, if it has one."""
    links, driver = _tree_of(piece, trees), piece
    after: list[str] = []
    while driver.transform and is_static(driver.source):
        above = links.get(plain(driver.frame), {})
        after.insert(0, driver.source)
        if plain(piece.child) not in wanted or len(above) != 1 or len(after) > len(links):
            return None
        driver = firsts[next(iter(above.values()))]
    found = _way(plain(driver.frame), links)
    if found is None:
        return None
    before, root = found
    if not after and all(_is_nothing(firsts[source]) for source in before):
        return None
    name = f"{piece.source} (in {root} by transforms)"
    return Chain(name, driver.source, before, tuple(after), root, piece.child, piece.source)


def _tree_of(piece: Piece, trees: dict[str, Links]) -> Links:
    """The tree of a transform; of other poses the only one that knows their frame, if there is."""
    if piece.transform:
        return trees[namespace(piece.source)]
    known = [links for links in trees.values() if plain(piece.frame) in links]
    return known[0] if len(known) == 1 else {}


def _way(frame: str, links: Links) -> tuple[tuple[str, ...], str] | None:
    """The transforms from a frame up to the root, and the root; None where that is not clear."""
    way: list[str] = []
    while frame in links:
        parents = links[frame]
        if len(parents) != 1 or len(way) > len(links):
            return None
        frame, source = next(iter(parents.items()))
        way.append(source)
    return tuple(way), frame


def _is_nothing(piece: Piece) -> bool:
    """Whether a transform is static and turns and moves nothing."""
    value = piece.values[0]
    return is_static(piece.source) and not np.any(value[:6]) and bool(value[6])
