"""Robot description (URDF) and markers, latched for viewers that come late."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rb_sim.io.messages.robot_description import marker_array, urdf
from rb_sim.io.messages.topic_names import MARKERS
from rb_sim.ros.offers import offer

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.ros.parameters import Settings
    from rb_sim.scene.schema import Scene


class RobotDescription:
    """Publishes `robot_description` (std_msgs/String), the scene's URDF, with the first sample."""

    def __init__(self, node: Node, settings: Settings) -> None:
        self._node = node
        self._publisher: Publisher | None = None
        self._told = False

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the publisher."""
        self._scene, self._layout = scene, layout
        self._message = import_module("std_msgs.msg").String
        self._publisher = offer(self._node, self._message, "robot_description", 1, latched=True)

    def write(self, block: SampleBlock) -> None:
        """Publish once."""
        if self._publisher is not None and not self._told:
            self._told = True
            text = urdf(self._scene, self._layout, block)
            self._publisher.publish(self._message(data=text))

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publisher."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        self._publisher = None


class Markers:
    """Publishes `~/markers` (visualization_msgs/MarkerArray): the shapes of the bodies, once."""

    def __init__(self, node: Node, settings: Settings) -> None:
        self._node, self._prefix = node, settings.frame_prefix
        self._publisher: Publisher | None = None

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Publish the markers."""
        kind = import_module("visualization_msgs.msg").MarkerArray
        self._publisher = offer(self._node, kind, f"~/{MARKERS}", 1, latched=True)
        self._publisher.publish(marker_array(scene, self._prefix))

    def write(self, block: SampleBlock) -> None:
        """Nothing changes."""

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publisher."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        self._publisher = None
