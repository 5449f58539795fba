# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Whole sweeps on real workers: every run once, right, resumed, and the same however it is cut."""

from __future__ import annotations

import json
import os
import runpy
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import psutil
import pytest
from typer.testing import CliRunner

from rb_sim.base.errors import RbSimError
from rb_sim.catalogue.contact import ContactLaw
from rb_sim.cli.main import app
from rb_sim.contact.event_workspace import KINDS
from rb_sim.scene.load import scene_from_mapping
from rb_sim.sweeps.expressions import EVENT_KINDS
from rb_sim.sweeps.one_run import GIVEN_UP, PlanRunner
from rb_sim.sweeps.plan import LoadedPlan, load_plan, points
from rb_sim.sweeps.sweep import _checked, check_guarded, client, sweep
from tests.sweeps.cluster import PATIENCE, one_more_worker
from tests.sweeps.plans import height, plan

pytest.importorskip("pyarrow")
pytest.importorskip("distributed")


ROOT = Path(__file__).resolve().parents[2]
PLANS = sorted(
    path for path in (ROOT / "config" / "sweeps").glob("*.yaml") if "_scene" not in path.name
)


def columns(result: Any) -> dict[str, np.ndarray]:
    table = result.table()
    return {name: table.column(name).to_numpy(zero_copy_only=False) for name in table.column_names}


def test_a_killed_worker_costs_nothing_but_time(tmp_path: Path, here: str) -> None:
    description = plan(tmp_path, draws=200)
    with one_more_worker(here) as victim:

        def kill(done: int, total: int, failed: int) -> None:
            with suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)

        result = sweep(description, tmp_path / "out", scheduler=here, batch=7, progress=kill)
    found = columns(result)
    assert found["run"].tolist() == list(range(200))
    assert set(found["status"]) == {"ok"}
    assert found["height"] == pytest.approx(height(found["speed"], found["start"]), abs=1e-13)
    # the mean of a linear function of the draws is that function of their means, to the bit of sums
    assert found["height"].mean() == pytest.approx(
        height(found["speed"].mean(), found["start"].mean()), abs=1e-13
    )


OSCILLATOR = """\
bodies:
  mass: {mass: 2.0, inertia: [0.1, 0.1, 0.1]}
effects:
  spring: {type: spring, body: mass, point_A: [0, 0, 0], stiffness: 50.0, rest_length: 0.0}
simulation: {duration: 3.0, rate: 50, method: dopri853, tolerance: 1.0e-12}
"""
BALL = """\
bodies:
  ball: {mass: 1.0, shape: {type: sphere, radius: 0.1}}
constraints:
  floor: {type: contact, body: ball}
effects:
  weight: {type: gravity, acceleration: [0.0, 0.0, -9.81]}
simulation: {duration: 1.5, rate: 10, method: dopri853, tolerance: 1.0e-10}
"""


def test_the_mean_energy_of_linear_oscillators_is_that_of_their_starts(
    tmp_path: Path, here: str
) -> None:
    """E = (m v^2 + k x^2) / 2, <E> = (m 0.2^2 + k 0.03^2) / 2, and half of it is in the spring."""
    (tmp_path / "oscillator.yaml").write_text(OSCILLATOR)
    vary = {
        "x": {"path": "bodies.mass.position[0]", "normal": {"mean": 0.0, "std": 0.03}},
        "v": {"path": "bodies.mass.linear_velocity[0]", "normal": {"mean": 0.0, "std": 0.2}},
    }
    outputs = {"end": "last(energy)", "spread": "max(energy) - min(energy)"}
    outputs["stored"] = "integral(potential_energy) / 3"
    description = {"scene": str(tmp_path / "oscillator.yaml"), "vary": vary, "outputs": outputs}
    description |= {"draws": 400, "seed": 3}
    found = columns(sweep(description, tmp_path / "out", scheduler=here))
    closed = 0.5 * (2.0 * found["v"] ** 2 + 50.0 * found["x"] ** 2)
    assert found["end"] == pytest.approx(closed, rel=1e-10, abs=1e-14)
    assert found["spread"].max() < 1e-11
    expected, error = 0.5 * (2.0 * 0.2**2 + 50.0 * 0.03**2), closed.std() / 20.0
    assert abs(found["end"].mean() - expected) < 4.0 * error
    # over 3 s at 5 rad/s the halves differ by a phase: at most 1 / (2 w T) of E, and the rule's
    assert abs(found["stored"] / closed - 0.5).max() < 1.0 / 30.0 + 0.01


