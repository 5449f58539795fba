"""Robot description (URDF) and markers, latched for viewers that come late."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rb_sim.io.messages.robot_description import from_z, length_and_radius, urdf
from rb_sim.io.messages.topic_names import body_frame
from rb_sim.ros.offers import offer

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.ros.parameters import Settings
    from rb_sim.scene.schema import Scene


# Markers and robot_description: what a viewer needs once, latched for who comes late.


COLOUR = (0.35, 0.55, 0.85, 1.0)
"""Of bodies: red, green, blue, opacity."""


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
    """Publishes `~/markers` (visualization_msgs/MarkerArray): each body's shape in its own frame.

    They are locked to the frames of /tf, so once is enough; a body without shape has none.
    """

    def __init__(self, node: Node, settings: Settings) -> None:
        self._node, self._prefix = node, settings.frame_prefix
        self._publisher: Publisher | None = None

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Publish the markers."""
        types = import_module("visualization_msgs.msg")
        self._publisher = offer(self._node, types.MarkerArray, "~/markers", 1, latched=True)
        array = types.MarkerArray()
        for number, (name, body) in enumerate(scene.bodies.items()):
            if body.shape is not None:
                marker = _marker(types.Marker, body.shape)
                marker.header.frame_id = self._prefix + body_frame(name)
                marker.ns, marker.id = name, number
                array.markers.append(marker)
        self._publisher.publish(array)

    def write(self, block: SampleBlock) -> None:
        """Nothing changes."""

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publisher."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        self._publisher = None


def _marker(kind: Any, shape: Any) -> Any:
    """The shape as a marker in body axes: `scale` is its size along its own axes [m]."""
    marker = kind(frame_locked=True, action=kind.ADD)
    turn = (0.0, 0.0, 0.0, 1.0)
    match shape.type:
        case "sphere":
            marker.type, size = kind.SPHERE, [2.0 * shape.radius] * 3
        case "ellipsoid":
            marker.type, size = kind.SPHERE, [2.0 * value for value in shape.semi_axes]
        case "box":
            marker.type, size = kind.CUBE, list(shape.size)
        case _:
            length, radius = length_and_radius(shape)
            marker.type, size = kind.CYLINDER, [2.0 * radius, 2.0 * radius, length]
            turn = from_z(shape.axis_B)
    for of, names, values in (
        (marker.pose.position, "xyz", shape.center_B),
        (marker.pose.orientation, "xyzw", turn),
        (marker.scale, "xyz", size),
        (marker.color, "rgba", COLOUR),
    ):
        for field, value in zip(names, values, strict=True):
            setattr(of, field, float(value))
    return marker
