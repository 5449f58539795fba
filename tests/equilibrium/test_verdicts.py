# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What gives, in words and as findings; thresholds to either side of the stated band."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SceneError
from rb_sim.equilibrium.statics import solve
from rb_sim.scene.load import load_statics
from tests.equilibrium.scenes import UP, block, ladder, table

LEGS = [(0.8, 0.5, 0.0), (-0.8, 0.5, 0.0), (-0.8, -0.5, 0.0), (0.8, -0.5, 0.0)]
SMOOTH_LIMIT = math.atan(1.0 / (2.0 * 0.3))
ROUGH_LIMIT = math.atan((1.0 - 0.4 * 0.25) / (2.0 * 0.4))


def answer(scene):
    return solve(load_statics(scene))


@pytest.mark.parametrize(
    "scene, limit, held",
    [
        (lambda x: ladder(x, 0.3, "smooth"), SMOOTH_LIMIT, +1.0),
        (lambda x: ladder(x, 0.4, 0.25), ROUGH_LIMIT, +1.0),
        (lambda x: block(x, 0.5), math.atan(0.5), -1.0),
        (lambda x: block(0.4, x), math.tan(0.4), +1.0),
        (lambda x: table(LEGS, (0.0, 0.0, -400.0), (x, 0.1, 0.0)), 0.8, -1.0),
        (lambda x: table(LEGS, (x, 0.0, -400.0), (0.0, 0.0, 0.0), 0.3), 120.0, -1.0),
    ],
    ids=["ladder", "rubbing ladder", "slope", "friction", "tipping table", "pushed table"],
)
def test_threshold(scene, limit, held):
    """`held` is the side on which the scene holds."""
    step = 1e-9 * max(1.0, limit)
    assert answer(scene(limit + held * step)).verdict in ("equilibrium", "indeterminate")
    assert answer(scene(limit - held * step)).verdict == "no equilibrium"
    for inside in (0.0, 0.01 * step, -0.01 * step):
        result = answer(scene(limit + inside))
        assert result.verdict == "at the limit"
        assert result.reactions and result.findings


def test_band_is_what_the_caller_says():
    scene = load_statics(block(math.atan(0.5) + 1e-9, 0.5))
    assert solve(scene).verdict == "no equilibrium"
    assert solve(scene, tolerance=1e-7).verdict == "at the limit"


def test_foot_slips():
    result = answer(ladder(0.9, 0.3, "smooth"))
    assert result.verdict == "no equilibrium" and not result.reactions
    (finding,) = result.findings
    assert (finding.kind, finding.name) == ("slips", "floor")
    assert finding.amount == pytest.approx(0.5 / math.tan(0.9), rel=1e-12)
    assert "contact 'floor' slips" in result.explanation


def test_table_tips():
    result = answer(table(LEGS, (0.0, 0.0, -400.0), (0.9, 0.1, 0.0)))
    assert {(f.kind, f.name) for f in result.findings} == {("lifts", "N2"), ("lifts", "N3")}
    # the two far legs would have to pull with W (x/a - 1)/2 together
    assert sum(f.amount for f in result.findings) == pytest.approx(25.0, rel=1e-10)


def hung(force, torque=(0.0, 0.0, 0.0)):
    string = {"type": "string", "body": "lamp", "point_A": [0.0, 0.0, 2.0]}
    load = {"type": "wrench", "body": "lamp", "force": list(force), "torque": list(torque)}
    return {"bodies": {"lamp": {}}, "supports": {"string": string}, "loads": {"load": load}}


def test_string_pulls_only():
    assert answer(hung((0.0, 0.0, -5.0))).reactions["string"].along == pytest.approx(5.0)
    result = answer(hung((0.0, 0.0, 5.0)))
    (finding,) = result.findings
    assert (finding.kind, finding.name, finding.amount) == ("slack", "string", pytest.approx(5.0))
    assert "goes slack" in result.explanation


def test_uncarried_force_is_named():
    result = answer(hung((3.0, 0.0, -5.0)))
    (finding,) = result.findings
    assert result.verdict == "no equilibrium" and math.isnan(result.margin)
    assert (finding.kind, finding.name) == ("force", "lamp")
    assert finding.amount == pytest.approx(3.0, rel=1e-12)
    assert "force balance of body 'lamp' along x" in result.explanation


