"""The thread that serves ROS, and what others have it do."""

from __future__ import annotations

import threading

import pytest
from rclpy.context import Context
from rclpy.node import Node

from rb_sim.ros.serving import Serving


def test_what_it_is_to_do_is_done_between_requests_and_told(context: Context):
    """Also where it does not serve yet, or not any more."""
    node, where = Node("served", context=context), []

    def note() -> None:
        where.append(threading.current_thread())

    def fail() -> None:
        note()
        raise ValueError("not done")

    try:
        serving = Serving(node)
        serving.do(note)
        with serving:
            serving.do(note)
            with pytest.raises(ValueError, match="not done"):
                serving.do(fail)
            serving.check()
        serving.do(note)
    finally:
        node.destroy_node()
    here = threading.current_thread()
    assert where[0] is here and where[3] is here
    assert where[1] is where[2] is not here and len(where) == 4