def test_where_balls_land_has_the_moments_of_the_closed_form(tmp_path: Path, here: str) -> None:
    """t = (v + sqrt(v^2 + 2 g h)) / g and x = u t, u apart from t: <x> = <u> <t>."""
    (tmp_path / "ball.yaml").write_text(BALL)
    vary = {
        "u": {"path": "bodies.ball.linear_velocity[0]", "normal": {"mean": 2.0, "std": 0.3}},
        "v": {"path": "bodies.ball.linear_velocity[2]", "uniform": [0.0, 4.0]},
        "h": {"path": "bodies.ball.position[2]", "list": [0.6]},
    }
    t = 'event_time("floor", "impact", 1)'
    outputs = {"t": t, "x": f"u * {t}"}
    description = {"scene": str(tmp_path / "ball.yaml"), "vary": vary, "outputs": outputs}
    description |= {"draws": 100, "sampling": "sobol"}
    found = columns(sweep(description, tmp_path / "out", scheduler=here))
    closed = (found["v"] + np.sqrt(found["v"] ** 2 + 2.0 * 9.81 * (found["h"] - 0.1))) / 9.81
    assert found["t"] == pytest.approx(closed, abs=1e-12)
    assert found["x"].sum() == pytest.approx((found["u"] * closed).sum(), abs=1e-10)
    a, b = 2.0 * 9.81 * 0.5, 4.0  # integral of sqrt(v^2 + a) over 0 .. b
    roots = 0.5 * (b * np.sqrt(b**2 + a) + a * np.log((b + np.sqrt(b**2 + a)) / np.sqrt(a)))
    mean = (0.5 * b + roots / b) / 9.81
    assert found["t"].mean() == pytest.approx(mean, rel=5e-3)
    assert found["x"].mean() == pytest.approx(2.0 * mean, rel=2e-2)


def test_ctrl_c_keeps_what_has_ended_and_the_same_sweep_goes_on(tmp_path: Path, here: str) -> None:
    """Every process of a terminal's command hears Ctrl-C; nobody complains. What two processes of
    its own have begun and one thread goes on with is to the bit what the thread does alone."""
    described = {**plan(tmp_path), "draws": 200}
    (tmp_path / "plan.yaml").write_text(json.dumps(described))
    out = tmp_path / "out"
    command = [sys.executable, "-m", "rb_sim.cli.main", "sweep", str(tmp_path / "plan.yaml")]
    command += ["--out", str(out), "--workers", "2", "--no-lanes", "--batch", "20"]
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, start_new_session=True, **pipes) as process:
        end = time.monotonic() + PATIENCE
        while not list(out.glob("runs/*/*.parquet")) and time.monotonic() < end:
            time.sleep(0.02)
        started = psutil.Process(process.pid).children(recursive=True)
        workers = [one for one in started if "spawn_main" in " ".join(one.cmdline())]
        os.killpg(process.pid, signal.SIGINT)
        stdout, stderr = process.communicate(timeout=PATIENCE)
    assert len(workers) == 2
    assert (process.returncode, stderr) == (130, "interrupted\n")
    assert "interrupted; finished runs are in" in stdout.replace("\n", " ")
    kept = len(pd.read_parquet(out / "runs"))
    assert 20 <= kept < 200 and kept % 20 == 0
    again = CliRunner().invoke(app, [*command[3:], "--scheduler", here])
    assert again.exit_code == 0 and f"{kept} runs were already done" in again.stdout
    table = pd.read_parquet(out / "runs").sort_values("run")
    assert table["run"].tolist() == list(range(200))
    closed = height(table["speed"], table["start"]).to_numpy()
    assert table["height"].to_numpy() == pytest.approx(closed, abs=1e-13)
    whole = columns(sweep(described, tmp_path / "whole", scheduler=here, batch=11))
    for name, column in whole.items():
        assert (table[name].to_numpy() == column).all(), name
    assert sweep(described, out, scheduler=here).reused == 200
    readable_by_everybody(out, whole)


def readable_by_everybody(folder: Path, expected: dict[str, np.ndarray]) -> None:
    """One line each, as docs/sweeps.md says."""
    import duckdb
    import polars as pl
    from dask import dataframe as dd

    runs = folder / "runs"
    total = expected["height"].sum()
    assert pd.read_parquet(runs)["height"].sum() == pytest.approx(total)
    assert pl.scan_parquet(runs / "**/*.parquet").collect()["height"].sum() == pytest.approx(total)
    query = f"select sum(height) from read_parquet('{runs}/*/*.parquet')"
    assert duckdb.sql(query).fetchall()[0][0] == pytest.approx(total)
    assert dd.read_parquet(runs)["height"].sum().compute() == pytest.approx(total)


