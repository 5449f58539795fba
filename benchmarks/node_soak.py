# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node for long: whether memory stays, whether a sample is lost, to its bag or a subscriber.

`python -m benchmarks.node_soak [--seconds S] [--rate HZ] [--fast] [--priority P]`: the node with
its bag, and a reliable subscriber of depth 10 in a process of its own. Fifteen minutes of simulated
time at 500 Hz unless told otherwise. --fast: as fast as it goes, where nobody subscribes (a
publisher that waits for nobody overruns every reader). Exit status 1 where anything was lost.

A subscriber that other programs keep from looking for ten periods loses samples whatever the node
does; what it lost while the node hurried, because it was late itself, is told apart by the times at
which samples were sent. --priority: of the subscriber, as the node has one (SCHED_FIFO, 1 to 99),
for a machine that has other work.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.machine import describe, line
from benchmarks.node import SCENE

FAST = 0.0
"""real_time_factor: as fast as possible."""
DEPTH = 10
"""Samples that the subscriber keeps."""
SETTLED = 0.2
"""Share of the run after which memory is to stay."""
SUBSCRIBER = """
import gc, json, os, signal, struct, sys
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
node, stamps, sent, over = rclpy.create_node("subscriber"), [], [], []
signal.signal(signal.SIGTERM, lambda *_: over.append(True))
def keep(message, info):
    stamps.append(struct.unpack_from("<iI", message, 4))
    sent.append(info["source_timestamp"])
node.create_subscription(PoseStamped, "/rb_sim/ball/pose", keep, int(sys.argv[2]), raw=True)
executor = SingleThreadedExecutor()  # rclpy's other one breaks where `info` is asked for
executor.add_node(node)
if priority := int(sys.argv[3]):
    for thread in os.listdir("/proc/self/task"):
        os.sched_setscheduler(int(thread), os.SCHED_FIFO, os.sched_param(priority))
gc.collect()
gc.freeze()  # going through all objects takes longer than ten samples
while not over:
    executor.spin_once(timeout_sec=0.1)
ticks = [round((s + ns * 1e-9) * float(sys.argv[1])) for s, ns in stamps]
print(json.dumps([ticks, sent]))
"""


@dataclass(frozen=True)
class Soaked:
    """What came of it."""

    samples: int
    """in the bag."""
    missing: int
    """samples that the bag lacks between its first and its last."""
    received: int
    """samples that the subscriber got."""
    lost: int
    """samples that it lacks between its first and its last."""
    hurried: int
    """of those, the ones that were sent closer together than three quarters of the period."""
    eleven: float
    """shortest time in which eleven samples were sent, by those received [ms]."""
    memory: int
    """of the node and its log process at the end [KiB]."""
    growth: int
    """by how much that is more than when it had settled [KiB]."""
    wall: float
    """[s]."""


def memory(pid: int) -> int:
    """Resident memory of a process and its children [KiB]; 0 where it is gone."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return 0
    found = re.search(r"VmRSS:\s+(\d+)", status)
    return (int(found[1]) if found else 0) + sum(memory(int(child)) for child in children)


def soak(seconds: float, rate: float, factor: float = 1.0, priority: int = 0) -> Soaked:
    """Run it. seconds: of simulated time. priority: of the subscriber, 0: ordinary.

    RuntimeError: the node did not end well.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        values = {"rate": rate, "real_time_factor": factor, "duration": seconds, "out": out}
        values |= {"log_rerun": "false", "log_plots": "false", "log_queue": 2000}
        given = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        reader = [sys.executable, "-c", SUBSCRIBER, str(rate), str(DEPTH), str(priority)]
        subscriber = None if factor == FAST else subprocess.Popen(reader, stdout=subprocess.PIPE)
        command = [sys.executable, "-m", "rb_sim.ros.main", SCENE, "--ros-args", *given]
        with (Path(folder) / "node.log").open("w+") as said:
            node, seen = subprocess.Popen(command, stdout=said, stderr=said), []
            while node.poll() is None:
                if (out / "bag").is_dir():  # the samples have begun
                    seen.append((time.monotonic(), memory(node.pid)))
                time.sleep(0.25)
            said.seek(0)
            if node.returncode:
                raise RuntimeError(said.read())
        received = _received(subscriber, rate)
        ticks = _in_bag(out / "bag", rate)
    missing = int(ticks[-1] - ticks[0]) + 1 - len(ticks)
    began, ended = seen[0][0], seen[-1][0]
    sizes = [size for t, size in seen[:-1] if size and t - began >= SETTLED * (ended - began)]
    return Soaked(len(ticks), missing, *received, sizes[-1], max(sizes) - sizes[0], ended - began)


def _received(
    subscriber: subprocess.Popen[bytes] | None, rate: float
) -> tuple[int, int, int, float]:
    """Of the subscriber, if there is one: received, lost, hurried, eleven of Soaked."""
    if subscriber is None:
        return 0, 0, 0, np.nan
    time.sleep(1.0)  # what is on the way
    subscriber.terminate()
    ticks, sent = map(np.array, json.loads(subscriber.communicate(timeout=60)[0]))
    return len(ticks), *judged(ticks, sent * 1e-9, 1.0 / rate)


def judged(ticks: np.ndarray, sent: np.ndarray, period: float) -> tuple[int, int, float]:
    """lost, hurried, eleven of Soaked. ticks: numbers of samples received; sent: when [s]."""
    steps, apart = np.diff(ticks), np.diff(sent)
    hurried = (steps > 1) & (apart < 0.75 * period * steps)
    last = np.searchsorted(ticks, ticks + DEPTH)  # of each eleven
    whole = last < len(ticks)
    eleven = np.min(sent[last[whole]] - sent[whole], initial=np.inf)
    return int(np.sum(steps - 1)), int(np.sum((steps - 1)[hurried])), float(eleven) * 1e3


def _in_bag(bag: Path, rate: float) -> np.ndarray:
    """Numbers of the samples in the bag."""
    from rb_sim.io.bag.reader import BagReader

    stamps = np.concatenate([block.t for block in BagReader(bag).blocks()])
    return np.unique(np.rint(stamps * rate).astype(np.int64))


def main() -> int:
    """Print what came of it."""
    parser = argparse.ArgumentParser(description="The node for a long time.")
    parser.add_argument("--seconds", type=float, default=900.0, help="of simulated time")
    parser.add_argument("--rate", type=float, default=500.0, help="samples per second")
    parser.add_argument("--fast", action="store_true", help="as fast as possible")
    parser.add_argument("--priority", type=int, default=0, help="of the subscriber, real-time")
    given = parser.parse_args()
    found = soak(given.seconds, given.rate, FAST if given.fast else 1.0, given.priority)
    print(line(describe()))
    for name, value in asdict(found).items():
        print(f"{name:10} {value:.6g}" if isinstance(value, float) else f"{name:10} {value}")
    return 1 if found.missing or found.lost else 0


if __name__ == "__main__":
    sys.exit(main())
