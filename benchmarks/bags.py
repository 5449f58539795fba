# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags: writers beside each other, reading, and the analysis of a large bag.

    python -m benchmarks.bags [--samples N] [--rounds N]
    python -m benchmarks.bags --large [--samples N]  # 2 GB of records; written, analyzed, deleted

The samples are of one body, eight messages and /tf each. CPU time, so that other programs disturb
little; medians of rounds in which all parts come in turn. Peak memory is of the whole process (it
never falls), of a large bag's analysis that of a process of its own.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.bags.info import info
from rb_sim.bags.readings import Readings
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.bag.batches import BagScan
from rb_sim.io.bag.reader import BagReader
from rb_sim.mechanics.samples import SampleBlock, SampleLayout, empty_block
from rb_sim.scene.load import load_scene

SAMPLES = 200_000
LARGE = 3_300_000
"""Samples in 2 GB of records."""
LAYOUT = SampleLayout(("ball",), (), (), ())
PAYLOAD = bytes(84)


def motion(count: int) -> Iterator[SampleBlock]:
    """A ball on a circle, block by block."""
    for first in range(0, count, 1024):
        n = min(1024, count - first)
        block = empty_block(n, LAYOUT)
        t = (first + np.arange(n)) * 1e-3
        block.t[:] = t
        block.position[:, 0] = np.c_[np.cos(t), np.sin(t), 0.1 * np.sin(3 * t)]
        block.orientation[:, 0] = np.c_[0 * t, 0 * t, np.sin(t / 2), np.cos(t / 2)]
        yield block


def ours(folder: Path, count: int) -> int:
    """rb_sim's bag: packing, draft, index, metadata.yaml."""
    scene = load_scene({"bodies": {"ball": {"mass": 1, "inertia": [1, 1, 1]}}})
    sink = BagSink(folder)
    sink.open(scene, LAYOUT)
    for block in motion(count):
        sink.write(block)
    sink.close()
    scan = BagScan(folder / f"{folder.name}_0.mcap")
    return sum(len(m.start) for batch in scan.batches() for m in batch.values())


def bare(path: Path, count: int) -> int:
    """The mcap library's writer alone, bytes that are ready."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, chunk_size=128 * 1024)
        writer.start(profile="ros2")
        channel = writer.register_channel("/x", "cdr", writer.register_schema("x", "ros2msg", b""))
        for k in range(count):
            writer.add_message(channel, k, PAYLOAD, k)
        writer.finish()
    return count


def foxglove(path: Path, count: int) -> int:
    """The Rust writer of foxglove-sdk, bytes that are ready; its `log` takes no sequence number."""
    import foxglove as sdk

    writer = sdk.open_mcap(path)
    schema = sdk.Schema(name="x", encoding="ros2msg", data=b"")
    channel = sdk.Channel("/x", schema=schema, message_encoding="cdr")
    for k in range(count):
        channel.log(PAYLOAD, log_time=k)
    writer.close()
    return count


class Clock:
    """Rates of the parts, round by round: messages or MB for each second of CPU time."""

    def __init__(self) -> None:
        self.rates: dict[str, list[float]] = defaultdict(list)

    def timed(self, name: str, act: Callable[[], object], size: float = 0.0) -> None:
        """size: [MB]; 0: `act` gives a number of messages."""
        began = time.process_time()
        result = act()
        spent = time.process_time() - began
        self.rates[name].append((size or int(result)) / spent)  # type: ignore[call-overload]

    def show(self) -> None:
        for name, rates in self.rates.items():
            unit = "messages/s" if name.startswith("writer") else "MB/s"
            low, middle, high = min(rates), statistics.median(rates), max(rates)
            print(f"{name:32} {middle:8.0f} {unit} ({low:.0f} to {high:.0f})")


def sizes(file: Path) -> tuple[float, float]:
    """Of the records and on the disk [MB]."""
    records = sum(
        int(m.size.sum()) + 31 * len(m.size)
        for batch in BagScan(file).batches()
        for m in batch.values()
    )
    return records / 1e6, file.stat().st_size / 1e6


def large(count: int) -> None:
    """`rb_sim analyze` of a bag of so many samples, in a process of its own."""
    with tempfile.TemporaryDirectory() as name:
        bag = Path(name) / "bag"
        ours(bag, count)
        size, disk = sizes(bag / "bag_0.mcap")
        print(f"the bag: {size:.0f} MB of records, {disk:.0f} MB on the disk", flush=True)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "rb_sim.cli.main", "analyze", str(bag), "--json"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        peak = after.ru_maxrss / 1024
        print(f"rb_sim analyze: {spent:.1f} s CPU, {size / spent:.0f} MB/s, peak {peak:.0f} MB; "
              f"the machine's load: {os.getloadavg()[0]:.1f}")  # fmt: skip


def one_round(clock: Clock, count: int, folder: Path) -> None:
    clock.timed("writer: bare mcap", lambda: bare(folder / "bare.mcap", count))
    try:
        clock.timed("writer: foxglove-sdk", lambda: foxglove(folder / "foxglove.mcap", count))
    except ImportError:
        print("writer: foxglove-sdk: not installed (the extra `bench`)")
    clock.timed("writer: rb_sim", lambda: ours(folder / "bag", count))
    bag = folder / "bag"
    file = bag / "bag_0.mcap"
    size, disk = sizes(file)
    if "read: samples" not in clock.rates:
        print(f"the bag: {size:.1f} MB of records, {disk:.1f} MB on the disk", flush=True)
        analyze(bag)  # loads what a first call needs
    clock.timed("read: checksums, messages", lambda: list(map(len, BagScan(file).batches())), size)
    clock.timed("read: samples", lambda: sum(len(b) for b in BagReader(bag).blocks()), size)
    clock.timed("info", lambda: info(bag), size)
    clock.timed("read: as anybody's", lambda: sum(len(p.t) for p in Readings(bag).pieces()), size)
    clock.timed("analyze", lambda: analyze(bag), size)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.bags", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--samples", type=int, help=f"of the bag ({SAMPLES}; --large: {LARGE})")
    parser.add_argument("--rounds", type=int, default=5, help="of which the medians are shown (5)")
    parser.add_argument("--large", action="store_true", help="analyze 2 GB, in one process")
    options = parser.parse_args()
    if options.large:
        large(options.samples or LARGE)
        return
    clock = Clock()
    for _ in range(options.rounds):
        with tempfile.TemporaryDirectory() as name:
            one_round(clock, options.samples or SAMPLES, Path(name))
    clock.show()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak {peak:.0f} MB; the machine's load: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
