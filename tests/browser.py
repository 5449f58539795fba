# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Opens pages in headless Chromium, without a network, and asks them."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

WATCH = """<script>
window.complaints = [];
window.addEventListener("error", (event) => complaints.push(event.message));
for (const kind of ["error", "warn"]) console[kind] = (...what) => complaints.push(what.join(" "));
</script>"""
"""Stands before all scripts of a page."""


def dom_of(page: Path, *options: str) -> str:
    """The page's DOM after its scripts have run; skips the test without Chromium."""
    names = ("chromium", "chromium-browser", "google-chrome")
    chromium = next((name for name in names if shutil.which(name)), None)
    if chromium is None:
        pytest.skip("no chromium")
    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
               "--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=10000",
               *options, page.as_uri()]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    return done.stdout


def ask(page: Path, script: str, *options: str) -> Any:
    """What the function body `script` returns in the page, as data; fails if the page complained
    in its console or loaded anything."""
    asked = page.with_name(f"asked_{page.name}")
    answer = f"""<script>
    const answer = (() => {{ {script} }})();
    const loaded = performance.getEntriesByType("resource").map((entry) => entry.name);
    const told = document.createElement("pre");
    told.id = "answer";
    told.textContent = JSON.stringify({{answer, complaints, loaded}});
    document.body.append(told);
    </script></body>"""
    text = page.read_text(encoding="utf-8").replace("<head>", f"<head>{WATCH}", 1)
    asked.write_text(text.replace("</body>", answer, 1), encoding="utf-8")
    found = re.search(r'<pre id="answer">(.*?)</pre>', dom_of(asked, *options), re.DOTALL)
    assert found is not None, "the page's scripts came to no end"
    reported = json.loads(html.unescape(found[1]))
    assert reported["complaints"] == [] and reported["loaded"] == []
    return reported["answer"]
