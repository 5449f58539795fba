# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms of bodies at rest against the solver, and what `rb_sim accuracy` says of them."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import Rotation

from rb_sim.accuracy.accuracy_tables import measure, print_statics
from rb_sim.accuracy.closed_forms.at_rest import exact_reactions
from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.accuracy import of_statics
from rb_sim.scene.listing import find_scene, list_scenes, shipped_statics
from rb_sim.scene.load import is_statics, load_statics
from tests.equilibrium.scenes import UP, ladder, moved, table

CONFIG = Path(__file__).resolve().parents[2] / "config" / "statics"
SHIPPED = sorted(path.stem for path in CONFIG.glob("*.yaml"))
EXACT = 1e-12
"""Relative to the largest load."""

TURN, SHIFT = Rotation.from_rotvec([0.3, -0.8, 1.1]), np.array([0.4, -0.2, 0.7])


def contact(body: str, point: Any, normal: Any, **more: Any) -> dict[str, Any]:
    return {"type": "contact", "body": body, "point_B": point, "normal_A": normal} | more


def string(body: str, point: Any, to: Any, **more: Any) -> dict[str, Any]:
    return {"type": "string", "body": body, "point_B": point, "point_A": to} | more


def push(body: str, force: Any, point: Any = (0.0, 0.0, 0.0), torque: Any = (0.0, 0.0, 0.0)):
    load = {"type": "wrench", "body": body, "force": list(force), "point_B": list(point)}
    return {"load": load | {"torque": list(torque)}}


def sphere() -> dict[str, Any]:
    force, radius = np.array([2.0, -3.0, -25.0]), 0.3
    return {
        "bodies": {"ball": {}},
        "supports": {"floor": contact("ball", [0.0, 0.0, -radius], UP, friction="rough")},
        "loads": push("ball", force, torque=radius * np.cross(force, UP)),
    }


def rod_over_edge(height: float = 0.9, alpha: float = 0.7, length: float = 2.6) -> dict[str, Any]:
    s, c = math.sin(alpha), math.cos(alpha)
    middle = [-0.5 * length * s, 0.0, 0.5 * length * c]
    return {
        "bodies": {"rod": {"center_of_mass": middle}},
        "supports": {
            "edge": contact("rod", [-height * s / c, 0.0, height], [c, 0.0, s]),
            "floor": contact("rod", [0.0, 0.0, 0.0], UP),
            "string": string("rod", [0.0, 0.0, 0.0], [-2.0, 0.0, 0.0]),
        },
        "loads": push("rod", [0.0, 0.0, -40.0], middle),
    }


def rod_on_two_planes() -> dict[str, Any]:
    foot, top = np.array([0.7, 0.9, 0.0]), np.array([0.2, 0.0, 1.3])
    middle = (0.5 * (foot + top)).tolist()
    ends = {"wall": contact("rod", top.tolist(), [0.0, 1.0, 0.0])}
    ends |= {"floor": contact("rod", foot.tolist(), UP)}
    below = [0.2, 0.0, 0.0]
    ends |= {"at_foot": string("rod", foot.tolist(), below)}
    ends |= {"at_wall": string("rod", top.tolist(), [1.0, 0.0, 1.3])}
    loads = push("rod", [0.0, 0.0, -33.0], middle)
    return {"bodies": {"rod": {"center_of_mass": middle}}, "supports": ends, "loads": loads}


def hinged_rods(turned: bool) -> dict[str, Any]:
    """turned: hinge and string name the loaded rod as their body, not the other one."""
    a, b, c = [0.0, 0.0, 0.0], [1.4, 0.0, 0.0], [0.7, 0.0, 1.1]
    ends = {"body": "ac", "parent": "cb"} if turned else {"body": "cb", "parent": "ac"}
    tie = {"point_B": a, "point_A": b} if turned else {"point_B": b, "point_A": a}
    return {
        "bodies": {"ac": {}, "cb": {}},
        "supports": {
            "a": contact("ac", a, UP),
            "b": contact("cb", b, UP),
            "hinge": {"type": "hinge", "point_B": c} | ends,
            "string": {"type": "string"} | tie | ends,
        },
        "loads": push("ac", [0.0, 0.0, -21.0], [0.35, 0.0, 0.55]),
    }