def test_uncarried_torque_is_named():
    result = answer(hung((0.0, 0.0, -5.0), (0.0, 0.0, -0.25)))
    (finding,) = result.findings
    assert (finding.kind, finding.name) == ("torque", "lamp")
    assert finding.amount == pytest.approx(0.25, rel=1e-12)
    assert "torque balance of body 'lamp' about -z" in result.explanation


def test_sphere_that_would_roll():
    """The torque about the point of contact, K_y + a F_x, is what the rough plane cannot carry."""
    a, force, torque = 0.1, 7.0, 0.05
    scene = {
        "bodies": {"ball": {"position": [0.0, 0.0, a]}},
        "supports": {
            "floor": {
                "type": "contact",
                "body": "ball",
                "point_B": [0.0, 0.0, -a],
                "normal_A": UP,
                "friction": "rough",
            }
        },
        "loads": {
            "drive": {
                "type": "wrench",
                "body": "ball",
                "force": [force, 0.0, -20.0],
                "torque": [0.0, torque, 0.0],
            }
        },
    }
    result = answer(scene)
    (finding,) = result.findings
    assert (finding.kind, finding.name) == ("torque", "ball")
    assert finding.amount == pytest.approx(torque + a * force, rel=1e-12)
    assert "about y through (0, 0, 0)" in result.explanation
    # with a spinning torque added the axis is oblique, but still through the point of contact
    scene["loads"]["drive"]["torque"] = [0.0, torque, 0.3]
    assert "through (0, 0, 0)" in answer(scene).explanation


def test_body_without_supports():
    free = {"bodies": {"stone": {"mass": 2.0}}, "loads": {"weight": {"type": "gravity"}}}
    result = answer(free)
    assert result.verdict == "no equilibrium"
    assert result.findings[0].amount == pytest.approx(2.0 * 9.81)
    assert "along -z" in result.explanation
    assert answer({"bodies": {"stone": {"mass": 2.0}}}).verdict == "equilibrium"


def test_unbounded_ranges_are_said_to_be_unbounded():
    """A ladder between perfectly rough surfaces can be jammed as hard as one likes."""
    result = answer(ladder(0.5, "rough", "rough"))
    assert result.verdict == "indeterminate"
    assert np.isposinf(result.ranges["floor"].along[1])
    assert np.isposinf(result.ranges["wall"].along[1])
    assert result.ranges["wall"].along[0] == pytest.approx(0.0, abs=1e-9)
    assert "unbounded (jammed): floor, wall" in result.explanation


def test_clamp_leaves_other_ranges_bounded():
    """A body on a floor between two smooth jaws: the squeeze is unbounded, the rest is not."""

    def jaw(x):
        return {
            "type": "contact",
            "body": "body",
            "point_B": [x, 0.0, 0.0],
            "normal_A": [-x, 0.0, 0.0],
        }

    floor = {"type": "contact", "body": "body", "point_B": [0.0, 0.0, 0.0], "normal_A": UP}
    scene = {
        "bodies": {"body": {}},
        "supports": {"left": jaw(-1.0), "right": jaw(1.0), "floor": floor},
        "loads": {"load": {"type": "wrench", "body": "body", "force": [2.0, 0.0, -5.0]}},
    }
    result = answer(scene)
    assert result.verdict == "indeterminate"
    assert result.ranges["right"].along == pytest.approx([2.0, np.inf], abs=1e-10)
    assert result.ranges["left"].along == pytest.approx([0.0, np.inf], abs=1e-10)
    assert result.ranges["floor"].along == pytest.approx([5.0, 5.0], rel=1e-12)
    assert result.reactions["right"].along == pytest.approx(2.0, rel=1e-12)


