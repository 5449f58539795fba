# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of others beside a scene: which pose is of which body, and what its bodies were commanded.

A cart of mass M is pushed by forces that were commanded step by step: its motion is known.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from rb_sim import compare, fit
from rb_sim.base.errors import RbSimError
from rb_sim.cli.options import FitOptions
from rb_sim.cli.verbs.compare import TOO_FAR, CompareOptions
from rb_sim.cli.verbs.compare import compare as compare_verb
from rb_sim.cli.verbs.fit import fit as fit_verb
from tests.bags.analysis import foreign

M, V = 2.5, 0.4
"""Mass of the cart, and its first velocity along x."""
AT = np.array([0.0, 0.35, 0.8, 1.23])
"""Times of the commands, not those of the poses."""
FORCE = np.array([3.0, -6.0, 0.0, 4.0])
T = np.arange(0.05, 2.0, 0.02)
SPIN = 0.9
"""Of the cart about z."""


def along(t):
    """Place and velocity along x under the commands that came so far."""
    edges = np.append(AT, np.inf)
    x, v = np.zeros_like(t), np.full_like(t, V)
    for k, force in enumerate(FORCE):
        span = np.clip(np.minimum(t, edges[k + 1]) - edges[k], 0.0, None)
        x += v * span + force / M * span**2 / 2
        v = v + force / M * span
    return x, v


def attitude(t: float):
    return np.array([0.0, 0.0, np.sin(SPIN * t / 2), np.cos(SPIN * t / 2)])


def poses(make=foreign.pose_stamped, topic: str = "/cart/pose", unit: float = 1.0):
    """unit: numbers of the positions in a metre."""
    x = unit * along(T)[0]
    return [(t, topic, *make(t, [x[k], 0.0, 0.0], attitude(t))) for k, t in enumerate(T)]


def pushes(topic: str = "/cart/push", frame: str = "map", part: float = 1.0):
    both = zip(AT, FORCE, strict=True)
    return [
        (t, topic, *foreign.wrench_stamped(t, frame, [part * force, 0.0, 0.0])) for t, force in both
    ]


def write(folder: Path, *streams, plugin=StoragePlugin.SQLITE3) -> Path:
    """A bag of (t, topic, type, message), in the order of their times."""
    entries = sorted(sum(streams, []), key=lambda entry: entry[0])
    return foreign.record(folder, entries, plugin)


def scene(folder: Path, mass: float = M, turning: bool = True, **more) -> str:
    """The cart at the time of the first pose."""
    (x,), (v,) = along(T[:1])
    cart = {
        "mass": mass, "inertia": [0.1, 0.1, 0.1], "position": [float(x), 0.0, 0.0],
        "linear_velocity": [float(v), 0.0, 0.0],
        "orientation": attitude(T[0]).tolist() if turning else [0.0, 0.0, 0.0, 1.0],
        "angular_velocity": [0.0, 0.0, SPIN if turning else 0.0],
    }  # fmt: skip
    path = folder / "cart.yaml"
    effects = {"push": {"type": "commanded_wrench", "body": "cart"}}
    options = {"method": "dopri853", "tolerance": 1e-10}
    text = {"bodies": {"cart": cart}, "effects": effects, "simulation": options} | more
    path.write_text(json.dumps(text))
    return str(path)


def largest(found) -> float:
    return max(float(series["position"].max()) for series in found.series.values())


STAMP = 5e-7
"""Rounding of calendar times in seconds, times velocities of the cart [m]."""


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_scene_follows_the_bag_of_somebody_else_with_its_commands(tmp_path, plugin):
    bag = write(tmp_path / "bag", poses(), pushes(), plugin=plugin)
    found = compare(bag, scene(tmp_path))
    assert found.pairs == {"/cart/pose": "cart"} and found.align == "none"
    assert len(found.t["/cart/pose"]) == len(T)
    assert largest(found) < STAMP
    assert largest(compare(bag, scene(tmp_path), wrenches=["none"])) > 0.1
    (x,), (v,) = along(T[:1])
    pushed = np.abs(along(T)[0] - x - v * (T - T[0])).max()
    heavy = largest(compare(bag, scene(tmp_path, 1.1 * M)))
    assert heavy == pytest.approx(pushed * 0.1 / 1.1, rel=1e-5)


def test_a_fit_finds_the_mass_from_the_wrenches_that_were_recorded(tmp_path):
    bag = write(tmp_path / "bag", poses(), pushes())
    found = fit(bag, ["bodies.cart.mass"], scene=scene(tmp_path, 4.0))
    assert found.values[0] == pytest.approx(M, rel=1e-6)
    assert found.errors[0] < 1e-5
    lost = fit(bag, ["bodies.cart.mass"], scene=scene(tmp_path, 4.0), wrenches=["none"])
    assert lost.undetermined == ["bodies.cart.mass"]


