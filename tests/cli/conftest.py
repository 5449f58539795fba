"""A scene that starts at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.process import TUMBLE, rb_sim


@pytest.fixture(scope="session")
def tumble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene whose kernel is in the cache."""
    path = tmp_path_factory.mktemp("scene") / "tumble.yaml"
    path.write_text(TUMBLE, encoding="utf-8")
    assert rb_sim("warm", path).returncode == 0
    return path
