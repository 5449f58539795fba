# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contact between all bodies: the scene with every pair written out, and what needs no program."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from rb_sim import SceneError, Simulation, load_scene
from rb_sim.accuracy.ladder import climb
from rb_sim.equilibrium.statics_of_scene import at_rest
from rb_sim.simulation.trajectory import Trajectory

RUBS = {"type": "coulomb", "static": 0.5}
STEP = 1e-3
WEIGHT = {"g": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}}


def ball(position: Any, radius: float = 0.1, **more: Any) -> dict[str, Any]:
    shape = {"type": "sphere", "radius": radius}
    return {"mass": 1.0, "shape": shape, "position": [float(x) for x in position]} | more


def box(position: Any, **more: Any) -> dict[str, Any]:
    shape = {"type": "box", "size": [0.2, 0.16, 0.12]}
    return {"mass": 2.0, "shape": shape, "position": [float(x) for x in position]} | more


def scene(bodies: Any, constraints: Any, effects: Any = WEIGHT, **options: Any) -> dict[str, Any]:
    method = {"method": "time_stepping", "step": STEP, "duration": 0.5, "rate": 1.0 / STEP}
    given = {"bodies": bodies, "constraints": constraints, "effects": effects}
    return given | {"simulation": method | options}


def moved(mapping: dict[str, Any]) -> Trajectory:
    return Simulation(load_scene(mapping), announce=None).run(checks=False)


