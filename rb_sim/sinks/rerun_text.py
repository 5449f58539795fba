"""What a recording says in words: its legend, events, the summary.

Imported only when a recording is opened.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

if TYPE_CHECKING:
    from rb_sim.engine.samples import ContactEvent, SampleLayout
    from rb_sim.scene.schema import Scene
    from rb_sim.sinks.rerun_scales import Scales


def about(scene: Scene, layout: SampleLayout, scales: Scales, *, forces: bool) -> str:
    """What is drawn, and at which scale. forces: whether reactions are."""
    lines = [f"## {scene.name}", scene.description, ""]
    lines += [f"**velocity** (green): 1 m of arrow is {1 / scales.per_speed:g} m/s  "]
    if forces:
        newton = f"{1 / scales.per_newton:g} N"
        lines += [f"**reaction** on the body (orange): 1 m of arrow is {newton}  "]
    if layout.commanded:
        lines += ["**commanded force** (pink): same scale as the reactions  "]
    if layout.contacts:
        lines += ["**contact** points, where closed: orange slips, blue sticks or rolls  "]
    if scales.origin.any():
        lines += [f"**places** in the 3D view are counted from {scales.origin.tolist()} m  "]
    lines += ["**trail** of the centre of mass so far (grey); body axes x red, y green, z blue"]
    return "\n".join(lines)


def told(event: ContactEvent) -> str:
    """An event of a contact in one line."""
    strength = float(np.linalg.norm(event.impulse))
    struck = f", {strength:.4g} N s" if strength else ""
    return f"t = {event.t:.9g} s: {event.contact} {event.kind}{struck}"


def markdown(text: str) -> Any:
    """The text as a document of the recording."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def summary_text(summary: dict[str, Any]) -> str:
    """The numbers of the summary as a list; what is nested as JSON."""
    rows = [f"- {key}: {_short(value)}" for key, value in summary.items()]
    return "\n\n**Summary**\n" + "\n".join(rows)


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value, default=str)
