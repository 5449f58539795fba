# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Makes the pictures of the tutorials: python -m tools.tutorials [PAGE ...]

Each page of docs/tutorials is run as the tests run it; pictures that its blocks save and that it
shows go to docs/tutorials/pictures/PAGE, with as few colours as they need, and what their curves
are to curves.json, with which tests compare what the page draws.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
from cycler import cycler
from PIL import Image

from rb_sim.base.palette import AXES, ORANGE
from tests.docs.page_run import pictures, run_page
from tools.colors import few_colors
from tools.pictures import data_of, keep

FOLDER = Path(__file__).parents[1] / "docs" / "tutorials"
WIDTH = 1100
"""Of a picture at most [px]."""
STYLE: dict[Any, Any] = {
    "figure.dpi": 110,
    "savefig.dpi": 110,
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "legend.frameon": False,
    "axes.prop_cycle": cycler(color=[*AXES[:3], ORANGE, AXES[3]]),  # x, y, z as in plots.png
    "figure.constrained_layout.use": True,
}
"""Of matplotlib, so that the pages need not say how a picture looks, only what it shows."""


def draw(page: Path) -> None:
    """Run the page in an empty folder and keep its pictures."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        with matplotlib.rc_context(STYLE):
            curves = run_page(page)
        kept = FOLDER / "pictures" / page.stem
        for name in pictures(page):
            small(Path(name), Path("small.png"))
            keep(Path("small.png"), kept / name)
        rows = [f"{json.dumps(name)}: {json.dumps(curves[name])}"
                for name in pictures(page) if name in curves]  # fmt: skip
        if rows:
            (kept / "curves.json").write_text("{\n" + ",\n".join(rows) + "\n}\n")


def narrow(source: Path) -> Image.Image:
    """The picture with WIDTH at most."""
    with Image.open(source) as image:
        image = image.convert("RGB")
        if image.width > WIDTH:
            image.thumbnail((WIDTH, image.height), Image.Resampling.LANCZOS)
        return image


def small(source: Path, target: Path) -> None:
    """Write the picture with WIDTH at most, and few colours."""
    few_colors(narrow(source)).save(target, optimize=True, pnginfo=data_of(source))


def main(names: list[str]) -> int:
    """Pages by their names without suffix; all if none is given."""
    for page in sorted(FOLDER.glob("*.md")):
        if not names or page.stem in names:
            draw(page)
    return 0


if __name__ == "__main__":
    os.environ.setdefault("RB_SIM_DRAFT", "1")
    sys.exit(main(sys.argv[1:]))
