"""What all tests have in common."""

from __future__ import annotations

import gc

import pytest


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave the thousands of tests to no garbage collector: it would go through them again and
    again while laws are traced, which makes many objects; 7 % of the time of tests/engine."""
    del session
    gc.collect()
    gc.freeze()
