"""Sends wrench commands to a running node, one after the other, and ends."""

from __future__ import annotations

import time
from typing import NamedTuple

import rclpy
from geometry_msgs.msg import Vector3, WrenchStamped
from rclpy.duration import Duration
from rclpy.utilities import try_shutdown

from rb_sim.errors import RbSimError

PATIENCE = 60.0
"""[s] for the node to be found, and to have taken a command."""


class Wrench(NamedTuple):
    """A command in world axes."""

    force: tuple[float, float, float]
    """[N]."""
    torque: tuple[float, float, float]
    """about the body origin [N m]."""


def message(wrench: Wrench, frame: str) -> WrenchStamped:
    """The command as the node takes it."""
    command = WrenchStamped()
    command.header.frame_id = frame
    command.wrench.force = Vector3(**dict(zip("xyz", wrench.force, strict=True)))
    command.wrench.torque = Vector3(**dict(zip("xyz", wrench.torque, strict=True)))
    return command


def send(topic: str, wrenches: list[Wrench], pause: float) -> None:
    """Send each wrench and wait `pause` seconds after it.

    Raises RbSimError if no node listens on the topic, or one does not take a command.
    """
    rclpy.init()
    try:
        node = rclpy.create_node("commander")
        publisher = node.create_publisher(WrenchStamped, topic, 10)
        end = time.monotonic() + PATIENCE
        while not publisher.get_subscription_count():
            if time.monotonic() > end:
                raise RbSimError(f"nobody listens on {topic}")
            time.sleep(0.01)
        for wrench in wrenches:
            publisher.publish(message(wrench, "world"))
            if not publisher.wait_for_all_acked(Duration(seconds=PATIENCE)):
                raise RbSimError(f"the listener on {topic} does not take commands")
            time.sleep(pause)
    finally:
        try_shutdown()
