# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Makes the pictures of README and docs: python -m tools.pictures [PICTURE ...]

MADE says what makes each of them, but those of the tutorials, which blocks of their pages make
(tools/tutorials.py). A picture that shows what the kept one shows is not written again, so that
`make docs` changes no file that need not change.
"""

from __future__ import annotations

import contextlib
import html
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib
import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from typer.testing import CliRunner

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.ladder import Accuracy, Ladder, Reference, Rung
from rb_sim.accuracy.runs import Errors
from rb_sim.cli.main import app
from rb_sim.cli.verbs.hard_cases import shipped
from rb_sim.sweeps.hard_cases import Row, load_cases, picture
from tools import gallery, law_pictures, readme_picture
from tools.law_examples import EXAMPLES

DOCS = Path(__file__).parents[1] / "docs"
REPORT = (800, 1200)
"""Of the part of a report that is shown [px]."""
FILED = 1_767_225_600
"""The date of its file [s since 1970], so that the picture is not another one every day."""
DATA = "accuracy.json"
"""Key of the data in a picture of measured times."""
WORDS = "words"
"""Key of the words in a picture of a page."""
CELL, NEAR = 8, 16
"""Pictures show the same if no cell of so many pixels differs by more, of 255: fonts and rounding
of another machine do not, a curve that lies elsewhere does."""

Maker = Callable[[Path], None]
"""Writes one picture or several into a folder."""


def rb_sim(folder: Path, *lines: str) -> None:
    """Run the commands there, each drawing in its own style. RuntimeError: one fails."""
    for line in lines:
        with contextlib.chdir(folder), matplotlib.rc_context():
            matplotlib.rcdefaults()
            done = CliRunner().invoke(app, line.split(), catch_exceptions=False)
        if done.exit_code != 0:
            raise RuntimeError(f"rb_sim {line}: {done.output}")


def plain(source: Path, target: Path) -> None:
    """Write the picture without transparency, with all its colours."""
    with Image.open(source) as image:
        image.convert("RGB").save(target, optimize=True, pnginfo=data_of(source))


def data_of(picture: Path) -> PngInfo | None:
    """The measured data of a work-precision diagram that `rb_sim accuracy` wrote; None of others.

    The picture carries them, so that a test can draw it anew without measuring times again.
    """
    data = picture.with_name("accuracy.json")
    if picture.name != "accuracy.png" or not data.exists():
        return None
    info = PngInfo()
    info.add_text(DATA, json.dumps(json.loads(data.read_text(encoding="utf-8"))), zip=True)
    return info


def measured(picture: Path) -> Accuracy:
    """What a work-precision diagram shows, from the data in it."""
    with Image.open(picture) as image:
        document = json.loads(image.info[DATA])
    true = document["reference"]
    reference = Reference(
        np.zeros(0), true["kind"], true["checked_by"], _errors(true["agreement"]),
        _errors(true["ulp_growth"]), 0.0, scatter=_errors(true["floor"]),
    )  # fmt: skip
    ladders = tuple(
        Ladder(ladder["name"], tuple(map(_rung, ladder["rungs"])), ladder["end"])
        for ladder in document["ladders"]
    )
    layout: Any = SimpleNamespace(reactions=True)
    return Accuracy(document["scene"], document["duration_s"], layout, reference, ladders, 0.0)


def _errors(values: dict[str, float | None]) -> Errors:
    found = (values[key] for key in Errors._fields)
    return Errors(*(math.inf if value is None else value for value in found))


def _rung(row: dict[str, Any]) -> Rung:
    setting = Setting(row["method"], row["step_s"], row["tolerance"])
    cost = math.inf if row["cpu_s_per_s"] is None else row["cpu_s_per_s"]
    return Rung(setting, row["steps"], _errors(row), cost)


def pictures(maker: Maker, *names: str) -> dict[str, Maker]:
    """Those of these names in docs/pictures."""
    return {f"pictures/{name}": maker for name in names}


def drawn_by(*lines: str, files: dict[str, str]) -> dict[str, Maker]:
    """Pictures that these commands write: their names, and the files that the commands make."""

    def make(folder: Path) -> None:
        rb_sim(folder, *lines)
        for name, file in files.items():
            plain(folder / file, folder / name)

    return pictures(make, *files)


def of_sweep(plan: str, file: str) -> dict[str, Maker]:
    """A picture of the report of a shipped plan."""
    lines = f"sweep {plan} --out out", "sweep report out"
    return drawn_by(*lines, files={f"sweep_{plan}.png": f"out/{file}.png"})


def hard_cases(folder: Path) -> None:
    """The picture of the table in docs/hard-cases.md."""
    table, *_ = (DOCS / "hard-cases.md").read_text(encoding="utf-8").partition("\n## ")
    cells = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ")]
    rows = [
        Row(case, method, knob, check, float(figure), float(bound), float(seconds), verdict, "")
        for case, method, knob, check, figure, bound, _, seconds, verdict in cells[1:]
    ]
    picture(load_cases(shipped()), rows, folder / "full.png")
    plain(folder / "full.png", folder / "hard-cases.png")


def report(folder: Path) -> None:
    """The top of the page that `rb_sim analyze` writes, drawn by Chromium."""
    chromium = next(filter(shutil.which, ("chromium", "chromium-browser", "google-chrome")))
    page = report_page(folder)
    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
               f"--window-size={REPORT[0]},{REPORT[1]}", "--virtual-time-budget=10000",
               "--screenshot=full.png", page.as_uri()]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    info = PngInfo()
    info.add_text(WORDS, words_on(page), zip=True)
    with Image.open(folder / "full.png") as image:
        image.convert("RGB").save(folder / "bags_report.png", optimize=True, pnginfo=info)


def report_page(folder: Path) -> Path:
    """The page that `rb_sim analyze` writes of a shipped scene."""
    rb_sim(folder, "run heavy_top --duration 3 --out top --no-rerun --no-plots --quiet")
    for file in (folder / "top").rglob("*"):
        os.utime(file, (FILED, FILED))
    rb_sim(folder, "analyze top/bag --out out")
    return folder / "out" / "report.html"


def words_on(page: Path) -> str:
    """The words of a page without its numbers, which the picture of it carries: a test compares
    them without a browser, whose fonts differ from machine to machine."""
    text = re.sub(r"<(script|style).*?</\1>|<[^>]*>", " ", page.read_text("utf-8"), flags=re.DOTALL)
    return " ".join(re.findall(r"[^\W\d_]{2,}", html.unescape(text)))


TWO_MOTIONS = (
    "run thrown_ball --out ball --no-rerun --no-plots --quiet",
    "resim ball/bag --set effects.weight.acceleration=[0,0,-9.7] --out changed",
)
MADE: dict[str, Maker] = {
    **pictures(readme_picture.draw, "heavy_top.gif"),
    **pictures(gallery.draw, "gallery.jpg", *(f"scene_{name}.jpg" for name in gallery.OWN)),
    **{f"pictures/scene_{name}.png": partial(gallery.draw_at_rest, name)
       for name in gallery.AT_REST},
    **drawn_by("accuracy heavy_top --out out",
               files={"accuracy_heavy_top.png": "out/accuracy.png"}),
    **drawn_by(*TWO_MOTIONS, "compare ball/bag changed/bag --out apart",
               files={"bags_compare.png": "apart/compare.png"}),
    **pictures(report, "bags_report.png"),
    **pictures(hard_cases, "hard-cases.png"),
    **of_sweep("coin", "map_heads"),
    **of_sweep("ladder_friction", "map_slipped"),
    **of_sweep("pendulum_separatrix", "map_over_the_top"),
    **of_sweep("rattleback_skew", "curve_fastest_back"),
    **of_sweep("rotor_imbalance", "distribution_load_A"),
    **{f"laws/pictures/{kind}.png": partial(law_pictures.draw, kind) for kind in EXAMPLES},
}  # fmt: skip
"""What makes a picture, by its path in docs."""


def same(one: Path, other: Path) -> bool:
    """Whether the pictures show the same; of a film, its last frame."""
    shown = []
    for path in (one, other):
        with Image.open(path) as image:
            image.seek(getattr(image, "n_frames", 1) - 1)
            shown.append(np.asarray(image.convert("RGB").reduce(CELL), dtype=int))
    a, b = shown
    return a.shape == b.shape and bool(np.abs(a - b).max() <= NEAR)


def words_of(picture: Path) -> str:
    """The words that a picture carries; "": none."""
    with Image.open(picture) as image:
        return image.info.get(WORDS, "")


def keep(made: Path, kept: Path) -> None:
    """Put the picture there, unless one that shows and says the same is there, and say which."""
    stays = kept.exists() and same(made, kept) and words_of(made) == words_of(kept)
    if not stays:
        kept.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(made, kept)
    print(f"{kept.relative_to(DOCS)}: {'as it was' if stays else 'new'}", flush=True)


def main(paths: list[str]) -> int:
    """Make these pictures, paths in docs; all if none is given."""
    paths = paths or [*MADE]
    for maker in dict.fromkeys(MADE[path] for path in paths):
        with tempfile.TemporaryDirectory() as folder:
            maker(Path(folder))
            for path in (path for path in paths if MADE[path] is maker):
                keep(Path(folder, Path(path).name), DOCS / path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