def test_squeeze_up_to_the_threshold_of_jamming():
    """Two jaws of friction mu hold a block of weight W only if they press with N >= W/(2 mu)."""
    jaws = {
        name: {
            "type": "contact",
            "body": "block",
            "point_B": [x, 0.0, 0.0],
            "normal_A": [-x, 0.0, 0.0],
            "friction": 0.25,
        }
        for name, x in (("left", -1.0), ("right", 1.0))
    }
    load = {"type": "wrench", "body": "block", "force": [0.0, 0.0, -10.0]}
    result = answer({"bodies": {"block": {}}, "supports": jaws, "loads": {"load": load}})
    assert result.verdict == "indeterminate"
    assert result.ranges["left"].along == pytest.approx([20.0, np.inf], rel=1e-11)
    # least norm: the weight shared, the jaws no harder than needed
    assert result.reactions["left"].along == pytest.approx(20.0, rel=1e-11)
    assert result.reactions["left"].force[2] == pytest.approx(5.0, rel=1e-11)


@pytest.mark.parametrize("friction", [1e-9, 1e-6, 1e-3, 1e3, 1e4])
def test_extreme_friction_is_as_accurate_as_it_says(friction):
    result = answer(table(LEGS, (0.0, 0.0, -400.0), (0.2, -0.1, 0.0), friction))
    slack = 400.0 * result.accuracy + 1e-10
    # how far the barrier gets in cones of 1e-9 depends on how the processor's BLAS rounds
    assert result.verdict == "indeterminate"
    assert result.accuracy < (1e-6 if friction > 1e-8 else 1e-4)
    for name, span in zip(("N1", "N4"), ([10.0, 160.0], [90.0, 240.0]), strict=True):
        assert result.ranges[name].along == pytest.approx(span, abs=slack)
    # foot 2 carries at most 150 N, and its friction along y reaches mu 100 N (see mu = 1e-3 to 1)
    assert result.ranges["N2"].force[1] == pytest.approx(
        [-100.0 * friction, 100.0 * friction], abs=2.0 * slack * max(1.0, friction)
    )


def test_no_loads():
    scene = table(LEGS, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.3)
    result = answer(scene)
    assert result.verdict == "equilibrium"
    for reaction in result.reactions.values():
        assert np.abs(reaction.force).max() == 0.0


def test_without_ranges_only_what_is_certain():
    scene = load_statics(table(LEGS, (0.0, 0.0, -400.0), (0.2, -0.1, 0.0)))
    result = solve(scene, ranges=False)
    assert result.verdict == "indeterminate" and not result.determinate
    assert np.isnan(result.ranges["N1"].along).all()
    assert result.reactions["N1"].along == pytest.approx(105.0, rel=1e-12)


def over_an_edge(beyond: float, field: str = "point_A") -> dict[str, Any]:
    """A level rod of 3 m from its foot at the origin, on an edge this far beyond its other end."""
    at = [3.0 + beyond, 0.0, 0.0]
    normal: dict[str, Any] = {"normal_A": UP}
    point = [0.0, 0.0, at[0]]
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    shape = {"type": "rod", "length": 3.0, "center_B": [0, 0, 1.5]}
    turn = {"axis": [0, 1, 0], "angle": 0.5 * math.pi}
    rod = {"mass": 10.0, "shape": shape, "center_of_mass": [0, 0, 1.5], "orientation": turn}
    if field == "point_A":
        point, normal = at, {"normal_B": [-1.0, 0.0, 0.0]}
    return {
        "bodies": {"rod": rod},
        "supports": {
            "foot": {"type": "contact", "body": "rod", "point_B": [0, 0, 0], "normal_A": UP},
            "edge": {"type": "contact", "body": "rod", field: point} | normal,
        },
        "loads": {"weight": weight},
    }


@pytest.mark.parametrize("field", ["point_A", "point_B"])
def test_a_rod_is_not_held_beyond_its_end(field: str) -> None:
    """At its very end it is, by half its weight."""
    held = answer(over_an_edge(0.0, field))
    assert held.verdict == "equilibrium"
    assert held.reactions["edge"].force[2] == pytest.approx(0.5 * 10.0 * 9.81, rel=1e-12)
    for beyond in (1e-6, 0.5):
        with pytest.raises(
            SceneError, match=rf"supports\.edge\.{field}: .*beyond its end"
        ) as found:
            answer(over_an_edge(beyond, field))
        assert "\n" not in str(found.value)
