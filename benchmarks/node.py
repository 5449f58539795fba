# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node beside a bare rclpy program that publishes the same messages, in one run.

`python -m benchmarks.node [--seconds S] [--rate HZ] [--rounds N] [--save FILE.npz]`: CPU per sample
of the node without and with logs (their process included) and of the bare program, and the period
in which /clock arrives. The programs run in turn, one round after the other, so that each round has
them under the same load. Of CPU the table has medians over the rounds, and the least and the
largest ratio within one. A percentile of the periods is of all rounds together, since a round alone
has few periods beyond 99.9 %, and what makes them (another program, the host) comes in bursts; so
its ratio has the range that holds 90 % of the ratios of as many rounds, drawn anew from these. The
first samples of a program do not count.
"""

from __future__ import annotations

import argparse
import gc
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.machine import alone, describe, line

SCENE = "rolling_sphere_commanded"
FIRST = 2000
"""Samples before those that count."""
PERCENTILES = (50.0, 99.0, 99.9)
DRAWS = 2000
"""Times that the rounds are drawn anew for the range of a ratio."""
BARE = """
import sys, time
import rclpy
from rb_sim import Simulation
from rb_sim.ros.topics.topic_sink import TopicSink
rclpy.init()
node = rclpy.create_node("rb_sim")
simulation = Simulation(sys.argv[1])
sink = TopicSink(node, 10)
sink.open(simulation.scene, simulation.layout)
(instant,) = sink._table.messages(simulation.sample().block)
pairs = list(zip(sink._publishers, instant.messages))
due, period = time.monotonic(), 1 / float(sys.argv[2])
while True:
    for publisher, data in pairs:
        publisher.publish(data)
    due += period
    time.sleep(max(0.0, due - time.monotonic()))
"""


def own_cpu(pid: int) -> float:
    """CPU time of a process without its children so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def cpu(pid: int) -> float:
    """CPU time of a process and its children so far [s]."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return own_cpu(pid) + sum(cpu(int(child)) for child in children)


class Round(NamedTuple):
    """What one program did in one round."""

    spent: float
    """CPU per sample [us]."""
    periods: np.ndarray
    """in which samples arrived [ms]."""


def measure(command: list[str], seconds: float) -> Round:
    """Run the program for so long, and listen."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rosgraph_msgs.msg import Clock

    node, arrived = rclpy.create_node("listener"), []
    node.create_subscription(Clock, "/clock", lambda _: arrived.append(time.monotonic()), 1000)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while len(arrived) < FIRST:  # /clock is there while it compiles, too, but slowly
            executor.spin_once(timeout_sec=0.1)
            if process.poll() is not None:
                raise SystemExit(f"ended: {' '.join(command)}")
        arrived.clear()
        gc.collect()
        gc.freeze()  # the listener's own pauses are nobody's period
        before, end = cpu(process.pid), time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
        spent = cpu(process.pid) - before
    finally:
        process.terminate()
        process.wait(60)
        executor.shutdown()
        node.destroy_node()
    return Round(spent / len(arrived) * 1e6, np.diff(arrived) * 1e3)


def percentiles(rounds: list[Round]) -> np.ndarray:
    """PERCENTILES of the periods of all rounds together [ms]."""
    return np.percentile(np.concatenate([one.periods for one in rounds]), PERCENTILES)


def ratio_ranges(rounds: list[Round], bare: list[Round]) -> np.ndarray:
    """5 and 95 % of the ratio of each percentile over the bare program's, shape (2, n).

    Rounds are drawn with replacement, of both programs the same ones, as they ran beside each
    other (Efron, Bootstrap methods: another look at the jackknife, 1979).
    """
    random, found = np.random.default_rng(0), []
    for _ in range(DRAWS):
        drawn = random.integers(len(rounds), size=len(rounds))
        ratio = percentiles([rounds[k] for k in drawn]) / percentiles([bare[k] for k in drawn])
        found.append(ratio)
    return np.percentile(found, [5, 95], axis=0)


def show(rows: dict[str, list[Round]], heading: str) -> None:
    """Print the table."""
    print(heading)
    reported = "".join(
        f"{f'p{share:g} [ms]':>12} times {'(5 to 95 %)':14}" for share in PERCENTILES
    )
    print(f"{'':15} CPU [us] times {'(all rounds)':14}  samples/s{reported}")
    bare = rows["bare rclpy"]
    for name, rounds in rows.items():
        spent = np.array([one.spent for one in rounds])
        times = spent / [one.spent for one in bare]
        between = f"({min(times):.2f} to {max(times):.2f})"
        held = 1e3 / np.mean(np.concatenate([one.periods for one in rounds]))
        found, low_high = percentiles(rounds), ratio_ranges(rounds, bare)
        cells = "".join(
            f"{period:12.3f} {ratio:5.2f} {f'({low:.2f} to {high:.2f})':14}"
            for period, ratio, (low, high) in zip(
                found, found / percentiles(bare), low_high.T, strict=True
            )
        )
        cpu_cells = f"{np.median(spent):8.1f} {np.median(times):5.2f} {between:14}"
        print(f"{name:15} {cpu_cells} {held:10.1f}{cells}")


def main() -> None:
    """Print the table."""
    import rclpy

    parser = argparse.ArgumentParser(description="The node beside a bare rclpy program.")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each program in a round")
    parser.add_argument("--rate", type=float, default=1000.0, help="samples per second")
    parser.add_argument("--rounds", type=int, default=10, help="of all programs")
    parser.add_argument("--save", type=Path, help="file for the periods, by program and round")
    given = parser.parse_args()
    rclpy.init()
    rate = ["-p", f"rate:={given.rate}"]
    rows: dict[str, list[Round]] = {}
    with alone(), tempfile.TemporaryDirectory() as folder:
        node = [sys.executable, "-m", "rb_sim.ros.main", SCENE, "--ros-args", *rate]
        programs = {
            "bare rclpy": [sys.executable, "-c", BARE, SCENE, str(given.rate)],
            "node": node,
            "node, all logs": [*node, "-p", f"out:={folder}/run-{{time}}"],
        }
        for _ in range(given.rounds):
            for name, command in programs.items():
                rows.setdefault(name, []).append(measure(command, given.seconds))
    show(rows, f"{line(describe())}; {given.rounds} rounds of {given.seconds:g} s")
    if given.save:
        kept: Any = {
            f"{name} {k}": one.periods for name, of in rows.items() for k, one in enumerate(of)
        }
        np.savez(given.save, **kept)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
