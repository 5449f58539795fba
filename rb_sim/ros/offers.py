"""Publishers as the node offers them: reliable, of a depth, with the standard overrides of QoS.

ROS has the parameters qos_overrides.TOPIC.publisher.{history,depth,reliability,durability}: they
are declared with each publisher, and read at the start only.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    QoSReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from rb_sim.errors import RbSimError

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher

OVERRIDES = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)


def offer(node: Node, kind: Any, name: str, depth: int, *, latched: bool = False) -> Publisher:
    """A publisher of messages of class `kind`. latched: who comes late gets the last `depth`.

    Raises RbSimError where an override is none that ROS knows.
    """
    durability = (
        QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE
    )  # fmt: skip
    qos = QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=durability,
    )
    options = QoSOverridingOptions(OVERRIDES)
    try:
        return node.create_publisher(kind, name, qos, qos_overriding_options=options)
    except Exception as error:  # rclpy's own error types share no base class
        words = " ".join(str(error).split())
        raise RbSimError(f"topic {name}: its qos_overrides are refused: {words}") from None


def message_class(ros_type: str) -> type:
    """The class of pkg/msg/Type."""
    package, kind, name = ros_type.split("/")
    return getattr(import_module(f"{package}.{kind}"), name)
