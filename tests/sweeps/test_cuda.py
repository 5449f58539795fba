"""Runs on a GPU: the kernels' text, compiled as C++ here, gives the numbers of the lanes."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pyarrow")

from rb_sim.base.errors import RbSimError
from rb_sim.mechanics import cuda
from rb_sim.sweeps import sweep
from rb_sim.sweeps.lane_runs import CUDA, LaneRunner
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.sweeps.plan import load_plan
from tests.sweeps.fake_cupy import Cupy
from tests.sweeps.plans import plan
from tests.sweeps.test_lanes import BOX, ROD, TOP, runner

compiler = pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
FIXED = {"method": "rk4", "step": 0.003}  # samples between the grid points
ADAPTIVE = {"method": "dopri853", "tolerance": 1e-6}
CASES = [
    ("heavy_top", TOP, FIXED),
    ("heavy_top", TOP, ADAPTIVE),
    ("pendulum", ROD, ADAPTIVE),
    ("free_tumble", BOX, {"method": "euler", "step": 0.002}),
]


def rows(made: Any, values: Any, device: str) -> dict[int, dict[str, Any]]:
    return LaneRunner(made, device).rows(values)


@compiler
@pytest.mark.parametrize(("scene", "vary", "simulation"), CASES, ids=str)
def test_the_kernels_give_the_numbers_of_the_lanes(
    scene: str, vary: dict[str, Any], simulation: dict[str, Any], tmp_path: Path, monkeypatch: Any
) -> None:
    made, values = runner(scene, vary, duration=0.5, rate=100.0, **simulation)
    lanes = rows(made, values, "cpu")
    cupy = Cupy(tmp_path)
    monkeypatch.setitem(sys.modules, "cupy", cupy)
    together = rows(made, values, CUDA)
    assert cupy.launched == ["carry", "samples"]  # one launch for all
    assert sorted(together) == sorted(lanes) == list(range(len(values)))
    for k, row in lanes.items():
        assert together[k]["steps"] == row["steps"]
        for name in made.expressions:
            assert together[k][name] == pytest.approx(row[name], rel=1e-12, abs=1e-12), name


@compiler
def test_a_run_that_fails_or_does_not_end_is_left_to_go_alone(
    tmp_path: Path, monkeypatch: Any
) -> None:
    vary = {"spin": {"path": "bodies.top.angular_velocity[0]", "list": [1.0, 4e3, 2.0]}}
    description = {"scene": "heavy_top", "vary": vary, "outputs": {"e": "last(energy)"}}
    simulation = {"method": "rk4", "step": 0.01, "duration": 0.5}
    values = [{"spin": x} for x in (1.0, 4e3, 2.0)]
    made = PlanRunner(load_plan({**description, "simulation": simulation}), values[::2])
    monkeypatch.setitem(sys.modules, "cupy", Cupy(tmp_path))
    assert sorted(rows(made, values, CUDA)) == [0, 2]
    monkeypatch.setattr(cuda, "MOST_ATTEMPTS", 40)
    assert not rows(made, values, CUDA)


def test_a_plan_that_no_gpu_takes_and_a_machine_without_one(
    tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.setitem(sys.modules, "cupy", None)
    with pytest.raises(RbSimError, match="^device: got 'cuda'; must be cpu: CuPy is not"):
        sweep(plan(tmp_path), tmp_path / "out", device=CUDA)
    with pytest.raises(RbSimError, match=r"^device: got 'tpu'; must be cpu or cuda$"):
        sweep(plan(tmp_path), tmp_path / "out", device="tpu")
    with pytest.raises(RbSimError, match="with --no-lanes"):
        sweep(plan(tmp_path), tmp_path / "out", device=CUDA, lanes=False)
    monkeypatch.setattr(cuda, "why_not", lambda: None)
    implicit = plan(tmp_path, simulation={"method": "gauss6", "step": 0.01})
    with pytest.raises(RbSimError, match="^device: got 'cuda', which takes one body"):
        sweep(implicit, tmp_path / "out", device=CUDA)
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(cuda.why_not() is not None, reason="no GPU")
@pytest.mark.parametrize("simulation", [FIXED, ADAPTIVE], ids=str)
def test_on_a_gpu(simulation: dict[str, Any]) -> None:
    made, values = runner("heavy_top", TOP, duration=0.5, rate=100.0, **simulation)
    lanes, together = rows(made, values, "cpu"), rows(made, values, CUDA)
    for k, row in lanes.items():
        for name in made.expressions:
            assert together[k][name] == pytest.approx(row[name], rel=1e-10, abs=1e-10), name


@pytest.mark.parametrize("simulation", [FIXED, ADAPTIVE], ids=str)
def test_nvrtc_takes_the_kernels(simulation: dict[str, Any]) -> None:
    """CUDA's own compiler, which needs no GPU."""
    nvrtc = pytest.importorskip("cuda.bindings.nvrtc")
    made, values = runner("heavy_top", TOP, draws=2, duration=0.5, rate=100.0, **simulation)
    lane_runner = LaneRunner(made, CUDA)
    assert lane_runner.possible(values)
    (lanes,) = lane_runner._lanes.values()
    assert isinstance(lanes, cuda.CudaLanes) and lanes.source is not None
    _, program = nvrtc.nvrtcCreateProgram(lanes.source.encode(), b"kernels.cu", 0, [], [])
    options = [option.encode() for option in cuda.OPTIONS]
    (status,) = nvrtc.nvrtcCompileProgram(program, len(options), options)
    _, size = nvrtc.nvrtcGetProgramLogSize(program)
    log = b" " * size
    nvrtc.nvrtcGetProgramLog(program, log)
    assert status == nvrtc.nvrtcResult.NVRTC_SUCCESS, log.decode()
