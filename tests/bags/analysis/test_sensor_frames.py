# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wrenches of a sensor that sits on a body: its frame, its clock, and where it is silent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.run import analyze
from tests.bags.analysis import foreign
from tests.bags.analysis.test_foreign import TF, T, transforms, writing

WRENCH = "geometry_msgs/msg/WrenchStamped"
C = np.array([0.1, -0.2, 0.3])
BODY = Body(2.0, np.diag([0.1, 0.2, 0.3]), C)
SPIN = 0.8
FLANGE = np.array([0.0, 0.4, 0.1]), Rotation.from_rotvec([0.5, 0.0, 0.2])
SENSOR = np.array([0.3, 0.0, -0.1]), Rotation.from_rotvec([0.0, -1.0, 0.4])


def stamped(t: float, frame: str, force: np.ndarray, torque: np.ndarray):
    types = foreign.STORE.types
    vectors = [types["geometry_msgs/msg/Vector3"](*map(float, v)) for v in (force, torque)]
    wrench = types["geometry_msgs/msg/Wrench"](force=vectors[0], torque=vectors[1])
    return types[WRENCH](header=foreign.header(t, frame), wrench=wrench)


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The swing's poses of the body's origin, and what it takes: m a_C in the body's axes, and no
    torque about C, as it turns about a principal axis at an even rate."""
    _, p, q = foreign.swing()
    turn = Rotation.from_quat(q)
    a = np.c_[-4.5 * np.sin(3.0 * T), 0 * T, 0 * T]
    a -= SPIN**2 * turn.apply(C * [1.0, 1.0, 0.0])
    return p, q, turn.inv().apply(BODY.mass * a)


def write(
    path: Path, frame: str, *, fixed: bool = True, moved: bool = False,
    clock: float = 0.0, silent: tuple[float, float] = (0.0, 0.0),
) -> Path:  # fmt: skip
    """base_link moves in odom; flange and sensor are fixed to it one behind the other.

    clock: by how much the sensor's is ahead [s]; silent: from when to when it says nothing.
    """
    p, q, force = motion()
    turn = FLANGE[1] * SENSOR[1]
    r = FLANGE[0] + FLANGE[1].apply(SENSOR[0])
    f, k = turn.inv().apply(force), turn.inv().apply(np.cross(C - r, force))
    with writing(path) as bag:
        for child, (at, way), parent in (("ft_sensor", SENSOR, "flange"),
                                         ("flange", FLANGE, "base_link")) * fixed:  # fmt: skip
            entry = (parent, child, at, way.as_quat())
            bag.add("/tf_static", TF, transforms(0.0, entry), 0.0)
        if moved:
            entry = ("base_link", "flange", FLANGE[0] + 0.1, FLANGE[1].as_quat())
            bag.add("/tf_static", TF, transforms(0.0, entry), 0.0)
        for i, t in enumerate(T):
            if not silent[0] < t < silent[1]:
                bag.add("/push", WRENCH, stamped(t + clock, frame, f[i], k[i]), t)
            bag.add("/tf", TF, transforms(t, ("odom", "base_link", p[i], q[i])), t)
    return path


@pytest.mark.parametrize("frame", ["ft_sensor", "/ft_sensor"])
def test_a_wrench_is_carried_over_to_its_body(tmp_path, frame):
    """Forces turned, torques about the body's origin: energy and both momenta balance."""
    found = analyze(write(tmp_path / "x.mcap", frame), masses={"base_link": BODY})
    (balance,) = found.balances.values()
    assert balance["wrenches"] == ["/push"]
    assert abs(balance["energy"]["error"]) < 1e-4 * balance["energy"]["scale"]
    for part in ("linear", "angular"):
        told = balance["momentum"][part]
        assert told["error"] < 1e-4 * told["scale"]
    line = "/push: carried over to the frame base_link by static transforms"
    assert line in found.notes


@pytest.mark.parametrize("wrong", [{"fixed": False}, {"moved": True}])
def test_without_one_transform_it_is_left_out(tmp_path, wrong):
    bag = write(tmp_path / "x.mcap", "ft_sensor", **wrong)
    found = analyze(bag, masses={"base_link": BODY})
    assert "/push: not in the balance: neither its frame nor its topic names a body" in found.notes
    (balance,) = found.balances.values()
    assert not balance["wrenches"]
    assert balance["momentum"]["linear"]["error"] > 0.1


def test_the_nearest_body_above_takes_it(tmp_path):
    """The flange is a body of its own: what acts on it does not act on the base."""
    bag = write(tmp_path / "x.mcap", "ft_sensor")
    found = analyze(bag, masses={"base_link": BODY, "flange": BODY})
    told = {name: balance["wrenches"] for name, balance in found.balances.items()}
    assert told == {"base_link": [], "flange": ["/push"]}


@pytest.mark.parametrize("clock", [3.0, -1.0, -float(foreign.EPOCH)])
def test_another_clock_is_told(tmp_path, clock):
    """Stamps that are ahead, behind, or count from zero where the poses' count from the epoch."""
    bag = write(tmp_path / "x.mcap", "ft_sensor", clock=clock)
    found = analyze(bag, masses={"base_link": BODY})
    (line,) = [note for note in found.notes if note.startswith("stamps of different clocks")]
    assert f"/push lie {-clock:.6g} s" in line or f"/push {-clock:.6g} s" in line
    count = {3.0: 300, -1.0: 100}.get(clock, 400) - 4  # the filter takes four at either end
    (line,) = [note for note in found.notes if note.startswith("/push: no reading near")]
    assert abs(int(line.split()[4]) - count) <= 8 and "of 392 instants" in line


def test_a_sensor_that_is_silent_for_a_while_is_told(tmp_path):
    bag = write(tmp_path / "x.mcap", "ft_sensor", silent=(1.0, 2.0))
    found = analyze(bag, masses={"base_link": BODY})
    (line,) = [note for note in found.notes if note.startswith("/push: no reading near")]
    assert "no reading near 99 of 392 instants" in line
    assert not any("clock" in note for note in found.notes)
