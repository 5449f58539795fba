# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws that every answer obeys, and independent optimisers on random scenes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize, nnls
from scipy.spatial.transform import Rotation

from rb_sim.equilibrium.statics import solve
from rb_sim.equilibrium.statics_of_scene import at_rest
from rb_sim.scene.load import load_statics
from tests.equilibrium.scenes import UP, ladder, moved, scaled, table

QUICK = settings(max_examples=8, deadline=None, derandomize=True)
seeds = st.integers(0, 2**32 - 1)


def feet(rng, count):
    """Feet around the origin, so that a load near it can be carried."""
    angles = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    radii = rng.uniform(0.5, 1.5, count)
    heights = rng.uniform(-0.2, 0.2, count)
    return [
        [float(r * np.cos(a)), float(r * np.sin(a)), float(h)]
        for r, a, h in zip(radii, angles, heights, strict=True)
    ]


def random_table(rng, count, friction):
    load = [*rng.uniform(-10.0, 10.0, 2), -100.0]
    at = rng.uniform(-0.15, 0.15, 3)
    if friction == "smooth":
        load[:2] = [0.0, 0.0]
    return table(feet(rng, count), map(float, load), map(float, at), friction)


def stacked(rng):
    """A plate on three rough feet carrying a second body by a hinge, a strut and a tight string."""
    lower, upper = feet(rng, 3), rng.uniform(-0.4, 0.4, 3)
    contact = {"type": "contact", "body": "plate", "normal_A": UP, "friction": 0.6}
    return {
        "bodies": {
            "plate": {"mass": 3.0, "center_of_mass": [0.05, -0.02, 0.1]},
            "mast": {
                "mass": 1.0,
                "center_of_mass": [0.0, 0.0, 0.5],
                "position": upper.tolist(),
                "orientation": {"axis": rng.normal(size=3).tolist(), "angle": 0.4},
            },
        },
        "supports": {
            **{f"foot{i}": contact | {"point_B": p} for i, p in enumerate(lower)},
            "hinge": {"type": "hinge", "body": "mast", "parent": "plate"},
            "strut": {
                "type": "rod",
                "body": "mast",
                "parent": "plate",
                "point_B": [0.0, 0.0, 1.0],
                "point_A": [1.0, 0.3, 0.0],
            },
            "stay": {
                "type": "rod",
                "body": "mast",
                "parent": "plate",
                "point_B": [0.0, 0.1, 1.0],
                "point_A": [-0.5, 1.0, 0.0],
            },
            "guy": {
                "type": "rod",
                "body": "mast",
                "point_B": [0.1, 0.0, 0.7],
                "point_A": [-0.8, -0.9, 0.0],
            },
        },
        "loads": {
            "weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]},
            "wind": {
                "type": "wrench",
                "body": "mast",
                "frame": "body",
                "point_B": [0.0, 0.0, 0.8],
                "force": [0.5, 0.2, 0.0],
                "torque": [0.0, 0.1, 0.0],
            },
        },
    }


SCENES = st.sampled_from(
    [
        lambda rng: random_table(rng, 3, "smooth"),
        lambda rng: random_table(rng, 4, "smooth"),
        lambda rng: random_table(rng, 3, 0.4),
        lambda rng: ladder(rng.uniform(0.9, 1.4), 0.4, 0.25),
        stacked,
    ]
)


def random_turn(rng):
    return Rotation.from_quat(rng.normal(size=4))


@QUICK
@given(SCENES, seeds)
def test_turning_and_shifting_the_world_turns_and_shifts_the_answer(make, seed):
    rng = np.random.default_rng(seed)
    scene = make(rng)
    turn, shift = random_turn(rng), rng.uniform(-3.0, 3.0, 3)
    here, there = (solve(load_statics(s), ranges=False) for s in (scene, moved(scene, turn, shift)))
    assert here.verdict == there.verdict
    assert here.reactions.keys() == there.reactions.keys()
    biggest = max((np.abs(r.force).max() for r in here.reactions.values()), default=1.0)
    for name, reaction in here.reactions.items():
        other = there.reactions[name]
        assert other.anchor == pytest.approx(turn.apply(reaction.anchor) + shift, abs=1e-12)
        assert other.force == pytest.approx(turn.apply(reaction.force), abs=1e-9 * biggest)
        assert other.torque == pytest.approx(turn.apply(reaction.torque), abs=1e-9 * biggest)


@QUICK
@given(SCENES, seeds, st.floats(1e-6, 1e6))
def test_scaling_the_loads_scales_the_answer(make, seed, factor):
    scene = make(np.random.default_rng(seed))
    one, many = (solve(load_statics(s), ranges=False) for s in (scene, scaled(scene, factor)))
    assert one.verdict == many.verdict
    assert many.margin == pytest.approx(one.margin, rel=1e-9, nan_ok=True)
    biggest = max((np.abs(r.force).max() for r in one.reactions.values()), default=1.0)
    for name, reaction in one.reactions.items():
        expected = pytest.approx(factor * reaction.force, abs=1e-9 * factor * biggest)
        assert many.reactions[name].force == expected


@QUICK
@given(SCENES, seeds)
def test_balance_closes_and_reactions_are_admissible(make, seed):
    scene = load_statics(make(np.random.default_rng(seed)))
    result = solve(scene, ranges=False)
    assume(result.reactions)
    biggest = max(np.abs(r.force).max() for r in result.reactions.values())
    for force, torque in result.balance.values():
        assert np.abs(force).max() <= 1e-12 * biggest
        assert np.abs(torque).max() <= 1e-12 * biggest * 3.0
    for reaction in result.reactions.values():
        if reaction.kind in ("string", "contact"):
            assert reaction.along >= 0.0
        if reaction.friction is not None:
            across = reaction.force - reaction.along * reaction.direction
            allowed = reaction.friction * reaction.along
            assert np.linalg.norm(across) <= allowed + 1e-12 * biggest
        (_, _, force, torque), (_, _, back, back_torque) = reaction.ends()
        assert (force == -back).all() and (torque == -back_torque).all()


