"""Balances that pass their bounds, on ledgers by hand; and the wrench from outside by formulas."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.checks.balance import (
    Impulses,
    bodies_at_work,
    ends_of_tables,
    external_wrench,
    jumps_of_tables,
    liveliest,
    may_work,
    unknown_force,
)
from rb_sim.checks.check import Effort
from rb_sim.mechanics.samples import SampleLayout
from rb_sim.scene.load import scene_from_mapping
from tests.checks.blocks import Block

RUN = Effort("rk4", 0.1, None, 100)
"""A bound of 1e-3 on balances, and of 1e-2 on those of momentum."""
NAMES = SampleLayout(("a", "b"), (), (), ())
SAMPLES: Any = Block(
    [0.0, 1.0, 2.0],
    energy=[1.0, 1.0, 1.0],
    linear_velocity=[[[5, 0, 0], [0, 0, 1]], [[0, 3, 0], [0, 4, 0]], [[2, 0, 0], [0, 0, 0]]],
    angular_velocity=[[[0, 0, 0], [0, 0, 3]], [[3, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 3, 0]]],
)


def test_the_body_that_moves_most() -> None:
    """By speed and spin: 5 beside 1 + 3, 3 + 3 beside 4 + 1, 2 beside 3."""
    assert [liveliest(SAMPLES, NAMES, i) for i in range(3)] == ["a", "a", "b"]
    blown: Any = Block(**vars(SAMPLES))
    blown.linear_velocity[0, 1, 0] = np.nan
    assert liveliest(blown, NAMES, 0) == "b"


BODY = {"mass": 2.0, "inertia": [0.1, 0.2, 0.25]}
OFFSET = {"mass": 3.0, "inertia": [0.1, 0.2, 0.25], "center_of_mass": [0.1, -0.2, 0.3]}
SPRING = {"type": "spring", "body": "b", "parent": "a", "stiffness": 9.0}


def scene_of(effects: dict[str, Any], **constraints: Any) -> Any:
    bodies = {"a": BODY, "b": OFFSET | {"position": [1.0, 2.0, 3.0]}}
    return scene_from_mapping({"bodies": bodies, "effects": effects, "constraints": constraints})


def drawn(seed: int, reactions: int = 0) -> Any:
    """Two samples of both bodies, with reactions and a command on b."""
    rng = np.random.default_rng(seed)
    block: Any = Block(
        [0.0, 1.0],
        position=rng.normal(size=(2, 2, 3)),
        orientation=Rotation.random(4, random_state=seed).as_quat().reshape(2, 2, 4),
        command=rng.normal(size=(2, 1, 6)),
    )
    for name in ("reaction_force", "reaction_torque", "anchor"):
        setattr(block, name, rng.normal(size=(2, reactions, 3)))
    return block


def test_what_acts_from_outside_by_hand() -> None:
    """A weight, a wrench in body axes at a point of b, a command at the origin of b, the reaction
    of a joint to the world; not a spring or a joint between both, nor parts of a reaction."""
    g, f, tau, point = (np.array(v) for v in ([0, 1, -9.0], [1, 2, 3], [4, 5, -6], [0.3, 0.1, 2]))
    effects = {
        "weight": {"type": "gravity", "acceleration": g.tolist()},
        "jet": {
            "type": "wrench", "body": "b", "frame": "body", "point_B": point.tolist(),
            "force": f.tolist(), "torque": tau.tolist(),
        },
        "wind": {"type": "wrench", "body": "a", "force": f.tolist(), "torque": tau.tolist()},
        "joystick": {"type": "commanded_wrench", "body": "b"},
        "spring": SPRING,
    }  # fmt: skip
    pin = {"type": "fixed_point", "body": "a"}
    scene = scene_of(effects, pin=pin, link=pin | {"body": "b", "parent": "a"})
    names = SampleLayout(("a", "b"), ("pin", "link", "pin/A"), ("a", "b", "a"), ("b",))
    block = drawn(3, 3)
    found = external_wrench(block, scene, names)
    center = np.array(OFFSET["center_of_mass"])
    for k in range(2):
        turn, (p_a, p_b) = Rotation.from_quat(block.orientation[k, 1]), block.position[k]
        at, origin = p_b + turn.apply(point - center), p_b - turn.apply(center)
        push, pull = block.command[k, 0, :3], block.reaction_force[k, 0]
        force = 5.0 * g + turn.apply(f) + f + push + pull
        torque = np.cross(2.0 * p_a + 3.0 * p_b, g) + np.cross(at, turn.apply(f)) + turn.apply(tau)
        torque += np.cross(p_a, f) + tau + np.cross(origin, push) + block.command[k, 0, 3:]
        torque += np.cross(block.anchor[k, 0], pull) + block.reaction_torque[k, 0]
        assert_allclose(found[k], [*force, *torque], rtol=1e-13, atol=1e-12)


def test_a_weight_of_one_body_alone() -> None:
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -1.0], "bodies": ["b"]}
    names, block = SampleLayout(("a", "b"), (), (), ()), drawn(4)
    found = external_wrench(block, scene_of({"weight": weight}), names)
    arms = np.cross(block.position[:, 1], [0.0, 0.0, -3.0])
    assert_allclose(found, np.hstack([[[0.0, 0.0, -3.0]] * 2, arms]), atol=1e-15)


def momentum_block(t: Any, p: Any) -> Any:
    """Of bodies on which a weight of 5 N acts where they are, at x = 1 m."""
    n = len(t)
    turning = np.outer(np.array(t) - t[0], [0.0, 5.0, 0.0]) + [0.0, 0.0, 7.0]
    block: Any = Block(t, momentum=p, angular_momentum=turning)
    block.position = np.tile([[1.0, 0.0, 0.0]], (n, 2, 1))
    block.reaction_force = block.reaction_torque = block.anchor = np.zeros((n, 0, 3))
    return block


def test_momentum_less_impulse_is_what_no_weight_explains() -> None:
    """-5 N over 1 s along z, and as much about -y; what momentum changes by beside that, 1 along x,
    is missed."""
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -1.0]}
    watch = Impulses(scene_of({"weight": weight}), NAMES)
    zero, t = [0.0, 0.0, 0.0], np.linspace(0.0, 1.0, 5)
    assert not watch.finish()[0].any()
    watch.add(momentum_block(t, np.outer(t, [1.0, 0.0, -5.0])))
    missed, impulse, doubt = watch.finish()
    assert_allclose(missed, [1.0, *zero, 0.0, 0.0], atol=1e-12)
    assert_allclose(impulse, [0.0, 0.0, -5.0, 0.0, 5.0, 0.0], atol=1e-12)
    assert_allclose(doubt, 0.0, atol=1e-12)
    assert_allclose(watch.largest, [np.hypot(1.0, 5.0), np.hypot(5.0, 7.0)])


def test_what_nothing_acts_on_keeps_its_momentum() -> None:
    watch = Impulses(scene_of({}), NAMES)
    watch.add(momentum_block([0.0, 1.0], [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    watch.add(momentum_block([4.0, 5.0], [[1.0, 2.0, 0.0], [1.0, 2.0, 0.0]]))
    assert_allclose(watch.finish()[0], [0.0, 2.0, 0.0, 0.0, 5.0, 0.0])


TABLE = {"type": "wrench_table", "body": "a", "forces": [[1, 0, 0]] * 3}


def test_what_a_scene_says_of_its_loads() -> None:
    tables = {
        "late": TABLE | {"times": [0.5, 1.0, 3.0]},
        "soon": TABLE | {"times": [0.0, 1.0, 2.0]},
    }
    scene = scene_of(tables)
    assert jumps_of_tables(scene) == [0.0, 0.5, 1.0, 2.0, 3.0]
    assert sorted(ends_of_tables(scene)) == [2.0, 3.0]
    assert may_work(scene) and bodies_at_work(scene) == ["a"] and unknown_force(scene) == "late"
    hinge = {"type": "fixed_axis", "body": "a", "axis_B": [0.0, 0.0, 1.0]}
    assert not may_work(scene_of({}, hinge=hinge)) and bodies_at_work(scene_of({})) == []
    quiet = scene_of({"weight": {"type": "gravity"}, "spring": SPRING})
    assert not may_work(quiet) and bodies_at_work(quiet) == [] and unknown_force(quiet) == ""
    damped = scene_of({"spring": SPRING | {"damping": 0.1}})
    assert may_work(damped) and bodies_at_work(damped) == ["a", "b"]
    ball = {"type": "contact", "body": "a", "points": [[0.0, 0.0, 0.0]]}
    assert bodies_at_work(scene_of(tables, floor=ball)) == ["a"]
    drive = {"type": "velocity", "body": "a", "linear": [1.0, 0.0, 0.0], "rate": 2.0}
    assert bodies_at_work(scene_of({}, drive=drive)) is None and may_work(scene_of({}, drive=drive))
    ground = {k: v for k, v in SPRING.items() if k != "parent"}
    assert unknown_force(scene_of({"weight": {"type": "gravity"}, "ground": ground})) == "ground"


@pytest.mark.parametrize(
    ("sine", "known"),
    [({}, True), ({"sine_force": [1.0, 0, 0]}, False), ({"sine_torque": [0, 1.0, 0]}, False)],
)
def test_a_wrench_that_swings_is_not_told_by_samples(sine: dict[str, Any], known: bool) -> None:
    swing = {"angular_frequency": 2.0} if sine else {}
    wrench = {"type": "wrench", "body": "a", "force": [1.0, 0.0, 0.0]} | sine | swing
    assert unknown_force(scene_of({"push": wrench})) == ("" if known else "push")
