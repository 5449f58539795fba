"""A scheduler whose only worker is a thread here, for tests of what a sweep leaves behind.

Workers in processes of their own, as `rb_sim sweep` has them, take seconds to start; they are
tested in test_sweep.py.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session")
def here() -> Iterator[str]:
    """The scheduler's address."""
    distributed = pytest.importorskip("distributed")
    settings = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "silence_logs": 50}
    with distributed.LocalCluster(dashboard_address=None, protocol="tcp", **settings) as cluster:
        yield cluster.scheduler_address
