# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The whole chain once: node and commander in two processes over DDS, and what the bag shows.

    python -m rb_sim.ros.demo [--out DIR]

A homogeneous sphere rolls on a rough plane under a commanded force F and torque K. The reactions
and accelerations in the bag are compared with the closed form of Landau & Lifshitz, Mechanics,
section 38, problem 1. Exit status 1 if they disagree.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rclpy
from geometry_msgs.msg import Vector3, WrenchStamped
from rclpy.duration import Duration
from rclpy.utilities import try_shutdown
from rich.console import Console
from rich.table import Table

from rb_sim.base.errors import RbSimError
from rb_sim.io.bag.reader import BagReader
from rb_sim.mechanics.samples import Array, SampleBlock, concatenate
from rb_sim.scene.listing import find_scene

# Commander: sends wrench commands to a running node, one after the other, and ends.


PATIENCE = 300.0
"""Timeout for discovery of the node, and for the receipt of a command [s]."""


class Wrench(NamedTuple):
    """A command in world axes."""

    force: tuple[float, float, float]
    """[N]."""
    torque: tuple[float, float, float]
    """about the body origin [N m]."""


def message(wrench: Wrench, frame: str) -> WrenchStamped:
    """The command as a ROS message."""
    command = WrenchStamped()
    command.header.frame_id = frame
    command.wrench.force = Vector3(**dict(zip("xyz", wrench.force, strict=True)))
    command.wrench.torque = Vector3(**dict(zip("xyz", wrench.torque, strict=True)))
    return command


