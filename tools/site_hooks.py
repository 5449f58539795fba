"""Hooks of the site (mkdocs.yml): evidence and internals are not found by the search box."""

from __future__ import annotations

from typing import Any

APART = (
    "hard-cases.md",
    "peers.md",
    "heaps.md",
    "measurements.md",
    "thresholds.md",
    "steps.md",
)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Leave the pages APART out of the index, which they would crowd."""
    if page.file.src_path in APART:
        page.meta["search"] = {"exclude": True}
    return markdown
