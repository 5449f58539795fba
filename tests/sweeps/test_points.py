# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The values of a plan: quantiles, correlations, grids, and the same on every call."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.scene.yaml_reader import validated
from rb_sim.sweeps.plan import Plan, load_plan, points

A = {"path": "a", "normal": {"mean": 5.0, "std": 2.0}}
B = {"path": "b", "log_uniform": [0.1, 10.0]}
GRID = {"path": "g", "grid": {"from": 1.0, "to": 100.0, "count": 3, "spacing": "log"}}
LIST = {"path": "l", "list": [7.0, 8.0]}


def made(vary: dict, **more: object) -> Plan:
    data = {"scene": "s", "outputs": {"o": "1"}, "vary": vary, **more}
    return validated(Plan, data, "plan.yaml")


@pytest.mark.parametrize("sampling", ["random", "sobol", "latin_hypercube", "saltelli"])
def test_draws_follow_their_distributions(sampling: str) -> None:
    plan = made({"a": A, "b": B}, draws=1024, sampling=sampling, seed=3)
    table = points(plan)
    assert {len(v) for v in table.values()} == {plan.runs}
    # Kolmogorov-Smirnov; Saltelli repeats its points, so its own base sample is looked at
    step = 4 if sampling == "saltelli" else 1
    assert stats.kstest(table["a"][::step], stats.norm(5.0, 2.0).cdf).statistic < 0.05
    assert stats.kstest(table["b"][::step], stats.loguniform(0.1, 10.0).cdf).statistic < 0.05
    again = points(plan)
    assert all((table[k] == again[k]).all() for k in table)


def test_correlated_normals_have_their_covariance() -> None:
    other = {"path": "c", "normal": {"mean": 0.0, "std": 3.0}}
    pair = [{"between": ["a", "c"], "coefficient": -0.8}]
    table = points(made({"a": A, "c": other}, draws=4096, sampling="sobol", correlations=pair))
    covariance = np.cov(table["a"], table["c"])
    assert covariance == pytest.approx(np.array([[4.0, -4.8], [-4.8, 9.0]]), rel=0.02)


def test_correlations_that_contradict_each_other_are_refused() -> None:
    names = {"a": A, "b": A, "c": A}
    pairs = [("a", "b", 0.9), ("b", "c", 0.9), ("a", "c", -0.9)]
    reported = [{"between": [x, y], "coefficient": r} for x, y, r in pairs]
    with pytest.raises(RbSimError, match="correlations"):
        points(made(names, draws=8, correlations=reported))


def test_grids_and_lists_give_every_combination_with_the_same_draws() -> None:
    plan = made({"g": GRID, "a": A, "l": LIST}, draws=4)
    table = points(plan)
    assert plan.runs == 24
    combinations = set(zip(table["g"].round(9), table["l"], strict=True))
    assert combinations == {(g, x) for g in (1.0, 10.0, 100.0) for x in (7.0, 8.0)}
    assert (table["a"].reshape(6, 4) == table["a"][:4]).all()


def test_more_draws_keep_the_first_ones() -> None:
    few, more = (points(made({"a": A}, draws=n, sampling="sobol"))["a"] for n in (8, 32))
    assert (more[:8] == few).all()


def test_a_number_that_derived_converts_may_have_any_unit() -> None:
    turned = {"list": [30.0, 60.0], "unit": "deg"}
    loaded = made({"a": turned}, derived={"bodies.rod.orientation.angle": "a * pi / 180"})
    assert points(loaded)["a"].tolist() == [30.0, 60.0]
    assert made({"a": {**A, "unit": "kg m^2/s"}}, draws=2).vary["a"].unit == "kg m^2/s"


def between(*names: str) -> dict:
    """Correlations of these pairs."""
    pairs = zip(names[::2], names[1::2], strict=True)
    return {"correlations": [{"between": list(pair), "coefficient": 0.5} for pair in pairs]}


@pytest.mark.parametrize(
    ("vary", "more", "message"),
    [
        ({"a": {"path": "a"}}, {}, "exactly one of grid"),
        ({"a": {**A, "list": [1.0]}}, {"draws": 2}, "exactly one of grid"),
        ({"a": A}, {}, "draws: is missing; must be given"),
        ({"l": LIST}, {"draws": 2}, "omitted"),
        ({"a": A}, {"draws": 0}, ">= 1"),
        ({"a": {"path": "a", "uniform": [2.0, 1.0]}}, {"draws": 2}, "low < high"),
        ({"a": {"path": "a", "log_uniform": [0.0, 1.0]}}, {"draws": 2}, "> 0"),
        ({"a": A}, {"draws": 2, "sampling": "halton"}, "one of"),
        ({"a": A}, {"draws": 2, "simulation": {"speed": 1}}, "one of duration"),
        ({"a": A}, {"draws": 2, "outputs": {"a": "1"}}, "not taken"),
        ({"a": A}, {"draws": 2, "outputs": {}}, "final_state"),
        ({"a": {**A, "path": []}}, {"draws": 2}, "at least 1"),
        ({"a": {"path": "a", "grid": {"from": 0.0, "to": 1.0, "count": 1}}}, {}, ">= 2"),
        ({"l": LIST}, {"sampling": "sobol"}, "omitted"),
        ({"a": {**A, "unit": "deg"}}, {"draws": 2}, "got 'deg'; must be in SI"),
        ({"a": {**A, "unit": "mm/s^2"}}, {"draws": 2}, "got 'mm/s^2'; must be in SI"),
        ({"a": A, "b": A}, {"draws": 2, **between("a", "a")}, "two names"),
        ({"a": A, "b": A}, {"draws": 2, **between("a", "b", "b", "a")}, "each pair once"),
        ({"a": A, "b": A}, {"draws": 2, "sampling": "saltelli", **between("a", "b")}, "Sobol"),
    ],
)
def test_a_plan_that_says_nothing_sensible_is_refused(vary: dict, more: dict, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        made(vary, **more)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_is_no_plan(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="is a folder; a plan must be a YAML file") as caught:
        load_plan(tmp_path)
    assert "\n" not in str(caught.value)
