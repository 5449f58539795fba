"""What all tests have in common."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from rb_sim.engine.recent import forget


@pytest.fixture(autouse=True)
def _laws_of_its_own(request: pytest.FixtureRequest) -> Iterator[None]:
    """Keep laws that were traced while something was patched from other tests, and the reverse."""
    patched = "monkeypatch" in request.fixturenames
    if patched:
        forget()
    yield
    if patched:
        forget()


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave the thousands of tests to no garbage collector: it would go through them again and
    again while laws are traced, which makes many objects; 7 % of the time of tests/engine."""
    del session
    gc.collect()
    gc.freeze()
