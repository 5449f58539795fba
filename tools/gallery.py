"""Draws every shipped scene, for docs/gallery.md and docs/ten-scenes.md, and to look at.

    python -m tools.gallery [--keep FOLDER] [SCENE ...]

Each scene is run as `rb_sim run` does; the Rerun viewer draws its motion without a window. All of
them together are docs/pictures/gallery.jpg; those of docs/ten-scenes.md are pictures of their own.
--keep: leave plots and pictures in full size there, and do not draw again what is there.
With scenes named, only these are drawn, into FOLDER.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from rb_sim import Simulation, load_scene, scenes
from rb_sim.io.extent import reach_of
from rb_sim.io.rerun.sink import RerunSink
from rb_sim.io.rerun.viewer import frames
from rb_sim.mechanics.samples import ARRAYS, SampleBlock
from rb_sim.scene.listing import shipped_statics
from rb_sim.statics import load_statics, solve
from rb_sim.statics.picture import save_picture

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
TILE = (480, 320)
COLUMNS = 4
COLORS = 128
"""Of a picture; the shades of few colours need no more."""
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


def picture_of(scene, folder: Path, plots: Path | None = None) -> Image.Image:
    """A run of the scene, drawn at MOMENT in twice the size of a tile."""
    simulation = Simulation(scene)
    run = simulation.run()
    block = in_sight(run.block, max(map(reach_of, scene.bodies.values())))
    recording = folder / f"{scene.name}.rrd"
    sink = RerunSink(recording, motion_only=True)
    sink.open(simulation.scene, simulation.layout)
    sink.write(block)
    sink.close()
    if plots is not None:
        run.plot(plots / f"{scene.name}_plots.png")
    drawn = folder / f"{scene.name}.png"
    size = (2 * TILE[0], 2 * TILE[1])
    (data,) = frames(recording, [MOMENT], size)
    drawn.write_bytes(data)
    with Image.open(drawn) as image:
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


def small(image: Image.Image, size: tuple[int, int], path: Path) -> None:
    """Write the picture as JPEG, or as PNG with few colours, as the name ends."""
    smaller = image.resize(size, Image.Resampling.LANCZOS)
    if path.suffix == ".jpg":
        smaller.save(path, quality=85, optimize=True)
        return
    method = Image.Quantize.MEDIANCUT
    smaller.quantize(COLORS, method=method, dither=Image.Dither.NONE).save(path, optimize=True)


def sheet(tiles: dict[str, Image.Image]) -> Image.Image:
    """All tiles with their names."""
    rows = -(-len(tiles) // COLUMNS)
    width, height = TILE
    page = Image.new("RGB", (COLUMNS * width, rows * (height + 24)), (22, 24, 30))
    draw = ImageDraw.Draw(page)
    for k, (name, image) in enumerate(tiles.items()):
        x, y = width * (k % COLUMNS), (height + 24) * (k // COLUMNS)
        page.paste(image.resize((width, height), Image.Resampling.LANCZOS), (x, y + 24))
        draw.text((x + 8, y + 6), name, fill=(230, 230, 230))
    return page


def at_rest(name: str, folder: Path) -> Image.Image:
    """The picture of `rb_sim statics`."""
    described = load_statics(shipped_statics()[name])
    path = folder / f"{name}.png"
    save_picture(described, solve(described), path)
    with Image.open(path) as image:
        return image.convert("RGB")


def drawn(name: str, keep: Path | None, folder: Path) -> Image.Image:
    """The picture of a scene, from `keep` if it is there."""
    if keep is not None and (keep / f"{name}.png").exists():
        with Image.open(keep / f"{name}.png") as image:
            return image.convert("RGB")
    image = picture_of(load_scene(name), folder, keep)
    print(name, flush=True)
    if keep is not None:
        image.save(keep / f"{name}.png")
    return image


def main(arguments: list[str]) -> int:
    """Draw; returns 0."""
    keep = None
    if arguments[:1] == ["--keep"]:
        keep, arguments = Path(arguments[1]), arguments[2:]
        keep.mkdir(parents=True, exist_ok=True)
    names = arguments or [scene.name for scene in scenes()]
    with tempfile.TemporaryDirectory() as folder:
        tiles = {name: drawn(name, keep, Path(folder)) for name in names}
        if arguments:
            return 0
        for name in AT_REST:
            image = at_rest(name, Path(folder))
            small(image, (560, 560 * image.height // image.width), PICTURES / f"scene_{name}.png")
    for name in OWN:
        small(tiles[name], OWN_SIZE, PICTURES / f"scene_{name}.jpg")
    page = sheet(tiles)
    small(page, (page.width * 5 // 6, page.height * 5 // 6), PICTURES / "gallery.jpg")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