def test_a_bag_without_the_commands_of_the_scene_is_said_to_have_none(tmp_path, capsys):
    bag = write(tmp_path / "bag", poses())
    fit_verb(FitOptions(bag, ["bodies.cart.mass"], scene=scene(tmp_path, 4.0)))
    assert "no wrench in it is a command of push of cart: zero" in capsys.readouterr().err
    bag = write(tmp_path / "pushed", poses(), pushes())
    fit_verb(FitOptions(bag, ["bodies.cart.mass"], scene=scene(tmp_path, 4.0)))
    assert "no wrench" not in capsys.readouterr().err


@pytest.mark.parametrize("times, unit", [(1000.0, "mm"), (100.0, "cm")])
def test_poses_in_other_units_are_not_fitted(tmp_path, times, unit):
    """The mass of a model that is too heavy would be moved until its size fits."""
    bag = write(tmp_path / "bag", poses(unit=times), pushes())
    with pytest.raises(RbSimError, match=f"cart: .* is the recording in {unit}"):
        fit(bag, ["bodies.cart.mass"], scene=scene(tmp_path, 1.3 * M))


def test_wrenches_without_a_header_act_at_the_time_of_the_log(tmp_path):
    """In world axes, on the body that the topic names."""
    kind = "geometry_msgs/msg/Wrench"
    bare = [(t, topic, kind, message.wrench) for t, topic, _, message in pushes()]
    found = compare(write(tmp_path / "bag", poses(), bare), scene(tmp_path))
    assert largest(found) < 5 * STAMP  # `write` rounds the times of the log as well


def test_a_command_in_the_axes_of_the_body_turns_with_it(tmp_path):
    """A force along its own x, and a moment about its z, which makes it spin faster."""
    scene_of_body = scene(tmp_path)
    torque = [(0.3, "/push", *foreign.wrench_stamped(0.3, "cart", [0, 0, 0], [0, 0, 0.05]))]
    turns = [SPIN * t + 0.5 * (0.05 / 0.1) * max(0.0, t - 0.3) ** 2 for t in T]
    (x0,), (v0,) = along(T[:1])
    there = [(t, "/cart/pose", *foreign.pose_stamped(
        t, [x0 + v0 * (t - T[0]), 0, 0], [0, 0, np.sin(a / 2), np.cos(a / 2)]))
        for t, a in zip(T, turns, strict=True)]  # fmt: skip
    found = compare(write(tmp_path / "bag", there, torque), scene_of_body)
    assert max(series["angle"].max() for series in found.series.values()) < 1e-6
    forward = [(0.3, "/push", *foreign.wrench_stamped(0.3, "cart", [1.0, 0, 0]))]
    found = compare(write(tmp_path / "other", poses(), forward), scene_of_body)
    assert largest(found) > 0.01


def fixed(child: str, p, q, parent: str = "cart"):
    return [(0.0, "/tf_static", *foreign.transforms(0.0, (parent, child, p, q)))]


def test_a_wrench_in_a_frame_that_is_fixed_to_the_body_is_carried_over_to_its_origin(tmp_path):
    """A thruster 0.2 m beside the origin that pushes along the body's y: force and moment."""
    turn = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
    thrust = [(0.3, "/thrust", *foreign.wrench_stamped(0.3, "nozzle", [0.5, 0.0, 0.0]))]
    same = [(0.3, "/same", *foreign.wrench_stamped(0.3, "cart", [0.0, 0.5, 0.0], [0.0, 0.0, 0.1]))]
    where = fixed("nozzle", [0.2, 0.0, 0.0], turn)
    bag = write(tmp_path / "bag", poses(), where, thrust, same)
    with pytest.raises(RbSimError, match="/thrust and /same act on cart: .* --wrench TOPIC"):
        compare(bag, scene(tmp_path))
    one, two = (compare(bag, scene(tmp_path), match={"/cart/pose": "cart"}, wrenches=[topic])
                for topic in ("/thrust", "/same"))  # fmt: skip
    for quantity in ("position", "angle"):
        series = one.series["/cart/pose"][quantity]
        assert series.max() > 0.01
        assert np.abs(series - two.series["/cart/pose"][quantity]).max() < 1e-9


def test_several_commands_add_up_as_they_hold(tmp_path):
    """A third of the force on one topic and the rest on another one."""
    halves = pushes("/cart/left", part=1 / 3), pushes("/cart/right", part=2 / 3)
    bag = write(tmp_path / "bag", poses(), *halves)
    found = compare(bag, scene(tmp_path), wrenches=["/cart/left", "cart=/cart/right"])
    assert largest(found) < STAMP


