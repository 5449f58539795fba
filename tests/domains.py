# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A ROS domain of one's own, so that a test process sees the nodes of no other one."""

from __future__ import annotations

import os
import socket

FIRST, COUNT = 10, 90
"""Domains to choose from: their ports lie below those that Linux gives away by itself."""
_held: list[socket.socket] = []
"""What keeps the domains of this process."""


def own_domain() -> str:
    """A domain that no other process has got from here; it is kept until this one ends.

    DDS sends to UDP ports from 7400 + 250 times the domain on; the TCP port of that number is
    nobody's, and only one process can have it. A number made of the process's own would be another
    process's, too, now and then, where several test runs share a machine: /clock and the topics of
    two nodes would be mixed.
    """
    for k in range(COUNT):
        domain = FIRST + (os.getpid() + k) % COUNT
        port = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            port.bind(("127.0.0.1", 7400 + 250 * domain))
        except OSError:
            port.close()
            continue
        _held.append(port)
        return str(domain)
    raise RuntimeError("all ROS domains are taken")
