"""The site builds without a warning: no link leads nowhere, no page is left out."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest

from tests.docs.blocks import ROOT
from tools.site_hooks import APART

WANTED = ("apply_wrench", "revolute", "degrees", "bearing", "tolerance", "quaternion")
"""Words that users look for."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the site, built once."""
    pytest.importorskip("material")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(folder)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_site_builds(site):
    assert (site / "index.html").stat().st_size > 5000
    assert (site / "laws" / "spring.html").exists()


def test_the_site_needs_no_network(site):
    for page in ("index.html", "tutorials/top.html"):
        loaded = re.findall(
            r"<(?:script|link|img)[^>]+?(?:src|href)=\"?([^\" >]+)", (site / page).read_text()
        )
        assert any("katex.min.js" in address for address in loaded)
        assert [address for address in loaded if "//" in address] == []


def test_the_search_finds_what_users_look_for_and_no_internals(site):
    index = json.loads((site / "search" / "search_index.json").read_text())
    for word in WANTED:
        assert any(word in entry["text"] for entry in index["docs"]), word
    pages = {entry["location"].split("#")[0] for entry in index["docs"]}
    apart = {name.replace(".md", ".html") for name in APART}
    assert pages and pages.isdisjoint(apart)