def test_action_is_reaction_seen_from_each_body_alone():
    """Each body of a pair, cut free and given its partner's reaction as a load, rests as before."""
    rng = np.random.default_rng(3)
    scene = stacked(rng)
    result = solve(load_statics(scene))
    assert result.reactions
    mast = {
        "bodies": {"mast": scene["bodies"]["mast"]},
        "supports": {"clamp": {"type": "weld", "body": "mast"}},
        "loads": {
            "weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]},
            "wind": scene["loads"]["wind"],
        },
    }
    total = np.zeros(6)
    origin = np.array(scene["bodies"]["mast"]["position"])
    for name in ("hinge", "strut", "stay", "guy"):
        reaction = result.reactions[name]
        arm = np.cross(reaction.anchor - origin, reaction.force)
        total += np.concatenate([reaction.force, reaction.torque + arm])
    clamp = solve(load_statics(mast)).reactions["clamp"]
    assert total[:3] == pytest.approx(clamp.force, abs=1e-11)
    assert total[3:] == pytest.approx(clamp.torque, abs=1e-11)


@QUICK
@given(seeds, st.integers(4, 7))
def test_smooth_feet_agree_with_nnls_and_a_linear_program(seed, count):
    scene = load_statics(random_table(np.random.default_rng(seed), count, "smooth"))
    system = at_rest(scene)
    result = solve(scene)
    least = linprog(np.ones(count), A_eq=system.matrix, b_eq=-system.load)
    assert (least.status == 0) == (result.verdict != "no equilibrium")
    assume(result.verdict == "indeterminate")
    for i, name in enumerate(result.reactions):
        for sign, end in ((1.0, 0), (-1.0, 1)):
            cost = np.zeros(count)
            cost[i] = sign
            best = linprog(cost, A_eq=system.matrix, b_eq=-system.load)
            assert result.ranges[name].along[end] == pytest.approx(sign * best.fun, abs=1e-7)
    # least norm under N >= 0, by the normal equations of a heavily weighted balance
    weight = 1e6
    stacked_matrix = np.vstack([weight * system.matrix, np.eye(count)])
    target = np.concatenate([-weight * system.load, np.zeros(count)])
    normals, _ = nnls(stacked_matrix, target)
    found = [reaction.along for reaction in result.reactions.values()]
    assert found == pytest.approx(normals, abs=1e-6)


@settings(max_examples=4, deadline=None, derandomize=True)
@given(seeds)
def test_friction_ranges_agree_with_a_general_optimiser(seed):
    rng = np.random.default_rng(seed)
    scene = load_statics(random_table(rng, 3, 0.4))
    system, result = at_rest(scene), solve(scene)
    assume(result.verdict == "indeterminate")
    u = system.matrix.shape[1]
    least = np.linalg.lstsq(system.matrix, -system.load, rcond=None)[0]
    inside = np.tile([np.linalg.norm(system.load), 0.0, 0.0], u // 3)  # of every cone

    def cones(x):
        blocks = x.reshape(-1, 3)
        return 0.16 * blocks[:, 0] ** 2 - blocks[:, 1] ** 2 - blocks[:, 2] ** 2

    constraints = [
        {"type": "eq", "fun": lambda x: system.matrix @ x + system.load},
        {"type": "ineq", "fun": cones},
        {"type": "ineq", "fun": lambda x: x.reshape(-1, 3)[:, 0]},
    ]
    name, column = "N1", system.columns[0]
    for axis in range(3):
        row = np.zeros(u)
        row[column] = system.elements[0].force_W[axis]
        for sign, end in ((1.0, 0), (-1.0, 1)):
            tried = (
                minimize(
                    lambda x, row=row, sign=sign: sign * row @ x,
                    start,
                    constraints=constraints,
                    method="SLSQP",
                    options={"ftol": 1e-12, "maxiter": 500},
                )
                for start in (least, inside, least + inside)
            )
            best = next((found for found in tried if found.success), None)
            assert best is not None  # SLSQP gives up from one start or another
            assert result.ranges[name].force[axis, end] == pytest.approx(sign * best.fun, abs=1e-4)


def test_two_way_supports_give_the_pseudo_inverse():
    """A plate on two welds: six states of self-stress, nothing one-way: plain least norm in SI."""
    rng = np.random.default_rng(7)
    welds = {
        f"weld{i}": {"type": "weld", "body": "plate", "point_B": rng.normal(size=3).tolist()}
        for i in range(2)
    }
    load = {
        "type": "wrench",
        "body": "plate",
        "force": rng.normal(size=3).tolist(),
        "torque": rng.normal(size=3).tolist(),
    }
    scene = load_statics({"bodies": {"plate": {}}, "supports": welds, "loads": {"load": load}})
    system, result = at_rest(scene), solve(scene)
    plain = -np.linalg.pinv(system.matrix) @ system.load
    found = np.concatenate([np.r_[r.force, r.torque] for r in result.reactions.values()])
    assert result.verdict == "indeterminate" and result.indeterminacy == 6
    assert found == pytest.approx(plain, rel=1e-11, abs=1e-12)
    assert np.isinf(result.ranges["weld0"].force).all()
