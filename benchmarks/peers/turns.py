# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One turn of a program that takes turns with another, so that what else the machine does meets
both."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

ENOUGH = 2e-3
"""CPU time of one turn, in which a run is repeated [s]."""


def turn(start: Callable[[], object], go: Callable[[], object]) -> float:
    """CPU time of `go` [s], the lower quartile of one turn; `start` goes before each repeat.

    The least of them is now and then half of all others, where a virtual machine's clock has lost
    what it had counted.
    """
    took: list[float] = []
    while sum(took) < ENOUGH:
        start()
        begin = time.process_time()
        go()
        took.append(max(time.process_time() - begin, 1e-6))
    return statistics.quantiles(took, n=4)[0] if len(took) > 3 else min(took)
