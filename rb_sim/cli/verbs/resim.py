# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim resim`: simulate a recorded run again, unchanged or with changes."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import RbSimError, lines_of
from rb_sim.base.plain_data import json_text
from rb_sim.cli.options import CompareOptions, ResimOptions
from rb_sim.cli.plain import warn

if TYPE_CHECKING:
    from rb_sim.bags.resim import Identity
    from rb_sim.io.bag.reader import BagReader

DIFFERENT = 1
"""Exit code if an unchanged run gives other samples."""


def resim(options: ResimOptions) -> int:
    """Simulate a recorded run again; returns 0, or DIFFERENT if an unchanged run gives other
    samples.

    Raises RbSimError.
    """
    from rb_sim.io.bag.reader import BagReader

    reader = BagReader(options.bag, unfinished=True)
    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        out = options.out / "bag" if options.out else Path(folder) / "bag"
        _simulate(reader, options, out)
        if options.what_if:
            from rb_sim.cli.verbs.compare import compare

            return compare(
                CompareOptions(options.bag, str(out), options.out, as_json=options.as_json)
            )
        code = _say_identity(reader, BagReader(out), options.as_json)
    warn(reader.left_out)
    return code


def _simulate(reader: BagReader, options: ResimOptions, out: Path) -> None:
    from rb_sim.bags.resim import resimulate
    from rb_sim.cli.verbs.scenes import with_changes
    from rb_sim.io.bag.reader import scene_as_run
    from rb_sim.scene.load import load_scene
    from rb_sim.simulation.outputs import refuse_logs

    overrides = {name: getattr(options, name) for name in ("method", "step", "tolerance")}
    if options.scene is None:
        scene = scene_as_run(reader, options.change or (), overrides)
    else:
        own = reader.scene.simulation
        overrides |= {"duration": own.duration, "rate": own.rate}
        scene = with_changes(options.scene, options.change or (), load_scene, **overrides)
    if options.out is not None and (out / "metadata.yaml").exists():
        if out.resolve() == reader.path.parent.resolve():
            raise RbSimError(f"--out {options.out}: contains the bag to be simulated again")
    if options.out is not None and not options.overwrite:
        refuse_logs(options.out, "--out", "or use --overwrite")
    warn(lines_of(resimulate(reader, scene, out)))


def _say_identity(recorded: BagReader, again: BagReader, as_json: bool) -> int:
    from rb_sim.bags.resim import identity

    found = identity(recorded, again)
    if as_json:
        print(json_text(found.as_dict()))
    else:
        print("\n".join(identity_lines(found, _other(recorded))))
    return 0 if found.same or (recorded.damage and found.identical == found.samples) else DIFFERENT


def identity_lines(found: Identity, other: dict[str, Any]) -> list[str]:
    """Lines on the result of the comparison. other: versions and host that have changed."""
    lines = [f"{found.identical} of {found.samples} samples are identical"]
    names = ("only recorded", "only simulated again")
    lines += [f"{n} samples {name}" for n, name in zip(found.only_in, names, strict=True) if n]
    lines.append(f"sha256 recorded  {found.sha256[0]}")
    lines.append(f"sha256 simulated {found.sha256[1]}")
    if found.first is not None:
        first = found.first
        lines.append(
            f"first difference: sample {first.number}, t = {first.t:.9g} s, {first.topic}, by "
            f"{first.size:.3g}"
        )
        worst = sorted(found.largest.items(), key=lambda entry: -entry[1])[:8]
        lines += [f"  largest in {name}: {size:.3g}" for name, size in worst]
        lines += [f"  other now: {name} {was} -> {now}" for name, (was, now) in other.items()]
    return lines


def _other(reader: BagReader) -> dict[str, tuple[str, str]]:
    from rb_sim.io.bag.bag_sink import host, versions

    pairs = {}
    for key, now in (("versions", versions()), ("host", host())):
        was = json.loads(reader.record.get(key, "{}"))
        pairs |= {
            name: (was[name], now.get(name, "absent")) for name in was if was[name] != now.get(name)
        }
    return pairs
