# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every block of Python, YAML and shell in the documentation runs, page by page, as it stands."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

from rb_sim import Simulation
from rb_sim.cli.main import app
from rb_sim.equilibrium.statics import solve
from rb_sim.scene.listing import shipped_statics
from rb_sim.scene.load import load_statics
from tests.docs.blocks import PAGES, ROOT, blocks, name_of
from tests.docs.page_run import pictures, run_page, same_curves
from tools.pictures import same
from tools.tutorials import narrow

MEASURED = ("costs/accuracy.png",)
"""Pictures of CPU times, which differ from run to run."""
RUN = [page for page in PAGES if any(b.language in ("python", "sh", "yaml") for b in blocks(page))]


@pytest.mark.parametrize("page", RUN, ids=name_of)
def test_blocks_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    kept_curves = page.parent / "pictures" / page.stem / "curves.json"
    by_curves = json.loads(kept_curves.read_text()) if kept_curves.exists() else {}
    curves = run_page(page, by_curves)
    if page.parent.name == "tutorials":
        for name in pictures(page):
            assert Path(name).stat().st_size > 1000, f"{name} is shown, but no block makes it"
            kept = page.parent / "pictures" / page.stem / name
            again = (
                f"{kept} is missing or another picture: run python -m tools.tutorials {page.stem}"
            )
            assert kept.exists(), again
            if name in curves:
                assert same_curves(by_curves[name], curves[name]), again
            elif name not in MEASURED:
                narrow(Path(name)).save("narrow.png", compress_level=1)
                assert same(Path("narrow.png"), kept), again


def _to_read(page: Path) -> list[tuple[int, str]]:
    """(line, command) of blocks that name no language or are indented; synopses left out."""
    found, fenced, named = [], False, False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("```"):
            fenced, named = not fenced, line != "```" and not fenced
            continue
        shown = not named if fenced else line.startswith("    ")
        command = line.strip().split("  ")[0]
        if (
            shown
            and command.startswith("rb_sim ")
            and not set("[|<") & set(command.split("--set")[0])
        ):
            found += [(number, part.strip()) for part in command.split(";")]
    return found


READ = {page: _to_read(page) for page in PAGES}


@pytest.mark.parametrize("page", [page for page in PAGES if READ[page]], ids=name_of)
def test_commands_to_read_are_commands(page):
    """What a block shows without being run has verbs and options that exist."""
    group = get_command(app)
    for number, line in READ[page]:
        program, verb, *arguments = shlex.split(line, comments=True)
        assert program in ("rb_sim", "rerun"), f"line {number}: {line}"
        if program == "rb_sim":
            group.commands[verb].make_context(verb, arguments)  # raises where one does not exist


HOW_TO = sorted((ROOT / "docs" / "how-to").glob("*/*.md"))


@pytest.mark.parametrize("page", HOW_TO, ids=name_of)
def test_a_how_to_answers_one_question_in_short(page):
    lines = page.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# How do I ") and lines[0].endswith("?")
    assert [line for line in lines if line.startswith("## ")] == []
    assert len(lines) <= 60
    index = (ROOT / "docs" / "how-to" / "index.md").read_text(encoding="utf-8")
    assert f"({page.parent.name}/{page.name})" in index


# The numbers of README are those of the program.


README = (ROOT / "README.md").read_text(encoding="utf-8")


def rolling_sphere() -> tuple[float, float]:
    """(closed form, run): F = (1, 0.5, 0) N, K = (0.02, -0.01, 0.03) N m, a = 0.1 m."""
    run = Simulation("rolling_sphere").run(0.1)
    return (5.0 * -0.01 / 0.1 - 2.0 * 1.0) / 7.0, float(run.reaction["floor"].force[-1, 0])


def string_of(name: str, exact: float) -> tuple[float, float]:
    found = solve(load_statics(shipped_statics()[name])).reactions["string"]
    return exact, float(found.along)


def thrown_ball() -> tuple[float, float]:
    run = Simulation("thrown_ball").run()
    speed = np.linalg.norm(run.linear_velocity["ball"], axis=1)
    return 5.0 / 7.0, float(speed[-1] / speed[0])


ROWS = {
    "rolling_sphere": rolling_sphere,
    "rod_over_wall": lambda: string_of("rod_over_wall", 45.984375),
    "hinged_rods": lambda: string_of("hinged_rods", 15.0 * np.tan(np.pi / 6.0)),
    "thrown_ball": thrown_ball,
}


@pytest.mark.parametrize("name", ROWS)
def test_a_row_says_what_closed_form_and_program_give(name):
    (row,) = re.findall(rf"^\|[^|]*{name}[^|]*\|[^|]*\|([^|]*)\|([^|]*)\|$", README, re.MULTILINE)
    said = [float(re.findall(r"-?\d+\.\d+", cell)[-1]) for cell in row]
    assert said == [pytest.approx(value, rel=2e-6) for value in ROWS[name]()]


def test_it_is_one_screen_and_its_pictures_are_there():
    assert len(README.splitlines()) <= 120
    for picture in re.findall(r"\]\((docs/pictures/[^)]+)\)", README):
        assert (ROOT / picture).stat().st_size < 1.5e6


# The notebooks run from the first cell to the last; what they claim they assert.


@pytest.mark.parametrize(
    "path", sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem
)
def test_notebook(path, tmp_path):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    assert any(outputs)
