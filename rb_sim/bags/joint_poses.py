"""Poses of a scene's bodies from the joint states in a bag of anybody (sensor_msgs/JointState).

Positions are counted from the pose in the scene file, as those of our own `joint_states` and of the
joints of `robot_description` are: a hinge turns its body about its axis by the angle [rad], a
linear guide carries it along by the way [m], and what hangs on a body moves with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.bags.message_rates import forward
from rb_sim.base.names import ros_name
from rb_sim.io.bag.batches import unpacked
from rb_sim.io.bag.folder import bag_paths, scan_of
from rb_sim.io.messages import cdr
from rb_sim.io.messages.joints import slides
from rb_sim.io.messages.message_types import JOINT_STATE
from rb_sim.io.messages.robot_description import joints_above
from rb_sim.numerics.rotations import from_rotation_vector, product, rotate

if TYPE_CHECKING:
    from rb_sim.scene.schema import Scene

Array = np.ndarray


class Poses(NamedTuple):
    """Of one body's origin, world axes."""

    t: Array
    """increasing [s], shape (n,)."""
    position: Array
    orientation: Array


def joint_poses(bag: Path, scene: Scene) -> tuple[dict[str, Poses], str]:
    """The poses of the bodies that the joint states of a bag place, and a line if none do although
    there are some; ({}, "") in a bag without joint states."""
    found = _positions(bag)
    above = joints_above(scene)
    joints = {ros_name(name): name for name, spec in above.values() if spec.type != "weld"}
    mine = {joints.get(name, name): series for name, series in found.items()}
    names = set(joints.values()) & set(mine)
    if found and not names:
        known = ", ".join(joints.values()) or "none: no fixed_axis, no translation along a line"
        return {}, f"its joint states are of {', '.join(found)}; the scene's joints are {known}"
    chains = {body: _chain(body, above) for body in above}
    poses = {}
    for body, chain in chains.items():
        wanted = [name for name, spec in chain if spec.type != "weld"]
        rooted = not chain or chain[0][1].type == "weld" or chain[0][0] in names
        if rooted and wanted and names.issuperset(wanted):
            poses[body] = _placed(body, chain, mine, scene)
    return {body: placed for body, placed in poses.items() if len(placed.t)}, ""


def _positions(bag: Path) -> dict[str, tuple[Array, Array]]:
    """Times [s] and positions of each joint, by its name in the bag."""
    rows: dict[str, list[tuple[float, float]]] = {}
    for path in bag_paths(Path(bag)):
        scan = scan_of(path)
        for batch in scan.batches():
            for number, messages in batch.items():
                schema = scan.schemas.get(scan.channels[number].schema_id)
                if schema is None or schema.name != JOINT_STATE:
                    continue
                whole = unpacked(messages)
                for k in range(len(whole.start)):
                    try:
                        stamp, names, position = cdr.read_joint_state(whole.data(k))
                    except ValueError:  # damage: the messages beside it stand
                        continue
                    for name, value in zip(names, position, strict=False):
                        rows.setdefault(name, []).append((stamp * 1e-9, value))
    series = {}
    for name, pairs in rows.items():
        t, value = np.array(pairs).T
        kept = forward(t) & np.isfinite(value)
        series[name] = t[kept], value[kept]
    return series


def _chain(body: str, above: Mapping[str, tuple[str, Any]]) -> list[tuple[str, Any]]:
    """The joints and welds from the world, or a free body, to a body."""
    chain: list[tuple[str, Any]] = []
    at: str | None = body
    while at is not None and at in above:
        chain.insert(0, above[at])
        at = getattr(above[at][1], "parent", None)
    # on a body that is free nothing is placed
    return [] if at is not None else chain


def _placed(
    body: str, chain: list[tuple[str, Any]], mine: dict[str, tuple[Array, Array]], scene: Scene
) -> Poses:
    series = [mine[name] for name, spec in chain if spec.type != "weld"]
    first, last = max(t[0] for t, _ in series), min(t[-1] for t, _ in series)
    t = series[0][0]
    t = t[(t >= first) & (t <= last)]
    # what the joints so far do to a point of the world at the start: turn, then shift
    turn, shift = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)), np.zeros((len(t), 3))
    for name, spec in chain:
        if spec.type == "weld":
            continue
        value = np.interp(t, *mine[name])[:, None]
        if slides(spec):
            shift = shift + rotate(turn, value * np.array(spec.guide.direction))
            continue
        p, q = _start(scene, spec.body)
        point = p + rotate(q, np.array(spec.point_B))
        swing = from_rotation_vector(value * rotate(q, np.array(spec.axis_B)))
        shift = shift + rotate(turn, point - rotate(swing, point))
        turn = product(turn, swing)
    p, q = _start(scene, body)
    return Poses(t, shift + rotate(turn, p), product(turn, q))


def _start(scene: Scene, body: str) -> tuple[Array, Array]:
    """Position and orientation in the scene file."""
    spec = scene.bodies[body]
    return np.array(spec.position, dtype=float), np.array(spec.orientation, dtype=float)
