"""Publishers and subscriptions of the node: reliable, of a depth, with the standard QoS overrides.

ROS has the parameters qos_overrides.TOPIC.publisher.{history,depth,reliability,durability}, and the
same with `subscription`: they are declared with each, and read at the start only.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    QoSReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from rb_sim.base.errors import RbSimError

if TYPE_CHECKING:
    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

OVERRIDES = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)

REQUESTS = 1000
"""Requests, and answers, that a service keeps."""
DEEPEST = 1_000_000
"""Messages that an override may ask a topic to keep: DDS counts them in 32 bits, and far below that
limit no memory holds them."""


def offer(node: Node, kind: Any, name: str, depth: int, *, latched: bool = False) -> Publisher:
    """A publisher of messages of class `kind`. latched: who comes late gets the last `depth`.

    Raises RbSimError where an override is none that ROS knows.
    """
    with _told(name) as options:
        return node.create_publisher(
            kind, name, _reliable(depth, latched=latched), qos_overriding_options=options
        )


def accept(
    node: Node,
    kind: Any,
    name: str,
    take: Callable[[bytes], None],
    depth: int,
    group: CallbackGroup | None,
) -> Subscription:
    """A subscription to messages of class `kind`, as bytes. Raises RbSimError as `offer` does."""
    with _told(name) as options:
        return node.create_subscription(
            kind,
            name,
            take,
            _reliable(depth),
            callback_group=group,
            qos_overriding_options=options,
            raw=True,
        )


def serve(node: Node, kind: Any, name: str, answer: Callable[[Any, Any], Any]) -> None:
    """A service that keeps REQUESTS requests until they are taken.

    ROS keeps ten, and forgets the oldest where a client, or several, have more on the way.
    """
    node.create_service(kind, name, answer, qos_profile=_reliable(REQUESTS))


def _reliable(depth: int, *, latched: bool = False) -> QoSProfile:
    durability = (
        QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE
    )  # fmt: skip
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=durability,
    )


@contextmanager
def _told(name: str) -> Iterator[QoSOverridingOptions]:
    """The options of a topic; what is refused inside the block becomes an RbSimError."""
    try:
        with warnings.catch_warnings(action="ignore"):  # rclpy's, of a depth that is refused here
            yield QoSOverridingOptions(OVERRIDES, callback=_checked)
    except Exception as error:  # rclpy's own error types share no base class
        words = " ".join(str(error).split())
        raise RbSimError(f"topic {name}: its qos_overrides are refused: {words}") from None


def _checked(profile: QoSProfile) -> SetParametersResult:
    """Whether DDS can have it; it would refuse a depth in many lines of its own, or not at all."""
    kept = 1 <= profile.depth <= DEEPEST
    reason = "" if kept else f"depth: got {profile.depth}; must be 1 to {DEEPEST}"
    return SetParametersResult(successful=kept, reason=reason)


def message_class(ros_type: str) -> type:
    """The class of pkg/msg/Type."""
    package, kind, name = ros_type.split("/")
    return getattr(import_module(f"{package}.{kind}"), name)