def tossed(seed: int, kinds: tuple[Any, ...]) -> dict[str, Any]:
    """Balls and boxes in a loose heap, thrown together above a floor."""
    rng, bodies = np.random.default_rng(seed), {}
    for i in range(8):
        place = [0.3 * (i % 2), 0.3 * (i // 2 % 2), 0.2 + 0.3 * (i // 4)]
        speeds = {
            "linear_velocity": rng.normal(size=3).tolist(),
            "angular_velocity": (5.0 * rng.normal(size=3)).tolist(),
        }
        bodies[f"b{i}"] = kinds[i % len(kinds)](place, **speeds)
    return bodies


def written_out(bodies: dict[str, Any], **law: Any) -> dict[str, Any]:
    """The constraints of a floor and every pair, one by one."""
    out: dict[str, Any] = {f"floor_{b}": {"type": "contact", "body": b} | law for b in bodies}
    for a, b in combinations(bodies, 2):
        pair = {"body": b, "parent": a}
        out[f"{a}_{b}"] = {"type": "contact", "surface": {"type": "shape"}} | pair | law
    return out


def in_one_line(**law: Any) -> dict[str, Any]:
    return {
        "floor": {"type": "contact", "body": "all"} | law,
        "heap": {"type": "contact", "between": "all"} | law,
    }


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("kinds", "rough"), [((ball,), 1e-12), ((ball, box, ball), 1e-6)], ids=["balls", "with boxes"]
)
def test_the_motion_and_the_forces_are_those_of_all_pairs_written_out(kinds, rough):
    # written out, pairs of one kind are solved together: with boxes in another order
    bodies, law = tossed(1, kinds), {"friction": RUBS, "restitution": 0.3}
    one = moved(scene(bodies, in_one_line(**law)))
    every = moved(scene(bodies, written_out(bodies, **law)))
    struck = 0.0
    for name in bodies:
        np.testing.assert_allclose(one.position[name], every.position[name], atol=rough)
        np.testing.assert_allclose(one.orientation[name], every.orientation[name], atol=10 * rough)
        force, torque = np.zeros((2, len(one.t), 3))
        for a, b in combinations(bodies, 2):
            if name in (a, b):
                wrench, sign = every.reaction[f"{a}_{b}"], 1.0 if name == b else -1.0
                arm = wrench.anchor - every.position[name]
                force += sign * wrench.force
                torque += sign * (wrench.torque + np.cross(arm, wrench.force))
        size = max(1.0, np.abs(force).max())
        given = one.reaction[f"heap_{name}"]
        np.testing.assert_allclose(given.force, force, atol=10 * rough * size)
        np.testing.assert_allclose(given.torque, torque, atol=10 * rough * size)
        struck = max(struck, np.abs(force).max())
    assert struck > 100.0  # they did meet
    np.testing.assert_allclose(one.contact_work, every.contact_work, atol=100 * rough)


@pytest.mark.filterwarnings("ignore")
def test_bodies_that_fly_together_from_afar_meet_and_exchange_their_velocities():
    # 40 m apart at 30 m/s each, elastic: no list of neighbours from the start has them
    one = ball([-20.0, 0.0, 0.0], linear_velocity=[30.0, 0.0, 0.0])
    two = ball([20.0, 0.0, 0.0], linear_velocity=[-30.0, 0.0, 0.0])
    by = {f"by{i}": ball([3.0 * i - 20.0, 50.0, 0.0]) for i in range(8)}
    heap = {"heap": {"type": "contact", "between": "all", "restitution": 1.0}}
    run = moved(scene({"one": one, "two": two} | by, heap, {}, duration=1.0, rate=100.0))
    assert run.linear_velocity["one"][-1] == pytest.approx([-30.0, 0.0, 0.0], abs=1e-9)
    assert run.linear_velocity["two"][-1] == pytest.approx([30.0, 0.0, 0.0], abs=1e-9)
    # they meet after 39.8 m / 60 m/s, so that one is back by what is left of the second
    meets = 39.8 / 60.0
    x = -20.0 + 30.0 * meets - 30.0 * (1.0 - meets)
    assert run.position["one"][-1][0] == pytest.approx(x, abs=60.0 * STEP)
    states = run.contact_state
    assert not states["heap_by3"].any()


@pytest.mark.filterwarnings("ignore")
def test_a_column_bears_what_is_above_and_only_pairs_that_are_near_take_memory():
    # 12 balls upon each other, 200 more that lie 1 m from each other: 11 pairs touch
    bodies = {f"up{i}": ball([0.0, 0.0, 0.1 + 0.2 * i]) for i in range(12)}
    bodies |= {f"by{i}": ball([2.0 + i % 15, 2.0 + i // 15, 0.1]) for i in range(200)}
    simulation = Simulation(load_scene(scene(bodies, in_one_line(), duration=0.02)), announce=None)
    run = simulation.run(checks=False)
    for i in range(12):
        below = run.reaction[f"floor_up{i}"].force[-1] + run.reaction[f"heap_up{i}"].force[-1]
        assert below == pytest.approx([0.0, 0.0, 9.81], abs=1e-7)
    assert run.reaction["floor_up0"].force[-1][2] == pytest.approx(12 * 9.81, rel=1e-7)
    points: Any = simulation._motion
    assert len(points._tables.owners) == len(bodies) + 11


def test_what_cannot_be_is_refused_in_a_line():
    two = {"a": ball([0, 0, 0]), "b": ball([1, 0, 0])}
    cylinder = {"type": "cylinder", "radius": 0.1, "length": 0.2}
    roller = {"mass": 1.0, "shape": cylinder, "position": [2.0, 0.0, 0.0]}

    def refused(pattern: str, bodies: Any, constraints: Any, **options: Any) -> None:
        with pytest.raises(SceneError, match=pattern):
            Simulation(load_scene(scene(bodies, constraints, {}, **options)), announce=None)

    def between(names: Any, **more: Any) -> dict[str, Any]:
        return {"heap": {"type": "contact", "between": names} | more}

    refused(r"constraints\.heap\.between: got 'some'", two, between("some"))
    refused(r"constraints\.heap\.between: got \['a'\]", two, between(["a"]))
    refused(r"constraints\.heap\.between\[1\]: got 'c'", two, between(["a", "c"]))
    refused(r"constraints\.heap\.between", {"a": two["a"]}, between("all"))
    refused(r"constraints\.heap\.parent: got 'a'; must be omitted", two, between("all", parent="a"))
    refused(r"constraints\.heap\.body: got 'a'; must be omitted", two, between("all", body="a"))
    point = {"mass": 1.0, "inertia": [1, 1, 1]}
    refused(r"got \['a', 'c'\]; .*: c has none$", two | {"c": point}, between(["a", "c"]))
    refused(r"constraints\.heap\.restitution", two, between("all", restitution=2.0))
    refused("box and cylinder", {"a": box([0, 0, 0]), "b": roller}, between("all"))
    refused("a and b overlap by", two | {"b": ball([0.15, 0, 0])}, between("all"))
    refused("are also in other", two,
            between("all") | {"other": {"type": "contact", "between": ["a", "b"]}})  # fmt: skip
    with pytest.raises(SceneError, match=r"simulation\.method: got 'dopri853'; must be time_step"):
        options = {"method": "dopri853", "step": None, "tolerance": 1e-9}
        Simulation(load_scene(scene(two, between("all"), {}, **options)), announce=None)
    with pytest.raises(SceneError, match="compared with other methods: time_stepping is the only"):
        climb(load_scene(scene(two, between("all"))))
    with pytest.raises(SceneError, match=r"constraints\.heap_a\.between"):
        at_rest(load_scene(scene(two, between("all"))))


WITHOUT_GROUP: list[tuple[str, dict[str, Any]]] = [
    ("heap.between: got 'all'; must be omitted unless", {"heap": {"between": "all"}}),
    ("heap.body: got 'a'; must be omitted if", {"heap": {"between": "all", "body": "a"}}),
    ("heap.between: got ['a', 'b']; must be bodies with", {"heap": {"between": ["a", "b"]}}),
    ("floor_a: got 'floor_a'; must be another",
     {"floor": {"body": "all"}, "floor_a": {"body": "a"}}),
]  # fmt: skip


@pytest.mark.parametrize(("line", "contacts"), WITHOUT_GROUP)
def test_a_group_that_cannot_be_does_not_hide_other_errors(line: str, contacts: dict[str, Any]):
    point = {"mass": 1.0, "inertia": [1, 1, 1]}
    given = {name: {"type": "contact"} | more for name, more in contacts.items()}
    given["hinge"] = {"type": "fixed_point", "body": "c"}
    data = {
        "bodies": {"a": ball([0, 0, 0]) | {"mass": -1.0}, "b": point},
        "constraints": given,
        "simulation": {"rate": 0},
    }
    with pytest.raises(SceneError) as error:
        load_scene(data)
    for part in (f"constraints.{line}", "bodies.a.mass: got -1.0", "simulation.rate: got 0",
                 "constraints.hinge.body: got 'c'"):  # fmt: skip
        assert part in str(error.value)


@pytest.mark.filterwarnings("ignore")
def test_what_a_joint_holds_together_does_not_touch():
    bodies = {"a": ball([0.0, 0.0, 0.0]), "b": ball([0.15, 0.0, 0.0])}  # they overlap
    rod = {"hinge": {"type": "fixed_point", "body": "b", "parent": "a", "point_B": [-0.1, 0, 0]}}
    heap = {"heap": {"type": "contact", "between": "all"}}
    run = moved(scene(bodies, rod | heap, duration=0.1))
    assert not run.reaction["heap_a"].force.any()
    fallen = -0.5 * 9.81 * 0.1**2
    assert run.position["b"][-1] == pytest.approx([0.15, 0.0, fallen], abs=1e-9)
