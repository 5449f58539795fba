# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which of several constraints a sample violates most, in place and in velocity."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.accuracy.checks.violation import residual_found, violated_constraint
from rb_sim.mechanics.samples import SampleLayout
from rb_sim.scene.load import scene_from_mapping
from tests.accuracy.checks.blocks import Block

BODY = {"mass": 1.0, "inertia": [0.1, 0.2, 0.25]}
START = {"position": [1.0, 0.0, 0.1], "linear_velocity": [0.0, 1.0, 0.0]}
NAMES = SampleLayout(("a", "b"), (), (), ())


def scene(**more: Any) -> Any:
    """a turns about a point, b on a hinge of a and along a blade, which it does not at first."""
    return scene_from_mapping(
        {
            "bodies": {"a": BODY, "b": BODY | START},
            "constraints": {
                "pin": {"type": "fixed_point", "body": "a"},
                "hinge": {
                    "type": "fixed_axis", "body": "b", "parent": "a", "axis_B": [0, 0, 1],
                    "point_B": [-1, 0, 0], "point_A": [0, 0, 0.1], "axis_A": [0, 0, 1],
                },
                "blade": {"type": "velocity", "body": "b", "linear": [0.0, 1.0, 0.0]},
            },
            "simulation": {"method": "rk4", "step": 0.1} | more,
        }
    )  # fmt: skip


def samples(**residual: Any) -> Any:
    """Of both bodies where they should be."""
    still, q = np.zeros((3, 2, 3)), np.zeros((3, 2, 4))
    q[..., 3] = 1.0
    block: Any = Block(
        [0.0, 1.0, 2.0], position=still.copy(), orientation=q, linear_velocity=still.copy(),
        angular_velocity=still.copy(), residual=[0.0, 0.0, 0.0],
    )  # fmt: skip
    block.position[:, 1] = 1.0, 0.0, 0.1
    return block


@pytest.mark.parametrize(
    ("column", "body", "change", "name"),
    [
        ("position", slice(None), (0.0, 0.0, 0.02), "pin"),
        ("position", 1, (0.0, 0.0, 0.02), "hinge"),
        ("position", 1, (0.0, -0.02, 0.0), "hinge"),
        ("linear_velocity", 1, (0.0, 0.3, 0.0), "hinge"),
        ("angular_velocity", 1, (0.3, 0.0, 0.0), "hinge"),
    ],
)
def test_the_constraint_that_is_violated_is_named(
    column: str, body: Any, change: Any, name: str
) -> None:
    """Of the sample that is asked for; the others keep to all."""
    block = samples()
    getattr(block, column)[1, body] += change
    assert violated_constraint(scene(), NAMES, block, 1) == name


def test_a_line_for_velocities_alone_is_named_as_well() -> None:
    """All turn about the point, which the blade on b does not let them."""
    block = samples()
    block.angular_velocity[1, :, 2], block.linear_velocity[1, 1, 1] = 0.3, 0.3
    assert violated_constraint(scene(), NAMES, block, 1) == "blade"


def test_no_name_where_there_is_none_to_tell() -> None:
    block = samples()
    assert violated_constraint(scene(), NAMES._replace(contacts=("floor",)), block, 1) == ""
    free = scene_from_mapping({"bodies": {"a": BODY, "b": BODY}})
    assert violated_constraint(free, NAMES, block, 1) == ""


@pytest.mark.parametrize(("lost", "first"), [(0.0, 1), (np.nan, 0)])
def test_the_first_sample_beyond_the_bound_is_reported_with_the_worst(
    lost: float, first: int
) -> None:
    block = samples()
    block.position[:, 1, 2] += 0.02
    block.residual[:] = lost, 0.02, 0.07
    assert not list(residual_found(scene(), NAMES, block, 0.07)) or lost != 0.0
    (found,) = residual_found(scene(), NAMES, block, 0.01)
    assert (found.t, found.where) == (float(first), "hinge")
    assert found.figure == 0.07 and "dopri853" in found.advice
    (stepped,) = residual_found(scene(method="time_stepping"), NAMES, block, 0.01)
    assert "smaller step" in stepped.advice


# A shape that sinks into a support past its listed contact points is reported.


METHODS: list[dict[str, Any]] = [{}, {"method": "time_stepping", "step": 1e-3}]
L = 4.0


def rod(angle: float, **floor: Any) -> dict[str, Any]:
    """A rod that leans by the angle from the vertical, its foot at the origin and listed."""
    ladder = {
        "mass": 15.0,
        "shape": {"type": "rod", "length": L, "center_B": [0, 0, L / 2]},
        "center_of_mass": [0, 0, L / 2],
        "orientation": {"axis": [0, 1, 0], "angle": angle},
    }
    return {
        "bodies": {"ladder": ladder},
        "constraints": {"floor": {"type": "contact", "body": "ladder", **floor}},
        "effects": {"w": {"type": "gravity"}},
        "simulation": {"duration": 1.5, "rate": 200},
    }


def found(scene: dict[str, Any], method: dict[str, Any]) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = Simulation(load_scene(scene, **method)).run()
    return run, [f for f in run.findings if f.check == "inside"]


