# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

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