def test_units_plan_and_scene_are_in_the_schema(tmp_path: Path, here: str) -> None:
    description = plan(tmp_path, draws=3, final_state=True, trajectories=1)
    result = sweep(description, tmp_path / "out", scheduler=here)
    table = result.table()
    assert table.schema.field("height").metadata[b"unit"] == b"m"
    assert table.schema.field("linear_velocity.stone.z").metadata[b"unit"] == b"m/s"
    again = LoadedPlan.from_dict(json.loads(table.schema.metadata[b"plan"]))
    assert again.plan.vary.keys() == description["vary"].keys()
    assert "stone" in again.scene["bodies"]
    kept = pd.read_parquet(tmp_path / "out" / "trajectories")
    assert kept["position.stone.z"].iloc[-1] == table.column("height")[0].as_py()


def test_the_order_of_what_varies_survives_the_way_to_a_worker(tmp_path: Path) -> None:
    """It says which Sobol index belongs to which name."""
    loaded = load_plan(plan(tmp_path))
    assert list(loaded.plan.vary) == ["speed", "start"]
    swapped = {"vary": dict(reversed(list(plan(tmp_path)["vary"].items())))}
    other = load_plan(plan(tmp_path, **swapped))
    assert list(LoadedPlan.from_dict(other.as_dict()).plan.vary) == ["start", "speed"]


@pytest.mark.parametrize("name", [path.stem for path in PLANS])
def test_the_scene_of_a_run_is_the_one_that_a_check_of_all_of_it_gives(name: str) -> None:
    """What no value touches is not checked again; the rest is."""
    loaded = load_plan(ROOT / "config" / "sweeps" / f"{name}.yaml")
    runner = PlanRunner(loaded)
    several = points(loaded.plan)
    for row in (0, -1):
        values = {key: float(column[row]) for key, column in several.items()}
        whole = scene_from_mapping(runner.mapping(values), **loaded.plan.simulation)
        scene = runner.scene(values)
        assert scene.model_dump(warnings=False) == whole.model_dump(warnings=False)
        assert scene.text == whole.text


def test_a_run_that_fails_is_a_row_with_its_reason(tmp_path: Path) -> None:
    vary = {"mass": {"path": "bodies.stone.mass", "list": [-1.0, 1.0]}}
    description = {k: v for k, v in plan(tmp_path, vary=vary).items() if k != "draws"}
    runner = PlanRunner(load_plan(description))
    row, run = runner.run({"mass": -1.0})
    assert row["status"] == "failed" and run is None
    assert "bodies.stone.mass: got -1.0; must be a number > 0" in row["reason"]
    assert np.isnan(row["height"])
    assert runner.run({"mass": 1.0})[0]["status"] == "ok"
    assert _checked(runner, {"mass": np.array([-1.0, 1.0])}).scene.bodies["stone"].mass == 1.0
    with pytest.raises(RbSimError, match="got -1.0"):  # none of them can start
        _checked(runner, {"mass": np.array([-1.0, -2.0])})


