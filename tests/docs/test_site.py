"""The site builds without a warning: no link leads nowhere, no page is left out."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.docs.blocks import ROOT


def test_the_site_builds(tmp_path):
    pytest.importorskip("material")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", str(tmp_path)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "index.html").stat().st_size > 5000
    assert (tmp_path / "laws" / "spring.html").exists()
