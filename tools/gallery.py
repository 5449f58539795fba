# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Draws every shipped scene, for docs/gallery.md and docs/ten-scenes.md, as tools/pictures.py asks.

Each scene is run as `rb_sim run` does; the Rerun viewer draws its motion without a window. All of
them together are docs/pictures/gallery.jpg; those of docs/ten-scenes.md are pictures of their own.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from rb_sim import Simulation, load_scene, scenes
from rb_sim.equilibrium.statics import solve
from rb_sim.equilibrium.statics_picture import save_picture
from rb_sim.io.rerun.rerun_sink import RerunSink
from rb_sim.io.rerun.viewer import frames
from rb_sim.mechanics.samples import ARRAYS, SampleBlock
from rb_sim.scene.extent import reach_of
from rb_sim.scene.listing import shipped_statics
from rb_sim.scene.load import load_statics
from rb_sim.scene.schema import Scene
from tools.colors import few_colors

TILE = (480, 320)
COLUMNS = 4
CAPTION = 40
"""Height of the strip above a tile with its name [px]."""
OWN = ("rolling_sphere", "pendulum", "heavy_top", "rolling_disk_steady", "thrown_ball")
"""Scenes of motion that docs/ten-scenes.md shows."""
OWN_SIZE = (480, 320)
AT_REST = ("sphere_held", "rod_over_wall", "rod_two_planes", "hinged_rods")
"""Likewise, of `rb_sim statics`."""
MOMENT = 0.6
"""The time shown, as a fraction of what is drawn of the run."""
MOST_WAY, SHORT_WAY = 40.0, 16.0
"""In reaches of the largest body: where a body covers more than the first, which would make it a
dot, a run is drawn as long as none covers more than the second."""


def drawn(scene: Scene) -> SampleBlock:
    """The samples of a run of the scene that are drawn."""
    block = Simulation(scene).run(check=False).block
    return in_sight(block, max(map(reach_of, scene.bodies.values())))


def places(names: Iterable[str]) -> str:
    """Centres of mass at MOMENT [m] in these scenes, and how long their runs are drawn [s]: JSON.

    A picture of the viewer carries them as its comment, so that a test sees whether the program
    still moves so without the viewer, which draws otherwise on other machines.
    """
    found = {}
    for name in names:
        block = drawn(load_scene(name))
        row = round(MOMENT * (len(block.t) - 1))
        centres = block.position[row].round(6).tolist()
        found[name] = {"until": round(float(block.t[-1]), 6), "centres": centres}
    return json.dumps(found)


def picture_of(scene: Scene, folder: Path) -> Image.Image:
    """A run of the scene, drawn at MOMENT in twice the size of a tile."""
    simulation = Simulation(scene)
    block = drawn(scene)
    recording = folder / f"{scene.name}.rrd"
    sink = RerunSink(recording, motion_only=True)
    sink.open(simulation.scene, simulation.layout)
    sink.write(block)
    sink.close()
    path = folder / f"{scene.name}.png"
    size = (2 * TILE[0], 2 * TILE[1])
    (data,) = frames(recording, [MOMENT], size)
    path.write_bytes(data)
    with Image.open(path) as image:
        return image.convert("RGB").resize(size, Image.Resampling.LANCZOS)


def in_sight(block: SampleBlock, reach: float) -> SampleBlock:
    """The samples of a run in which bodies of this reach [m] can be seen; two at least."""
    gone = np.linalg.norm(block.position - block.position[0], axis=2).max(axis=1)
    if not gone.max() > MOST_WAY * reach:
        return block
    end = max(2, int(np.argmax(gone > SHORT_WAY * reach)))
    part = {name: getattr(block, name)[:end] for name in ARRAYS}
    events = tuple(event for event in block.events if event.t <= block.t[end - 1])
    return replace(block, **part, events=events)


def small(image: Image.Image, size: tuple[int, int], path: Path, comment: str = "") -> None:
    """Write the picture as JPEG with a comment, or as PNG with few colours, as the name ends."""
    smaller = image.resize(size, Image.Resampling.LANCZOS)
    if path.suffix == ".jpg":
        smaller.save(path, quality=85, optimize=True, comment=comment)
        return
    few_colors(smaller).save(path, optimize=True)


def sheet(tiles: dict[str, Image.Image]) -> Image.Image:
    """All tiles with their names."""
    rows = -(-len(tiles) // COLUMNS)
    width, height = TILE
    page = Image.new("RGB", (COLUMNS * width, rows * (height + CAPTION)), (22, 24, 30))
    draw = ImageDraw.Draw(page)
    for k, (name, image) in enumerate(tiles.items()):
        x, y = width * (k % COLUMNS), (height + CAPTION) * (k // COLUMNS)
        page.paste(image.resize((width, height), Image.Resampling.LANCZOS), (x, y + CAPTION))
        draw.text((x + 10, y + 6), name, fill=(230, 230, 230), font_size=26)
    return page


def draw_at_rest(name: str, folder: Path) -> None:
    """Write the picture of `rb_sim statics`."""
    described = load_statics(shipped_statics()[name])
    path = folder / "full.png"
    save_picture(described, solve(described), path)
    with Image.open(path) as image:
        size = (560, 560 * image.height // image.width)
        small(image.convert("RGB"), size, folder / f"scene_{name}.png")


def draw(folder: Path) -> None:
    """Write gallery.jpg and the pictures of OWN into the folder."""
    with tempfile.TemporaryDirectory() as large:
        tiles = {scene.name: picture_of(load_scene(scene.name), Path(large)) for scene in scenes()}
    for name in OWN:
        small(tiles[name], OWN_SIZE, folder / f"scene_{name}.jpg", places([name]))
    page = sheet(tiles)
    size = page.width * 5 // 6, page.height * 5 // 6
    small(page, size, folder / "gallery.jpg", places(tiles))