@pytest.mark.parametrize("method", METHODS)
def test_the_other_end_of_a_ladder_that_falls_past_its_listed_foot(method):
    """It is in the floor once z of that end, the foot's less L cos(angle), is below zero."""
    scene = rod(0.8, points=[[0, 0, 0]], friction={"type": "coulomb", "static": 0.2})
    run, (finding,) = found(scene, method)
    k = int(abs(run.t - finding.t).argmin())
    q = run.orientation["ladder"][k]
    end = run.position["ladder"][k, 2] + 0.5 * L * (1.0 - 2.0 * (q[0] ** 2 + q[1] ** 2))
    assert finding.figure == pytest.approx(-end, rel=1e-6) and finding.figure > 0.0
    assert finding.where == "floor" and "ladder" in finding.what


@pytest.mark.parametrize("method", METHODS)
def test_with_both_ends_or_none_listed_nothing_sinks(method):
    for points in ({"points": [[0, 0, 0], [0, 0, L]]}, {}):
        _, findings = found(rod(0.8, **points), method)
        assert not findings


def test_a_rim_all_round_in_a_bowl_is_looked_at_without_a_traceback():
    """An upright cylinder in the middle of a bowl: all points of its rim are equally near."""
    bowl = {"type": "sphere", "center": [0, 0, 1], "radius": 1.0, "side": "inside"}
    cylinder = {"type": "cylinder", "radius": 0.1, "length": 0.4}
    contact = {"type": "contact", "body": "b", "points": [[0, 0, -0.2]], "surface": bowl}
    scene = {
        "bodies": {"b": {"mass": 1.0, "shape": cylinder, "position": [0, 0, 0.3]}},
        "constraints": {"bowl": contact},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 0.5},
    }
    run, (finding,) = found(scene, {})
    z = run.position["b"][int(abs(run.t - finding.t).argmin()), 2] - 0.2
    assert finding.figure == pytest.approx(math.hypot(1.0 - z, 0.1) - 1.0, rel=1e-6)


def test_a_body_without_a_shape_has_nothing_to_sink():
    scene = rod(0.8, points=[[0, 0, 0]])
    del scene["bodies"]["ladder"]["shape"]
    scene["bodies"]["ladder"]["inertia"] = [20.0, 20.0, 0.1]
    assert not found(scene, {})[1]


def test_a_box_past_its_listed_corner_on_another_body():
    """Any support that it may touch: the face of another body's box."""
    box = {"type": "box", "size": [0.4, 0.4, 0.2]}
    scene = {
        "bodies": {
            "table": {"mass": 5.0, "shape": {"type": "box", "size": [2, 2, 0.2]}},
            "box": {"mass": 1.0, "shape": box, "position": [0, 0, 0.2]},
        },
        "constraints": {
            "hold": {"type": "weld", "body": "table"},
            "on": {"type": "contact", "body": "box", "parent": "table"}
            | {"points": [[0.2, 0.2, -0.1]], "surface": {"type": "shape"}},
        },
        "effects": {"w": {"type": "gravity", "acceleration": [0, 0, -9.81]}},
        "simulation": {"duration": 0.3, "rate": 100},
    }
    (finding,) = found(scene, {})[1]
    assert finding.where == "on" and 0.0 < finding.figure < math.hypot(0.4, 0.2)


TABLE = {"type": "weld", "body": "table"}
LOG = {"type": "cylinder", "axis": [0, 1, 0], "radius": 0.3, "point": [0, 0, -0.3]} | {
    "side": "outside"
}
FALLS = {
    # body, its listed points, support: by its whole shape the body cannot touch it, or slides past
    "cylinder on a box": ("cylinder", [[0.2, 0, -0.2]], {"type": "shape"}),
    "cylinder on a log": ("cylinder", [[0.2, 0, -0.2]], LOG),
    "box on an equal box": (
        "box",
        [[x, y, -0.1] for x in (-1, 1) for y in (-1, 1)],
        {"type": "shape"},
    ),
}


@pytest.mark.parametrize("name", FALLS)
@pytest.mark.parametrize("method", METHODS[:1])
def test_a_shape_in_a_support_that_only_its_listed_points_touch(name, method):
    kind, points, surface = FALLS[name]
    shapes = {
        "cylinder": {"type": "cylinder", "radius": 0.2, "length": 0.4},
        "box": {"type": "box", "size": [2.0, 2.0, 0.2]},
    }
    contact = {"type": "contact", "body": "b", "points": points, "surface": surface}
    scene = {
        "bodies": {
            "table": {"mass": 5.0, "shape": {"type": "box", "size": [2, 2, 0.2]}}
            | {"position": [0, 0, -0.1]},
            "b": {"mass": 1.0, "shape": shapes[kind], "position": [0, 0, 0.3]},
        },
        "constraints": {
            "hold": TABLE,
            "on": contact | ({} if surface is LOG else {"parent": "table"}),
        },
        "effects": {"w": {"type": "gravity"}},
        "simulation": {"duration": 0.5, "rate": 100},
    }
    (finding,) = found(scene, method)[1]
    assert finding.where == "on" and 0.0 < finding.figure < 0.4
