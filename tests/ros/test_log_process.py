"""The queue to the process that writes the logs, where that does not keep up."""

from __future__ import annotations

import psutil

from rb_sim.sinks.bag_reader import BagReader
from tests.ros import bags
from tests.ros.client import NAME, Client


def test_a_bag_tells_how_many_samples_it_lacks(sphere, start, client: Client, tmp_path):
    """Of those that found the queue full while the simulation kept to the clock."""
    node = start(sphere, out=tmp_path, log_rerun=False, log_plots=False, rate=1000, log_queue=100)
    (writer,) = psutil.Process(node.process.pid).children()
    writer.suspend()
    client.diagnostics(lambda v: int(v["log rows dropped, bag"]) > 0, "dropped rows")
    writer.resume()
    assert node.stop() == 0
    logged = bags.count(tmp_path / "bag", f"{NAME}/ball/pose")
    summary = BagReader(tmp_path / "bag").summary
    assert 0 < summary["samples_dropped"] == summary["samples"] - logged