def on_legs(at: tuple[float, float, float] = (0.1, 0.15, 0.4)) -> dict[str, Any]:
    legs = [(0.6, 0.4, 0.0), (0.6, -0.4, 0.0), (-0.6, 0.4, 0.0), (-0.6, -0.4, 0.0)]
    return table(legs, (0.0, 0.0, -50.0), at)


SCENES = {
    "sphere": sphere(),
    "rod over an edge": rod_over_edge(),
    "rod on two planes": rod_on_two_planes(),
    "hinged rods": hinged_rods(False),
    "hinged rods, named the other way round": hinged_rods(True),
    "ladder, smooth wall": ladder(1.0, 0.6, "smooth"),
    "ladder, both rough": ladder(1.0, 0.35, 0.2),
    "table": on_legs(),
}


@pytest.mark.parametrize("name", SCENES)
def test_closed_form_is_what_the_solver_finds(name: str) -> None:
    result = measure(load_statics(moved(SCENES[name], TURN, SHIFT)), spell=0.0)
    assert result.exact is not None
    assert set(result.exact.forces) == set(result.result.reactions)
    assert len(result.answers) == 1 + bool(result.exact.ranges)
    for answer in result.answers:
        assert answer.error < EXACT and answer.cost > 0.0
        assert answer.forces < EXACT and answer.torques < EXACT


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scene_has_its_closed_form(name: str) -> None:
    result = measure(load_statics(CONFIG / f"{name}.yaml"), spell=0.0)
    assert result.exact is not None
    assert set(result.exact.forces) == set(result.result.reactions)
    assert all(answer.error < EXACT for answer in result.answers)


def changed(scene: dict[str, Any], section: str, name: str, **changes: Any) -> dict[str, Any]:
    return scene | {section: scene[section] | {name: scene[section][name] | changes}}


def test_what_is_beyond_the_closed_forms_is_not_taken_for_them() -> None:
    rods = hinged_rods(False)
    for mapping in (
        changed(sphere(), "loads", "load", torque=[0.1, 0.0, 0.0]),  # rolls
        rod_over_edge(height=0.2),  # tips over the edge
        changed(rod_over_edge(), "supports", "edge", normal_A=[1.0, 0.0, 0.0]),
        changed(rod_over_edge(), "loads", "load", torque=[0.0, 0.1, 0.0]),
        changed(rod_on_two_planes(), "supports", "at_wall", point_A=[1.0, 0.0, 1.5]),
        changed(rods, "loads", "load", point_B=[0.2, 0.0, 0.3]),
        changed(rods, "supports", "b", body="ac"),
        ladder(0.6, 0.3, 0.0),  # slips
        ladder(1.0, 2.0, 0.5),  # jams: no bound above
        on_legs((0.5, 0.39, 0.0)),  # a leg lifts
        changed(on_legs(), "supports", "N1", point_B=[0.7, 0.4, 0.0]),
    ):
        assert exact_reactions(load_statics(mapping)) is None


def test_report_says_what_was_compared(tmp_path: Path) -> None:
    def reported(mapping: dict[str, Any]) -> str:
        text = io.StringIO()
        print_statics(measure(load_statics(mapping), spell=0.0), Console(file=text, width=200))
        return text.getvalue()

    assert "against the closed form (rod over an edge; LL section 38" in reported(rod_over_edge())
    assert "no closed form is known" in reported(ladder(1.0, 2.0, 0.5))
    slipping = reported(ladder(0.6, 0.3, 0.0))
    assert "no equilibrium" in slipping and "no reactions to measure" in slipping
    assert of_statics(CONFIG / "table_offset.yaml", tmp_path) == 0
    data = json.loads((tmp_path / "accuracy.json").read_text(encoding="utf-8"))
    assert [answer["name"] for answer in data["answers"]] == ["reactions", "with their ranges"]
    with pytest.raises(RbSimError, match="at rest"):
        of_statics(CONFIG / "table_offset.yaml", target=1e-6)


def test_the_verb_takes_names_and_files_of_both_kinds() -> None:
    assert set(SHIPPED) == set(shipped_statics())
    assert not set(SHIPPED) & {scene.name for scene in list_scenes()}
    assert find_scene("table_offset") == CONFIG / "table_offset.yaml"
    assert is_statics(CONFIG / "sphere_held.yaml")
    assert not is_statics(find_scene("pendulum"))
