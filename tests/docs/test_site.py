# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The site builds without a warning: no link leads nowhere, no page is left out."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
import sys

import pytest

import rb_sim
from benchmarks.heaps import __main__ as heaps
from rb_sim.sweeps import hard_cases as report
from tests.browser import dom_of
from tests.docs.blocks import PAGES, ROOT
from tools import thresholds

WANTED = ("apply_wrench", "revolute", "degrees", "bearing", "tolerance", "quaternion")
"""Words that users look for."""
APART = (
    "hard-cases",
    "peers",
    "heaps",
    "measurements",
    "thresholds",
    "time-stepping-solver",
)
"""Pages of evidence and internals, which would crowd users' pages out."""
SEARCH = """<script>
const inputs = (root) => [...root.querySelectorAll("*")].flatMap(
  (e) => [...(e.matches("input[type=text], input[type=search]") ? [e] : []),
          ...(e.shadowRoot ? inputs(e.shadowRoot) : [])]);
const links = (root) => [...root.querySelectorAll("*")].flatMap(
  (e) => (e.shadowRoot ? [...e.shadowRoot.querySelectorAll("a[href]"),
                          ...links(e.shadowRoot)] : []));
const typed = (word) => {
  const [box] = inputs(document);
  box.value = word;
  box.dispatchEvent(new Event("input", {bubbles: true, composed: true}));
};
const found = {};
const search = ([word, ...rest]) => {
  if (word === undefined) {
    const told = document.createElement("pre");
    told.id = "found";
    told.textContent = JSON.stringify(found);
    document.body.append(told);
    return;
  }
  typed(word);
  setTimeout(() => {
    found[word] = links(document).map((a) => a.getAttribute("href"));
    search(rest);
  }, 2000);
};
addEventListener("load", () => setTimeout(() => {
  document.querySelector("[for=__search], .md-search__button").click();
  setTimeout(() => search(WORDS), 1000);
}, 1000));
</script></body>"""
"""Types words into the search box and writes the addresses of their results into the page."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the site, built once, from a copy: Zensical takes the folder of its settings."""
    pytest.importorskip("zensical")
    tree = tmp_path_factory.mktemp("site")
    for name in ("docs", "rb_sim"):
        shutil.copytree(ROOT / name, tree / name)
    shutil.copy(ROOT / "mkdocs.yml", tree)
    command = [sys.executable, "-m", "zensical", "build", "--strict"]
    done = subprocess.run(
        command, cwd=tree, capture_output=True, text=True, timeout=300, check=False
    )
    said = done.stdout + done.stderr
    assert done.returncode == 0 and "No issues found" in said, said
    return tree / "build" / "site"


def test_the_site_builds_every_page(site):
    for page in PAGES:
        if page.is_relative_to(ROOT / "docs") and page.parent.name != "vendor":
            built = site / page.relative_to(ROOT / "docs").with_suffix(".html")
            assert built.stat().st_size > 5000, page


def test_every_picture_is_there():
    for page in PAGES:
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / name).exists(), f"{page}: {name}"


def test_the_head_states_the_version():
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert f"site_name: rb_sim {rb_sim.__version__}\n" in settings


def test_the_site_needs_no_network(site):
    for page in ("index.html", "tutorials/top.html"):
        loaded = re.findall(
            r"<(?:script|link|img)[^>]+?(?:src|href)=\"?([^\" >]+)", (site / page).read_text()
        )
        assert any("katex.min.js" in address for address in loaded)
        assert [address for address in loaded if "//" in address] == []


def test_the_search_finds_what_users_look_for_and_no_internals(site):
    entries = json.loads((site / "search.json").read_text())["items"]
    for word in WANTED:
        assert any(word in entry["text"] for entry in entries), word
    pages = {entry["location"].split("#")[0] for entry in entries}
    assert pages and pages.isdisjoint(f"{name}.html" for name in APART)


@pytest.mark.parametrize("written", [heaps.HEAD, report.HEAD, thresholds.HEAD])
def test_pages_of_evidence_are_written_out_of_the_search(written):
    head, _, page = written.removeprefix("---\n").partition("---\n\n")
    assert "search: {exclude: true}\n" in head and page.startswith("# ")


FOUND = {
    "apply_wrench": "reference/python.html",
    "revolute": "reference/glossary.html",
    "degrees": "reference/glossary.html",
}
"""Words, and a page that the search box finds each on."""


def test_the_search_box_works_from_the_disk(site):
    text = (site / "index.html").read_text(encoding="utf-8")
    script = SEARCH.replace("WORDS", json.dumps(list(FOUND)))
    (site / "asking.html").write_text(text.replace("</body>", script), encoding="utf-8")
    told = re.search(r'<pre id="found">(.*?)</pre>', dom_of(site / "asking.html"), re.DOTALL)
    assert told
    found = json.loads(html.unescape(told[1]))
    for word, page in FOUND.items():
        assert any(page in address for address in found[word]), word
    assert found["apply_wrench"] != found["degrees"]  # each list is of its own word