def test_a_topic_whose_commands_change_their_axes_is_one_command(tmp_path):
    """The second command is in the axes of the body, which is not turned in this scene."""
    x, _ = along(T)
    there = [(t, "/cart/pose", *foreign.pose_stamped(t, [x[k], 0, 0], [0, 0, 0, 1]))
             for k, t in enumerate(T)]  # fmt: skip
    frames = ("map", "cart", "map", "cart")
    mixed = [(t, "/cart/push", *foreign.wrench_stamped(t, frame, [f, 0, 0]))
             for t, f, frame in zip(AT, FORCE, frames, strict=True)]  # fmt: skip
    bag = write(tmp_path / "bag", there, mixed)
    assert largest(compare(bag, scene(tmp_path, turning=False))) < STAMP


@pytest.mark.parametrize(("make", "topic", "name"), [
    (foreign.pose_stamped, "/lab/cart/pose", "/lab/cart/pose"),
    (lambda t, p, q: foreign.tf(t, p, q, "cart"), "/tf", "/tf:cart"),
    (foreign.pose_stamped, "/mocap", "/mocap"),
])  # fmt: skip
def test_whose_poses_they_are_follows_from_topic_frame_or_there_being_one(
    tmp_path, make, topic, name
):
    bag = write(tmp_path / "bag", poses(make, topic), pushes("/cart/push"))
    found = compare(bag, scene(tmp_path))
    assert found.pairs == {name: "cart"} and largest(found) < STAMP


def test_odometry_is_of_the_body_that_its_child_frame_names(tmp_path):
    def odometry(t, p, q):
        kind, message = foreign.odometry(t, p, q)
        message.child_frame_id = "cart"
        return kind, message

    other = poses(topic="/other")
    bag = write(tmp_path / "bag", poses(odometry, "/odom"), other, pushes())
    assert compare(bag, scene(tmp_path)).pairs == {"/odom": "cart"}


def test_where_nothing_tells_one_line_names_the_option(tmp_path):
    bag = write(tmp_path / "bag", poses(topic="/one"), poses(topic="/two"), pushes())
    with pytest.raises(RbSimError) as caught:
        compare(bag, scene(tmp_path))
    assert str(caught.value) == (
        f"{bag}: its poses are of /one, /two; the scene's bodies are cart; assign them with "
        "--match NAME=BODY"
    )
    with pytest.raises(RbSimError, match="assign them with --match NAME=BODY"):
        fit(bag, "bodies.cart.mass", scene=scene(tmp_path))
    assert largest(compare(bag, scene(tmp_path), match={"/two": "cart"})) < STAMP


@pytest.mark.parametrize(("wrenches", "line"), [
    (["/pull"], "--wrench /pull: the topic must be one of /cart/push, /elsewhere, /hand$"),
    (["lid=/hand"], "--wrench lid=/hand: bodies that take a command: cart$"),
    (["/hand"], "--wrench /hand: neither its frame nor its name identifies the body; give "
                r"BODY=/hand \(bodies that take a command: cart\)$"),
    (["cart=/hand"], "--wrench cart=/hand: its frame hand is neither the body's nor that of its "),
])  # fmt: skip
def test_a_wrench_that_is_no_command_of_a_body_is_refused_in_one_line(tmp_path, wrenches, line):
    others = [*pushes("/elsewhere", "map"), *pushes("/hand", "hand")]
    bag = write(tmp_path / "bag", poses(), pushes(), others)
    with pytest.raises(RbSimError, match=line):
        compare(bag, scene(tmp_path), wrenches=wrenches)


def test_a_reaction_that_was_measured_is_no_command(tmp_path, capsys):
    """A wrench named as a constraint of the scene is what that constraint does."""
    held = {"rail": {"type": "free", "body": "cart"}}
    bag = write(tmp_path / "bag", poses(), pushes(), pushes("/cart/rail", "cart"))
    assert largest(compare(bag, scene(tmp_path, constraints=held))) < STAMP
    err = capsys.readouterr().err
    assert "note: /cart/push is applied to cart as its command\n" in err
    assert "note: its wrenches (/cart/rail) are not applied: " in err


def test_the_bound_of_a_wrong_model_is_exceeded(tmp_path, capsys):
    bag = write(tmp_path / "bag", poses(), pushes())
    bounds = {"max_position": 1e-3}
    assert compare_verb(CompareOptions(bag, scene(tmp_path), **bounds)) == 0
    assert compare_verb(CompareOptions(bag, scene(tmp_path, 3.0), **bounds)) == TOO_FAR
    assert (
        "starts as the scene says, at the first pose, t = 1700000000.050000 s"
        in capsys.readouterr().err
    )


def test_a_bag_with_schemas_of_the_mcap_library(tmp_path):
    """Without metadata.yaml, in one file."""
    with foreign.writing(tmp_path / "x.mcap") as bag:
        for t, topic, kind, message in [*pushes()[:1], *poses(), *pushes()[1:]]:
            bag.add(topic, kind, message, t)
    assert largest(compare(tmp_path / "x.mcap", scene(tmp_path))) < STAMP
