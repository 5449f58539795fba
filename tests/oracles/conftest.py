"""The reference cases: closed forms or quadruple-precision integrations, to the last double."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

FILE = Path(__file__).parent / "cases_public.json"


@pytest.fixture(scope="session")
def cases() -> dict[str, dict[str, Any]]:
    """The cases by id."""
    return {case["id"]: case for case in json.loads(FILE.read_text())["cases"]}
