# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim fit`: fit of scene parameters to a recorded motion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.bags.fit.fit import Fitted, Recording
from rb_sim.bags.fit.fit import fit as solve
from rb_sim.base.errors import RbSimError
from rb_sim.base.plain_data import json_text, write_json
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.cli.options import FitOptions
from rb_sim.cli.plain import columns, note, plain_console, warn

if TYPE_CHECKING:
    from rb_sim.bags.fit.fit import Recording
    from rb_sim.scene.schema import Scene


# Picture of the residuals of a fit over time, for each body.


def picture(found: Fitted, path: Path) -> None:
    """Write a picture of the residuals of position and attitude, with the estimated noise as a
    band."""
    from matplotlib.figure import Figure

    n = len(found.residuals)
    figure = Figure(figsize=(9, 1 + 4.2 * n), layout="constrained")
    axes = figure.subplots(2 * n, 1, sharex=True)
    start = min(float(t[0]) for t, _, _ in found.residuals.values())
    for k, (body, (t, position, turn)) in enumerate(found.residuals.items()):
        rows = (("position", position, "m"), ("angle", turn, "rad"))
        for axis, (name, values, unit) in zip(axes[2 * k : 2 * k + 2], rows, strict=True):
            for column, label in zip(values.T, "xyz", strict=True):
                axis.plot(t - start, column, ".", markersize=2, label=label)
            band = found.noise[name]
            axis.axhspan(-band, band, color="0.9", zorder=0)
            if max(band, float(abs(values).max(initial=0.0))) < COMPUTED_ROUNDING:
                axis.set_ylim(-COMPUTED_ROUNDING, COMPUTED_ROUNDING)
            axis.set_ylabel(f"{body}: {name} left [{unit}]")
            axis.legend(fontsize=7, loc="upper right")
    axes[-1].set_xlabel("t [s] from the first pose")
    figure.savefig(path, dpi=120)


def fit(options: FitOptions) -> int:
    """Fit, print and write the results; returns 0. Raises RbSimError."""
    if options.noise is not None and not min(options.noise) > 0:
        raise RbSimError(f"--noise: got {options.noise}; must be two numbers > 0 [m, rad]")
    keys = [key.strip() for key in ",".join(options.free).split(",") if key.strip()]
    scene, data, recording = set_up(options)
    found = solve(recording, scene, data, keys, options.noise)
    warn([*found.outliers, *found.lost])
    if options.as_json:
        print(json_text(found.as_dict()))
    else:
        _print(found)
    if options.out is not None:
        _write(options.out, found)
    return 0


def set_up(options: FitOptions) -> tuple[Scene, dict[str, Any], Recording]:
    """(scene to fit, its YAML data, recorded motion). Raises RbSimError."""
    from rb_sim.bags.fit.recording import pairs_of, recorded_by_others
    from rb_sim.bags.resim import inputs_of
    from rb_sim.bags.tracks import tracks_of_bag
    from rb_sim.io.bag.reader import reader_of, scene_as_run
    from rb_sim.scene import yaml_reader
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene

    reader = reader_of(options.bag, unfinished=True)
    if options.scene is not None:
        own = {}
        if reader is not None:
            simulation = reader.scene.simulation
            own = {"duration": simulation.duration, "rate": simulation.rate}
        scene = load_scene(find_scene(options.scene), **own)
    elif reader is not None:
        scene = scene_as_run(reader)
    else:
        raise RbSimError(f"{options.bag}: no scene in it; name one with --scene")
    tracks = tracks_of_bag(options.bag, scene)
    warn(tracks.notes)
    pairs, left_out = pairs_of(tracks, list(scene.bodies), options.match or ())
    warn(left_out)
    if reader is None:
        recording = recorded_by_others(tracks, scene, pairs, options.wrench or ())
        note(recording.notes)
    else:
        refuse_wrench(options.wrench or ())
        recording = Recording(tracks, pairs)
        if tracks.notes == reader.unlisted:
            recording.inputs, recording.count = inputs_of(reader)
            recording.node = reader.settings.get("by") == "node"
        elif any(inputs_of(reader)[0].values()):
            warn(["its commands and resets are not applied, since the bag is damaged"])
    return scene, yaml_reader.parse(scene.text, scene.file), recording


def refuse_wrench(wrench: Sequence[str]) -> None:
    """Raise RbSimError if a wrench topic is given for a bag recorded by rb_sim."""
    if wrench:
        raise RbSimError(
            f"--wrench {wrench[0]}: only for bags not recorded by rb_sim; this one contains its "
            "commands"
        )


def _print(found: Fitted) -> None:
    rows = []
    names = [number.name for number in found.free]
    for k, number in enumerate(found.free):
        others = abs(found.correlation[k]).copy()
        others[k] = -1.0
        j = int(others.argmax())
        most = f"{j + 1}: {found.correlation[k][j]:+.2f}" if len(names) > 1 else ""
        rows.append((str(k + 1), number.name, f"{number.start:.6g}", f"{found.values[k]:.9g}",
                     f"{found.errors[k]:.2g}", most))  # fmt: skip
    heads = ("", "number", "start", "fitted", "std. error", "correlated with")
    plain_console(highlight=False).print(columns(heads, rows, names=("number",)))
    print(f"residuals: {found.noise['position']:.3g} m, {found.noise['angle']:.3g} rad (RMS); "
          f"{found.runs} runs")  # fmt: skip
    if found.correlation_left:
        print(f"residuals are correlated ({found.correlation_left:.2f}): the model does not match "
              "the recording; standard errors are not valid")  # fmt: skip
    for name in found.limited:
        print(f"at the limit of its allowed values: {name}; standard errors are those of a fit "
              "without it")  # fmt: skip
    for names_ in found.undetermined:
        print(f"not determined by the recorded poses: {names_}")


def _write(folder: Path, found: Fitted) -> None:
    from rb_sim.scene import yaml_reader
    from rb_sim.simulation.outputs import writing

    with writing(folder):
        write_json(found.as_dict(), folder / "fit.json")
        (folder / "fitted.yaml").write_text(yaml_reader.write(found.data), encoding="utf-8")
        picture(found, folder / "residuals.png")
    print(
        f"wrote {', '.join(str(folder / n) for n in ('fit.json', 'fitted.yaml', 'residuals.png'))}"
    )
