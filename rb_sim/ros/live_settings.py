"""The node's parameters while it lives: those that may change do, from their declaration on.

Also while the engine compiles and between two lives of a lifecycle node: what is accepted then is
what runs afterwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

from rcl_interfaces.msg import SetParametersResult as Result
from rclpy.node import Node
from rclpy.parameter import Parameter

from rb_sim.ros.parameters import Settings, declare, refusal


class LiveSettings:
    """Declares the parameters; refuses a change with a reason, or has it from then on.

    RbSimError: a start value is not allowed.
    """

    def __init__(self, node: Node) -> None:
        self.now = declare(node)
        """the values as they are."""
        self._node = node
        self._changed: Callable[[Settings], None] | None = None
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._accept)

    def watch(self, changed: Callable[[Settings], None] | None) -> None:
        """Call changed(settings) after every change from now on; None: call nobody.

        To be called before `now` is read: a change that comes in between is passed on, too.
        """
        self._changed = changed

    def _check(self, parameters: list[Parameter]) -> Result:
        reasons = [refusal(parameter.name, parameter.value) for parameter in parameters]
        reason = next((reason for reason in reasons if reason), "")
        if reason:
            self._node.get_logger().warning(f"parameter refused: {reason}")
        return Result(successful=not reason, reason=reason)

    def _accept(self, parameters: list[Parameter]) -> None:
        kinds = {known.name: type(known.default) for known in fields(Settings)}
        news = {p.name: kinds[p.name](p.value or 0) for p in parameters if p.name in kinds}
        if news:  # only the live ones get here, and they are all numbers
            self.now = replace(self.now, **news)
            if (changed := self._changed) is not None:
                changed(self.now)