def send(topic: str, wrenches: list[Wrench], pause: float) -> None:
    """Send each wrench and wait `pause` seconds after it.

    Raises RbSimError if no node subscribes to the topic, or a command is not received.
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


SCENE = "rolling_sphere_commanded"
BODY, FLOOR = "ball", "floor"
AGREE = 1e-8
"""Largest relative difference from the closed form."""
COMMANDS = [
    Wrench((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    Wrench((0.0, 0.0, 0.0), (0.0, 0.1, 0.0)),
    Wrench((-2.0, 1.0, 0.0), (0.05, -0.1, 0.02)),
    Wrench((0.5, -1.5, 4.0), (-0.1, 0.0, -0.02)),
]
PAUSE = 1.0
"""[s] between commands."""
START_LIMIT = RUN_LIMIT = PLOTS_LIMIT = 300.0
"""Timeouts [s] for the node to compile and start, for the run, and for its plots, which are drawn
after the node has ended."""


class Segment(NamedTuple):
    """Samples during which one command acted, and the quantities measured in them."""

    command: Array
    """[force, torque], shape (6,)."""
    reaction: Array
    """mean force of the plane on the sphere [N]."""
    acceleration: Array
    """of the centre, from its velocities at both ends [m/s^2]."""
    spin_up: float
    """angular acceleration about the vertical [rad/s^2]."""


class Sphere(NamedTuple):
    """Parameters of the closed form."""

    mass: float
    radius: float
    g: float = 9.81


def closed_form(command: Array, sphere: Sphere) -> tuple[Array, Array, float]:
    """Reaction, acceleration and vertical angular acceleration (LL section 38, problem 1)."""
    (F_x, F_y, F_z), (K_x, K_y, K_z) = command[:3], command[3:]
    m, a, g = sphere
    reaction = (5 * K_y / (7 * a) - 2 / 7 * F_x, -5 * K_x / (7 * a) - 2 / 7 * F_y, m * g - F_z)
    acceleration = 5 / (7 * m) * np.array([F_x + K_y / a, F_y - K_x / a, 0.0])
    return np.array(reaction), acceleration, K_z / (0.4 * m * a * a)


def segments(block: SampleBlock) -> Iterator[Segment]:
    """Yield the segments of constant command; a sample contains the command that acted up to it."""
    command = block.command[:, 0]
    starts = np.flatnonzero((np.diff(command, axis=0) != 0.0).any(axis=1)) + 1
    for first, end in zip(starts, [*starts[1:], len(command)], strict=True):
        if end - first < 3:
            continue
        last = end - 1
        dt = block.t[last] - block.t[first]
        # body axes rotate: the spin about the vertical follows from L about C
        spin = block.angular_momentum - np.cross(block.position[:, 0], block.momentum)
        yield Segment(
            command[first],
            block.reaction_force[first:end, 0].mean(axis=0),
            (block.linear_velocity[last, 0] - block.linear_velocity[first, 0]) / dt,
            float(spin[last, 2] - spin[first, 2]) / dt,
        )


def report(out: Path, console: Console) -> bool:
    """Print measured and closed-form values; True if they agree for every command."""
    reader = BagReader(out / "bag")
    block = concatenate(reader.blocks(), reader.layout)
    body = reader.scene.bodies[BODY]
    assert body.shape is not None  # the shipped scene has one
    sphere = Sphere(body.mass, body.shape.radius)
    inertia = 0.4 * sphere.mass * sphere.radius**2
    table = Table("", "measured over DDS", "closed form (LL section 38)")
    found = list(segments(block))
    worst = 0.0
    for segment in found:
        reaction, acceleration, spin_up = closed_form(segment.command, sphere)
        force, torque = _text(segment.command[:3]), _text(segment.command[3:])
        table.add_row("[bold]commanded", f"[bold]F = {force} N", f"[bold]K = {torque} N m")
        for name, measured, expected in (
            ("R        [N]", segment.reaction, reaction),
            ("dV/dt    [m/s^2]", segment.acceleration, acceleration),
            ("dw_z/dt  [rad/s^2]", segment.spin_up / inertia, spin_up),
        ):
            table.add_row(name, _text(measured), _text(expected))
            worst = max(worst, _difference(measured, expected))
        table.add_section()
    console.print(table)
    console.print(
        f"{len(found)} of {len(COMMANDS)} commands found in the bag; largest difference {worst:.1e}"
        f" (allowed {AGREE:g}); worst constraint residual {block.residual.max():.1e}"
    )
    return len(found) == len(COMMANDS) and worst < AGREE


def _difference(measured: Array | float, expected: Array | float) -> float:
    scale = max(1.0, float(np.abs(expected).max()))
    return float(np.abs(np.subtract(measured, expected)).max()) / scale


def _text(numbers: Array | float) -> str:
    return " ".join(f"{number:.7g}" for number in np.atleast_1d(np.round(numbers, 9) + 0.0))


def run(scene: Path, out: Path, console: Console) -> bool:
    """Run node and commander, each in its own process; then report.

    Logs of an earlier demonstration in the folder are replaced.
    """
    log = out / "node.log"
    out.mkdir(parents=True, exist_ok=True)
    again = str(log.exists()).lower()
    parameters = {"out": out, "real_time_factor": 1.0, "overwrite": again}
    command = [sys.executable, "-m", "rb_sim.ros.main", str(scene), "--ros-args"]
    for name, value in parameters.items():
        command += ["-p", f"{name}:={value}"]
    console.print(f"[bold]node[/bold]      {scene}  (output in {log})")
    with log.open("w") as file:
        node = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
    try:
        _wait_ready(node, log, console)
        topic = f"/rb_sim/{BODY}/wrench"
        console.print(f"[bold]commander[/bold] {len(COMMANDS)} wrenches on {topic}")
        spawn = multiprocessing.get_context("spawn")
        sender = spawn.Process(target=send, args=(topic, COMMANDS, PAUSE))
        sender.start()
        sender.join(RUN_LIMIT)
        if sender.exitcode != 0:
            raise RbSimError(f"the commander failed; output of the node: {log.read_text()}")
    finally:
        node.terminate()  # it completes the sample and the logs
        status = node.wait(RUN_LIMIT)
    if status != 0:
        raise RbSimError(f"the node failed: {log.read_text()}")
    return report(out, console)


def _wait_ready(node: subprocess.Popen[bytes], log: Path, console: Console) -> None:
    """Wait until the node takes commands. Raises RbSimError."""
    end = time.monotonic() + START_LIMIT
    console.print("          starts; the first time it compiles, which takes a while ...")
    while "takes commands on" not in log.read_text():
        if node.poll() is not None or time.monotonic() > end:
            raise RbSimError(f"the node did not start: {log.read_text()}")
        time.sleep(0.1)


def _drawn(plots: Path, since: float) -> bool:
    """Wait for plots newer than `since` (time.time) [s]; False after the timeout."""
    end = time.monotonic() + PLOTS_LIMIT
    while not plots.exists() or plots.stat().st_mtime < since:
        if time.monotonic() > end:
            return False
        time.sleep(0.1)
    return True


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `make run`; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="rb_sim.ros.demo", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    out: Path = parser.parse_args(arguments).out
    # DDS discovery on this machine only
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    console, began = Console(soft_wrap=True), time.time()
    try:
        agrees = run(find_scene(SCENE), out, console)
    except RbSimError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    console.print(f"bag        {out / 'bag'}")
    recording = out / "recording.rrd"
    view = f"{recording}  (view: {Path(sys.executable).with_name('rerun')} {recording})"
    console.print(f"recording  {view if recording.exists() else 'none: see the log'}")
    plots = out / "plots.png"
    console.print(f"plots      {plots if _drawn(plots, began) else 'none: see the log'}")
    console.print(f"log        {out / 'node.log'}")
    return 0 if agrees else 1


if __name__ == "__main__":
    sys.exit(main())
