"""Which constraint lines are neighbours, which bodies stay unknowns, and what goes out when.

Nodes are the constraints between one pair of bodies, up to six lines each, and the bodies that
stay: *hubs*, which would make all of their many constraints neighbours of each other (star of n
arms: n^3).  The unknowns of a hub are its six accelerations:

    [ A    G_h ] [lambda]   [-bias - G M^-1 f]
    [G_h^T -M_h] [ a_h  ] = [      -f_h      ],   A = G M^-1 G^T over all other bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rb_sim.engine.systems.elimination import elimination_order

MOST_LINES = 6
"""Of one node."""
HUB = 5
"""Constraints from which on a body may stay an unknown."""


class Node(NamedTuple):
    """Unknowns that are eliminated together."""

    body: int
    """of the constraints, or the hub."""
    parent: int
    """of the constraints; -1: the world."""
    parts: tuple[int, ...]
    """parts of constraints; () for a hub."""
    size: int
    """lines, or 6."""


class Plan(NamedTuple):
    """The elimination: its nodes in order, and the later neighbours of each."""

    nodes: tuple[Node, ...]
    later: tuple[tuple[int, ...], ...]
    """numbers of the nodes with which each is coupled when it goes, increasing."""
    hubs: frozenset[int]


def constraint_nodes(
    bodies: Sequence[tuple[int, int]], sizes: Sequence[int], parts: Sequence[int]
) -> list[Node]:
    """The parts, those on one pair of bodies together; bodies, sizes: of every part."""
    on: dict[tuple[int, int], list[int]] = {}
    nodes = []
    for part in parts:
        pair = bodies[part]
        if sum(sizes[k] for k in on.get(pair, ())) + sizes[part] > MOST_LINES:
            own = tuple(on.pop(pair))
            nodes.append(Node(*pair, own, sum(sizes[k] for k in own)))
        on.setdefault(pair, []).append(part)
    nodes += [Node(*pair, tuple(own), sum(sizes[k] for k in own)) for pair, own in on.items()]
    return nodes


def hubs_of(nodes: Sequence[Node]) -> frozenset[int]:
    """Bodies that may stay unknowns.

    Without the hubs and the world the joints must fall into trees that touch these at one place
    only: then the lines are independent already on the other bodies, and no pivot is lost that
    the hub would have made up for.
    """
    degree: dict[int, int] = {}
    for node in nodes:
        for body in {node.body, node.parent} - {-1}:
            degree[body] = degree.get(body, 0) + 1
    hubs = {body for body, count in degree.items() if count >= HUB}
    while True:
        wrong = _touched_twice(nodes, hubs)
        if not wrong:
            return frozenset(hubs)
        hubs -= wrong


def _touched_twice(nodes: Sequence[Node], hubs: set[int]) -> set[int]:
    """Hubs next to a component of the other bodies that is no tree with one edge outwards."""
    near: dict[int, list[Node]] = {}
    for node in nodes:
        for body in {node.body, node.parent} - {-1} - hubs:
            near.setdefault(body, []).append(node)
    seen: set[int] = set()
    wrong: set[int] = set()
    for first in near:
        if first in seen:
            continue
        component, stack, edges = {first}, [first], set()
        while stack:
            for node in near[stack.pop()]:
                edges.add(node)
                for body in {node.body, node.parent} - {-1} - hubs - component:
                    component.add(body)
                    stack.append(body)
        seen |= component
        if len(edges) > len(component):
            wrong |= {body for node in edges for body in (node.body, node.parent)} & hubs
    return wrong


def planned(constraints: Sequence[Node], hubs: frozenset[int]) -> Plan:
    """The order of least degree, constraints of which only hubs remain after these."""
    nodes = [*constraints, *(Node(h, h, (), 6) for h in sorted(hubs))]
    on: dict[int, set[int]] = {}
    for k, node in enumerate(nodes):
        for body in {node.body, node.parent} - {-1}:
            on.setdefault(body, set()).add(k)
    near: list[set[int]] = [set() for _ in nodes]
    for body, members in on.items():
        hub = {k for k in members if not nodes[k].parts}
        for k in members:
            near[k] |= (hub if body in hubs and nodes[k].parts else members) - {k}
    order = elimination_order(near, [_rank(node, hubs) for node in nodes])
    place = {k: i for i, k in enumerate(order)}
    left = [{place[j] for j in near[k]} for k in order]
    later = []
    for i, ahead in enumerate(left):
        mine = sorted(j for j in ahead if j > i)
        later.append(tuple(mine))
        for j in mine:
            left[j] |= set(mine) - {j}
    return Plan(tuple(nodes[k] for k in order), tuple(later), hubs)


def _rank(node: Node, hubs: frozenset[int]) -> int:
    """Constraints on other bodies go first, then hubs, then constraints on hubs alone."""
    if not node.parts:
        return 1
    return 0 if {node.body, node.parent} - {-1} - hubs else 2
