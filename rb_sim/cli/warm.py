"""`rb_sim warm`: compile ahead, so that a first start is as quick as a second one."""

from __future__ import annotations

import sys
import time

from rb_sim.errors import RbSimError


def warm(names: list[str], method: str | None = None) -> int:
    """Compile the scenes given (files or names), or all shipped ones, into the cache.

    method: instead of the scenes' own. A scene that does not load is said and the others go on;
    returns 1 then. Raises RbSimError if a scene given does not exist.
    """
    from rb_sim.cli.compiling import compiled
    from rb_sim.cli.scenes import find_moving
    from rb_sim.scene.listing import list_scenes
    from rb_sim.scene.load import load_scene

    paths = [find_moving(name) for name in names] or [scene.path for scene in list_scenes()]
    if not paths:
        raise RbSimError("the installation has no scenes; name one: rb_sim warm SCENE")
    failed = False
    for i, path in enumerate(paths, start=1):
        notes: list[str] = []
        began = time.perf_counter()
        place = f"[{i}/{len(paths)}] {path.stem}"
        print(f"{place} ...", end="", flush=True)
        try:
            compiled(load_scene(path, method=method), notes.append)
        except RbSimError as error:
            failed = True
            print(flush=True)
            print(f"error: {error}", file=sys.stderr, flush=True)
            continue
        took = time.perf_counter() - began
        print(f" {'compiled' if notes else 'from the cache'}, {took:.1f} s", flush=True)
        for note in notes[1:]:
            print(note, file=sys.stderr, flush=True)
    return 1 if failed else 0
