# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scales of scenes with contacts, and which starts are refused: by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SceneError
from rb_sim.catalogue.geometry.corners_and_rims import ABSENT
from rb_sim.mechanics.contact.contact_bodies import GAP, LEAN_SIGN, SLIP, TOUCH_WIDTH
from rb_sim.scene import compile_contacts
from rb_sim.scene.compile_contacts import contact_scales, overlaps


def scales(
    monkeypatch: pytest.MonkeyPatch, joints: float = 0.0, reach: float | None = None,
    speeds: tuple[Any, Any] = ((0.0,) * 3, (0.0,) * 3), **pair: Any,
) -> tuple[float, float]:  # fmt: skip
    """(length, speed) of a scene of one body and one contact."""
    monkeypatch.setattr(
        "rb_sim.scene.compile_contacts.scene_scales", lambda place, parts: (joints, 0.0)
    )
    shape = None if reach is None else SimpleNamespace(reach=reach)
    scene: Any = SimpleNamespace(bodies={"b": SimpleNamespace(shape=shape)}, file="")
    place: Any = SimpleNamespace(
        state=lambda name: SimpleNamespace(v_WC=speeds[0], w_WB_B=speeds[1])
    )
    contact: Any = SimpleNamespace(row=SimpleNamespace(pair=SimpleNamespace(**pair)))
    return contact_scales(place, scene, [], [contact])


@pytest.mark.parametrize(
    "sizes",
    [
        {"joints": 3.0}, {"reach": 3.0}, {"radius": 3.0}, {"curved": 3.0}, {"r_B": (0.0, 3.0, 0.0)},
        {"surface": SimpleNamespace(reach=3.0)},
    ],
)  # fmt: skip
def test_the_length_is_the_largest_of_joints_shapes_and_supports(
    monkeypatch: pytest.MonkeyPatch, sizes: Any
) -> None:
    """And the speed at least that of a fall by about as much."""
    others = {"joints": 0.1, "reach": 0.2, "radius": 0.3, "curved": 0.4, "r_B": (0.5, 0.0, 0.0)}
    assert scales(monkeypatch, **others | sizes) == (3.0, pytest.approx((9.81 * 3.0) ** 0.5))
    assert scales(monkeypatch, **sizes)[0] == 3.0


def test_the_speed_is_that_of_bodies_with_their_spin(monkeypatch: pytest.MonkeyPatch) -> None:
    found = scales(monkeypatch, joints=0.5, speeds=((3.0, 4.0, 0.0), (0.0, 6.0, 8.0)))
    assert found == (0.5, 10.0)
    with pytest.raises(SceneError, match="are too large"):
        scales(monkeypatch, joints=1e300, speeds=((0.0,) * 3, (1e300, 0.0, 0.0)))
    for length, speed in ((1e155, 1.0), (1.0, 1e155)):  # a wall's radius of 1e300 m was a traceback
        with pytest.raises(SceneError, match="squares overflow"):
            scales(monkeypatch, joints=length, speeds=((speed, 0.0, 0.0), (0.0,) * 3))
    assert scales(monkeypatch, joints=1e150, speeds=((1e150, 0.0, 0.0), (0.0,) * 3))[0] == 1e150


START: dict[str, Any] = {"gap": 0.0, "slip": 0.0, "soft": False, "both": False, "rough": False}


@pytest.mark.parametrize(
    ("contact", "refused"),
    [
        ({"gap": -1.1}, "overlap of 2.2e-06 m"), ({"gap": -0.9}, ""), ({"gap": 5.0}, ""),
        ({"gap": 1.1, "both": True}, "gap of 2.2e-06 m"), ({"gap": 0.9, "both": True}, ""),
        ({"gap": -5.0, "soft": True}, ""), ({"gap": 5.0, "soft": True, "both": True}, ""),
        ({"slip": 1.1, "rough": True}, "slips at 3.3e-06 m/s"), ({"slip": 0.9, "rough": True}, ""),
        ({"slip": 9.0, "gap": 1.1, "rough": True}, ""), ({"slip": 9.0}, ""),
    ],
)  # fmt: skip
def test_which_starts_are_refused(
    monkeypatch: pytest.MonkeyPatch, contact: dict[str, Any], refused: str
) -> None:
    """Of overlaps, gaps of what is held both ways, and slips of what is perfectly rough, over
    MISFIT of 2 m and 3 m/s."""
    given: dict[str, Any] = START | contact
    touch = np.zeros((1, TOUCH_WIDTH))
    touch[0, GAP] = given["gap"] * compile_contacts.MISFIT * 2.0
    touch[0, SLIP : SLIP + 3] = (
        np.array([0.0, 0.6, 0.8]) * given["slip"] * compile_contacts.MISFIT * 3.0
    )
    touch[0, SLIP + 3] = 70.0
    system: Any = SimpleNamespace(touch=touch, length=2.0, speed=3.0)
    law: Any = SimpleNamespace(
        compliant=given["soft"], bilateral=given["both"], static=np.inf if given["rough"] else 0.5
    )
    told: list[str] = []
    monkeypatch.setattr(compile_contacts, "write_rows", lambda *of: None)
    monkeypatch.setattr(
        compile_contacts, "refuse_initial", lambda scene, name, problem: told.append(problem)
    )
    scene: Any = SimpleNamespace(
        simulation=SimpleNamespace(project_initial=False),
        constraints={"floor": SimpleNamespace(type="contact")},
    )
    compile_contacts.check_contacts(scene, system, np.zeros(13), ["floor"], [law], 0.0)
    assert len(told) == bool(refused) and all(refused in problem for problem in told)


def test_overlaps_are_of_rigid_contacts_that_can_touch() -> None:
    touch = np.zeros((3, TOUCH_WIDTH))
    touch[:, GAP], touch[:, LEAN_SIGN] = (-0.1, -0.2, -0.3), (1.0, 1.0, ABSENT)
    laws: Any = [SimpleNamespace(compliant=soft) for soft in (False, True, False)]
    assert overlaps(SimpleNamespace(touch=touch), laws).tolist() == [-0.1, 0.0, 0.0]  # type: ignore[arg-type]
