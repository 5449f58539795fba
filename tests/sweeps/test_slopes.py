# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Derivatives of outputs: every function of expressions, closed forms, high-order differences."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyarrow")

from rb_sim.sweeps import expressions
from rb_sim.sweeps.expressions import Expression
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.sweeps.plan import load_plan
from rb_sim.sweeps.slopes import change_of, slopes
from tests.sweeps.plans import plan

T = np.linspace(0.0, 1.0, 12)
TEXTS = [
    "max(a.x) - min(a.y) * 3",
    "mean(a.x) + std(a.y) / k",
    "rms(norm(a))",
    "last(sin(a.x) * cos(a.y)) - first(tan(a.z))",
    "sum(abs(a.x)) + integral(a.z ** 2)",
    "max(norm([a.x, k, a.y]))",
    "last(exp(-a.x) / sqrt(a.y)) ** k",
    "mean(where(a.x > 1, a.x, log(a.y)))",
    "atan2(last(a.y), k) + asin(first(a.z) / 9) + acos(first(a.z) / 9)",
    "max(a.x) % 0.3 + sign(k)",
    "last(a).y * 2 + any(a.x > 0)",
]


def test_every_function_has_a_case() -> None:
    text = " ".join(TEXTS)
    absent = [name for name in expressions.FUNCTIONS if f"{name}(" not in text]
    assert absent == ["all"]  # as any


@pytest.mark.parametrize("text", TEXTS)
def test_the_derivative_of_expressions(text: str) -> None:
    """Against central differences of order four of the expression itself."""
    random = np.random.default_rng(7)
    a, da = random.uniform(0.5, 2.0, (12, 3)), random.normal(size=(12, 3))
    k, dk = 1.3, 0.4
    expression, run = Expression(text, "x"), SimpleNamespace(t=T)
    found = change_of(expression, {"a": a, "k": k}, {"a": da, "k": dk}, run, 1e-6)  # type: ignore[arg-type]

    def plain(s: float) -> float:
        own = {"integral": lambda x: np.sum(0.5 * (x[1:] + x[:-1]) * np.diff(T))}
        return float(expression.value({"a": a + s * da, "k": k + s * dk}, own))

    h = 1e-3
    near, far = plain(h) - plain(-h), plain(2 * h) - plain(-2 * h)
    assert found == pytest.approx((8 * near - far) / (12 * h), rel=1e-7, abs=1e-9)


def test_a_thrown_body_by_its_closed_form(tmp_path: Path) -> None:
    """height = start + speed t - g t^2 / 2 at t = 1/2; the top is the sample at 0.3 s."""
    runner = PlanRunner(load_plan(plan(tmp_path)))
    spread = {"speed": 0.5, "start": 0.3}
    found = slopes(runner, {"speed": 3.0, "start": 0.2}, spread)
    assert not found.why
    assert found.by_output["height"]["speed"].exact == pytest.approx(0.5, abs=1e-12)
    assert found.by_output["height"]["start"].exact == pytest.approx(1.0, abs=1e-12)
    assert found.by_output["top"]["speed"].exact == pytest.approx(0.3, abs=1e-12)
    for by_name in found.by_output.values():
        for slope in by_name.values():
            assert slope.difference == pytest.approx(slope.exact, abs=1e-8)


def test_a_median_at_an_end_of_what_is_allowed_has_no_slope_and_says_why(tmp_path: Path) -> None:
    """No body has Izz > Ixx + Iyy."""
    vary = {
        "flat": {"path": "bodies.stone.inertia[2]", "list": [0.1, 0.2, 0.2]},
        "speed": {"path": "bodies.stone.linear_velocity[2]", "list": [2.0, 3.0, 4.0]},
    }
    description = plan(tmp_path, vary=vary, outputs={"end": "last(position.stone.z)"})
    del description["draws"]
    point, spread = {"flat": 0.2, "speed": 3.0}, {"flat": 0.1, "speed": 1.0}
    found = slopes(PlanRunner(load_plan(description)), point, spread)
    assert found.why.startswith("flat: ") and "inertia" in found.why
    assert np.isnan(found.by_output["end"]["flat"].exact)
    assert found.by_output["end"]["flat"].texts()[0] == "not known"
    assert found.by_output["end"]["speed"].exact == pytest.approx(0.5, abs=1e-12)


def test_a_number_from_which_the_duration_follows_has_differences_only(tmp_path: Path) -> None:
    """Caught after speed / g: d(height) / d(speed) is speed / g, not the time that it flies."""
    derived = {"simulation.duration": "speed / 9.81"}
    runner = PlanRunner(load_plan(plan(tmp_path, derived=derived)))
    found = slopes(runner, {"speed": 3.0, "start": 0.2}, {"speed": 0.5, "start": 0.3})
    by_name = found.by_output["height"]
    assert np.isnan(by_name["speed"].exact)
    assert by_name["speed"].difference == pytest.approx(3.0 / 9.81, abs=1e-8)
    assert by_name["start"].exact == pytest.approx(1.0, abs=1e-12)
    assert found.why == "speed: simulation.duration follows from it"


def test_loads_of_a_top_by_high_order_differences() -> None:
    description: dict[str, Any] = {
        "scene": "heavy_top",
        "simulation": {"duration": 0.2, "rate": 50.0, "method": "rk4", "step": 1e-3},
        "vary": {
            "mass": {"path": "bodies.top.mass", "list": [15.0]},
            "spin": {"path": "bodies.top.angular_velocity[1]", "list": [150.0]},
            "drop": {"path": "bodies.top.center_of_mass[1]", "list": [1.0]},
        },
        "outputs": {
            "load": "max(norm(reaction.tip.force))",
            "height": "last(position.top.z)",
            "energy": "rms(kinetic_energy) / spin",
        },
    }
    runner = PlanRunner(load_plan(description))
    point = {"mass": 15.0, "spin": 150.0, "drop": 1.0}
    found = slopes(runner, point, {"mass": 1.0, "spin": 5.0, "drop": 0.05})
    assert not found.why
    for name, h in (("mass", 0.05), ("spin", 0.1), ("drop", 1e-3)):
        rows = {j: runner.run({**point, name: point[name] + j * h})[0] for j in range(-3, 4)}
        for output in description["outputs"]:
            by_three = [rows[j][output] - rows[-j][output] for j in (1, 2, 3)]
            expected = (45 * by_three[0] - 9 * by_three[1] + by_three[2]) / (60 * h)
            exact = found.by_output[output][name].exact
            assert exact == pytest.approx(expected, rel=3e-8, abs=3e-8), (output, name)


def test_the_instant_of_a_sample_has_no_derivative(tmp_path: Path) -> None:
    """The instant of a sample has none; the other outputs keep theirs."""
    outputs = {"when": "time_of(position.stone.z > 0.3)", "height": "last(position.stone.z)"}
    found = slopes(
        PlanRunner(load_plan(plan(tmp_path, outputs=outputs))),
        {"speed": 3.0, "start": 0.2},
        {"speed": 0.5},
    )
    assert np.isnan(found.by_output["when"]["speed"].exact)
    assert found.by_output["height"]["speed"].exact == pytest.approx(0.5)
