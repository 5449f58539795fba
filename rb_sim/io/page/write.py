"""Writes a page: the template, its style, its scripts and the data in one file.

The page loads nothing: it opens from a disk, without a network.
"""

from __future__ import annotations

import base64
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import SinkError

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array

ASSETS = Path(__file__).parent
SCRIPTS = {"page": ("solids.js", "plots.js", "page.js"), "report": ("plots.js", "report.js")}
"""Of a kind of page, in the order in which they need each other."""

MOST_SAMPLES = 5000
"""Instants of a motion in a page; a screen shows no more."""

BYTES = 1_400_000
"""For the poses and arrows of a page; with as many curves, as base64, it stays below 3 MB."""

CURVE_BYTES = 550_000
"""For its curves of energies and reactions."""


def packed(values: Array, kind: str = "float32") -> dict[str, Any]:
    """Numbers as the page reads them. kind: float64, float32, uint8; or uint16: in 65,535 steps
    between the least and the greatest of them."""
    flat = np.asarray(values, dtype=float).ravel()
    scale = {}
    if kind == "uint16":
        flat = np.nan_to_num(flat)
        low, high = float(flat.min(initial=0.0)), float(flat.max(initial=0.0))
        step = (high - low) / 65535.0 or 1.0
        scale = {"low": low, "step": step}
        flat = np.rint((flat - low) / step)
    with np.errstate(over="ignore", invalid="ignore"):
        data = np.ascontiguousarray(flat, dtype=np.dtype(kind).newbyteorder("<"))
    return {"type": kind, **scale, "base64": base64.b64encode(data.tobytes()).decode()}


def spread(count: int, per_sample: float) -> np.ndarray:
    """Indices of the samples that a page has room for, first and last included.

    per_sample: bytes of one of them.
    """
    most = int(min(count, MOST_SAMPLES, max(2.0, BYTES / max(per_sample, 1.0))))
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def save(page: dict[str, Any], path: Path, kind: str = "page", body: str = "") -> None:
    """Write the page, never half of it; SinkError.

    page: its data and title. kind: "page", a motion in 3D; or "report", curves in the HTML `body`.
    """
    data = json.dumps(page, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    data = data.replace("<", "\\u003c")  # `</script>` and `<!--` in a name would end the data
    scripts = [(ASSETS / name).read_text(encoding="utf-8") for name in SCRIPTS[kind]]
    parts = {
        "title": _escaped(page["title"]),
        "style": (ASSETS / "page.css").read_text(encoding="utf-8"),
        "body": body,
        "data": data,
        "script": "\n".join(scripts),
    }
    text = (ASSETS / f"{kind}.html").read_text(encoding="utf-8")
    written = []
    for name, part in parts.items():  # in the order of the template: a part may have braces
        head, found, tail = text.partition("{{" + name + "}}")
        if found:
            written += [head, part]
            text = tail
    text = "".join([*written, text])
    draft = path.with_name(f".{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        raise SinkError(f"{path}: cannot write it: {error.strerror}") from None
    finally:
        draft.unlink(missing_ok=True)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")