def test_a_run_that_takes_too_long_is_given_up_and_says_so(tmp_path: Path) -> None:
    slow = plan(tmp_path, seconds_per_run=1e-9, simulation={"duration": 1e4, "rate": 1.0})
    row, _ = PlanRunner(load_plan(slow)).run({"speed": 1.0, "start": 0.0})
    assert row["status"] == GIVEN_UP and "1e-09 s" in row["reason"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bodies": {}}, "is a scene; a plan names one"),
        ({"outputs": {"z": "position.stone.z"}}, "outputs.z: gives a list, as over the samples"),
        ({"vary": {}}, "vary: got {}; must be a list or a mapping of at least 1 entries"),
        ({"outputs": {"z": "max(position.stein.z)"}}, "must be stone"),
        ({"outputs": {"z": "max(energy.x)"}}, "'x' must be omitted: it is a number"),
        ({"outputs": {"z": "max(position.stone[2])"}}, "components are .x, .y, .z"),
        ({"derived": {"bodies.stone.position[0]": "sped"}}, "must be speed"),
        ({"vary": {"m": {"path": "bodies.stone.mas", "list": [1.0]}}}, "must be mass"),
        ({"vary": {"t": {"path": "bodies.stone.mass", "list": [1.0]}}}, "another name"),
        ({"vary": {"run": {"path": "bodies.stone.mass", "list": [1.0]}}}, "another name"),
        ({"vary": {"pi": {"path": "bodies.stone.mass", "list": [1.0]}}}, "another name"),
        ({"vary": {"m": {"list": [1.0]}}}, "vary.m.path: is missing; must be given"),
        ({"vary": {"m": {"path": "bodies", "list": [1.0]}}}, "bodies: got 1.0; must be a mapping"),
        ({"vary": {"m": {"path": ["bodies.stone.mass"] * 2, "list": [1.0]}}}, "nothing else sets"),
        ({"derived": {"bodies.stone.position": "[0, 0, speed]"}}, "nothing else sets"),
        (
            {"derived": {"bodies.stone.mass": "'heavy'"}},
            "derived.bodies.stone.mass: gives no number",
        ),
        (
            {"derived": {"simulation.duration": "speed"}, "simulation": {"duration": 1.0}},
            "'simulation: {duration: ...}' sets it, too",
        ),
        ({"outputs": {"n": "event_count('floor', 'impact')"}}, "'floor'; the scene has none"),
    ],
)
def test_what_is_wrong_with_every_run_is_said_before_the_first(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    description = plan(tmp_path, **changes)
    if "vary" in changes:
        del description["draws"]
    with pytest.raises(RbSimError) as caught:
        sweep(description, tmp_path / "out", workers=1)
    assert message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ("event_time('floor', 'imapct')", "must be impact"),
        ("event_count('flor', 'impact')", "must be floor"),
        ("event_time('floor', 'impact', 0)", "whole number >= 1"),
        ("event_time('floor', 'impact', 1.5)", "whole number >= 1"),
        ("time_of(position.ball > 1)", "vectors"),
        ("integral(position.ball)", "vectors"),
    ],
)
def test_what_no_run_can_have_is_not_taken_for_what_this_one_has_not(
    tmp_path: Path, call: str, message: str
) -> None:
    (tmp_path / "ball.yaml").write_text(BALL)
    vary = {"h": {"path": "bodies.ball.position[2]", "list": [0.6]}}
    with pytest.raises(RbSimError, match=message):
        sweep(
            {"scene": str(tmp_path / "ball.yaml"), "vary": vary, "outputs": {"x": call}},
            tmp_path / "out",
        )


def test_every_kind_of_event_can_be_asked_for() -> None:
    words = set(KINDS)
    words |= {ContactLaw._field_defaults[name] for name in ("closes", "opens")}
    assert words <= set(EVENT_KINDS)


def test_what_goes_wrong_on_a_cluster_is_not_the_schedulers_silence(here: str) -> None:
    with pytest.raises(OSError, match="^disk$"), client(None, here):
        raise OSError("disk")


def test_no_scheduler_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RbSimError, match="scheduler: .* does not answer"):
        sweep(plan(tmp_path), tmp_path / "out", scheduler="nonsense://nowhere")


# A script that workers would run again is refused before one starts; others are not.


CALL = "from rb_sim.sweeps.sweep import check_guarded\n"


def run(script: Path, text: str) -> None:
    """As `python script` does, in this process."""
    script.write_text(text)
    runpy.run_path(str(script), run_name="__main__")


@pytest.mark.parametrize(
    "text",
    [
        "check_guarded()\n",
        "def main():\n    check_guarded()\n\nmain()\n",
        "if __name__ == '__main__':\n    pass\ncheck_guarded()\n",
        "if True:\n    check_guarded()\n",
    ],
)
def test_a_call_that_workers_would_come_to_is_refused(tmp_path: Path, text: str) -> None:
    line = 2 + text.rstrip().count("\n")
    with pytest.raises(RbSimError, match=rf"script.py:{line}: .*must be below `if __name__ =="):
        run(tmp_path / "script.py", CALL + text)


@pytest.mark.parametrize(
    "text",
    [
        "if __name__ == '__main__':\n    check_guarded()\n",
        "def main():\n    check_guarded()\n\nif '__main__' == __name__:\n    main()\n",
    ],
)
def test_a_guarded_call_goes_on(tmp_path: Path, text: str) -> None:
    run(tmp_path / "script.py", CALL + text)


def test_a_sweep_asks_before_it_makes_anything(tmp_path: Path) -> None:
    out = tmp_path / "out"
    text = f"import rb_sim\nrb_sim.sweep('rotor_imbalance', {str(out)!r}, workers=1)\n"
    with pytest.raises(RbSimError, match="starts workers, which import this file"):
        run(tmp_path / "script.py", text)
    assert not out.exists()


def test_what_is_typed_in_is_imported_by_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    typed = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", typed)
    exec("check_guarded()", vars(typed) | {"check_guarded": check_guarded})
