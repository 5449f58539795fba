# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What must hold in every run with contacts, from its samples alone.

Energy less the contacts' work is constant; between samples without an event the momenta of each
body change by what the reported reactions, the springs and gravity give (Simpson's rule); a contact
never pulls nor overlaps, its traction keeps to the law of friction, and works against the slip.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.contact.depths import depth_of
from benchmarks.contact.loads import loads, power, velocity_of
from benchmarks.contact.normals import normal_of
from benchmarks.contact.shapes import size_of

GAINED = 1e-6
"""Change of energy less work of contacts, over the largest kinetic energy and that of the fall."""
COARSE = 0.05
"""The same of a fixed step."""
KICKED = 2e-3
"""Change of momentum that no force gives, over that of the forces between three samples."""
ROUNDED = 1e-8
"""Change of momentum, over its largest and that at 1 m/s, that the method's error leaves."""
PULLED = 1e-6
"""Pull, or traction beyond its bound, over the scene's forces."""
DEEP = 1e-8
"""Residual, over the scene's scale, that is none."""
NEAR = 3
"""Samples on either side among which loads may bend as much as there."""
SLOW = 1e-5
"""Slip whose direction is not looked at [m/s]."""
Problems = list[str]


def broken(mapping: dict[str, Any], trajectory: Any) -> Problems:
    """What does not hold, a line each."""
    method = mapping["simulation"].get("method", "")
    loose = method == "time_stepping"
    worked = power(mapping, trajectory)
    if worked.any():
        out = [] if method else works(trajectory, worked)
    else:
        out = energy(trajectory, loose, COARSE if method else GAINED)
    if method:  # what a fixed step leaves is the user's choice, and told by the checks
        return out
    soft = [c for c in mapping["constraints"].values() if "compliance" in c]
    worst = float(trajectory.residual.max())
    if not soft and not worst <= DEEP:
        out.append(f"residual {worst:.2g}")
    for name in trajectory.layout.bodies:
        out += momenta(mapping, trajectory, name)
    for name, contact in mapping["constraints"].items():
        if contact["type"] == "contact":
            out += laws(name, contact, mapping, trajectory)
            out += sunk(name, contact, mapping, trajectory)
    return out


def sunk(name: str, contact: Any, mapping: Any, trajectory: Any) -> Problems:
    """A body whose shape lies deeper in its support than rounding leaves, sides and faces too."""
    shape = mapping["bodies"][contact["body"]].get("shape")
    if shape is None or "points" in contact or "compliance" in contact:
        return []
    depth = depth_of(contact, mapping, trajectory)
    worst = int(depth.argmax())
    share = float(depth[worst]) / size_of(shape)
    if share <= DEEP:
        return []
    return [f"{name} sinks by {share:.2g} of the body's size at t = {trajectory.t[worst]:.6g} s"]


def energy(trajectory: Any, loose: bool, allowed: float) -> Problems:
    """Nothing but the contacts' work changes it; a step of impulses may only lose more."""
    left = trajectory.energy - trajectory.contact_work
    size = float(trajectory.block.kinetic_energy.max() + np.ptp(trajectory.block.potential_energy))
    change = float((left - left[0]).max() if loose else np.abs(left - left[0]).max())
    if change <= allowed * max(size, ROUNDED * float(np.abs(trajectory.energy).max())):
        return []
    return [f"energy changes by {change:.2g} J of {size:.3g} J"]


def works(trajectory: Any, worked: Any) -> Problems:
    """Between samples without an event, energy less the contacts' work changes by what is worked
    [W]."""
    left, at = trajectory.energy - trajectory.contact_work, quiet(trajectory)
    h = trajectory.t[at + 1] - trajectory.t[at]
    given = (worked[at] + 4.0 * worked[at + 1] + worked[at + 2]) * (h / 3.0)
    bends = np.abs(worked[:-2] - 2.0 * worked[1:-1] + worked[2:])
    bent = maximum_filter1d(bends, 2 * NEAR + 1)[at] * h
    missing = np.abs(left[at + 2] - left[at] - given)
    size = float(np.abs(worked).max())
    share = missing / (KICKED * np.abs(worked[at]) * h + bent + GAINED * size * h + ROUNDED)
    worst = int(share.argmax()) if len(at) else 0
    if not len(at) or share[worst] <= 1.0:
        return []
    where = f"at t = {trajectory.t[at[worst]]:.6g} s"
    return [f"energy changes by {missing[worst]:.2g} J more than is worked {where}"]


def quiet(trajectory: Any) -> Any:
    """First of three samples in a row without an event among them."""
    t = trajectory.t
    h = np.diff(t)
    even = np.abs(h[1:] - h[:-1]) < 1e-9
    for event in trajectory.events:
        even &= (event.t < t[:-2] - 1e-9) | (event.t > t[2:] + 1e-9)
    return np.flatnonzero(even)


def wrenches(mapping: Any, trajectory: Any, name: str) -> tuple[Any, Any]:
    """Force, and torque about the centre of mass, of all that acts on a body."""
    b, layout = trajectory.block, trajectory.layout
    p = trajectory.position[name]
    force, torque = loads(mapping, trajectory, name)
    many = {n.split("/")[0] for n in layout.reactions if "/" in n}
    for i, reaction in enumerate(layout.reactions):
        base = reaction.split("/")[0]
        row = mapping["constraints"][base]
        if base in many and reaction == base:
            continue  # its points, or bearings, are added one by one
        f, m, at = b.reaction_force[:, i], b.reaction_torque[:, i], b.anchor[:, i]
        for who, sign in ((layout.reaction_bodies[i], 1.0), (row.get("parent"), -1.0)):
            if who == name:
                force += sign * f
                torque += sign * (m + np.cross(at - p, f))
    return force, torque


def momenta(mapping: Any, trajectory: Any, name: str) -> Problems:
    """Newton and Euler, integrated over three samples."""
    out, at = [], quiet(trajectory)
    if not len(at):
        return out
    own, h = mapping["bodies"][name], trajectory.t[at + 1] - trajectory.t[at]
    force, torque = wrenches(mapping, trajectory, name)
    turn = Rotation.from_quat(trajectory.orientation[name])
    spin = trajectory.angular_velocity[name] @ tensor(own).T
    for what, momentum, load in (
        ("linear", own["mass"] * trajectory.linear_velocity[name], force),
        ("angular", turn.apply(spin), torque),
    ):
        given = (load[at] + 4.0 * load[at + 1] + load[at + 2]) * (h / 3.0)[:, None]
        # where a slow slip turns about, loads bend more than samples tell
        bends = np.abs(load[:-2] - 2.0 * load[1:-1] + load[2:]).sum(axis=1)
        bent = maximum_filter1d(bends, 2 * NEAR + 1)[at] * h
        size = np.abs(load).sum(axis=1)[at] * h + np.median(np.abs(load).sum(axis=1)) * h
        missing = np.abs(momentum[at + 2] - momentum[at] - given).sum(axis=1)
        rounding = ROUNDED * (np.abs(momentum).max() + own["mass"])
        share = missing / (KICKED * size + bent + rounding)
        worst = int(share.argmax())
        if share[worst] > 1.0:
            where = f"at t = {trajectory.t[at[worst]]:.6g} s"
            out.append(
                f"{what} momentum of {name} changes by {missing[worst]:.2g} more than "
                f"forces give {where} ({size[worst]:.2g})"
            )
    return out


def tensor(own: Any) -> Any:
    """Inertia about the centre of mass; of a homogeneous shape where none is given."""
    if "inertia" in own:
        given = np.array(own["inertia"])
        return np.diag(given) if given.ndim == 1 else given
    mass, shape = own["mass"], own["shape"]
    if shape["type"] == "sphere":
        squares = np.full(3, 0.2 * shape["radius"] ** 2)
    elif shape["type"] == "ellipsoid":
        squares = 0.2 * np.array(shape["semi_axes"]) ** 2
    elif shape["type"] == "box":
        squares = np.array(shape["size"]) ** 2 / 12.0
    else:
        length = shape.get("length", 0.0)
        r = shape.get("radius", 1e-3 * length)  # a rod that has none is not quite thin
        axis = np.array(shape["axis_B"])
        along = (length * length / 12.0 - r * r / 4.0) * np.outer(axis, axis)
        square = r * r / 4.0 * np.eye(3) + along
        return mass * (np.trace(square) * np.eye(3) - square)
    return mass * np.diag(squares.sum() - squares)


def laws(name: str, contact: Any, mapping: Any, trajectory: Any) -> Problems:
    """Push, bound of friction and its direction, at each point that has an own reaction."""
    out: Problems = []
    many = [n for n in trajectory.layout.reactions if n.startswith(name + "/")]
    for point in many or [name]:
        reaction = trajectory.reaction[point]
        n = normal_of(contact, mapping, trajectory, reaction.anchor)
        push = np.sum(reaction.force * n, axis=1)
        traction = reaction.force - push[:, None] * n
        size = float(np.median(np.abs(push[push != 0.0]))) if (push != 0.0).any() else 0.0
        if float(push.min()) < -PULLED * max(size, 1e-9):
            i = int(push.argmin())
            out.append(f"{point} pulls with {push[i]:.2g} N at t = {trajectory.t[i]:.6g} s")
        out += friction(point, contact, trajectory, (reaction.anchor, n, push, traction, size))
    return out


def friction(point: str, contact: Any, trajectory: Any, found: Any) -> Problems:
    """The traction is what the law says of the push and the slip."""
    anchor, n, push, traction, size = found
    law = contact.get("friction", {"type": "smooth"})
    slip = velocity_of(trajectory, contact["body"], anchor) - support_velocity(
        contact, trajectory, anchor
    )
    slip -= np.sum(slip * n, axis=1)[:, None] * n
    speed, pull = np.linalg.norm(slip, axis=1), np.linalg.norm(traction, axis=1)
    state = trajectory.contact_state[point]
    small = 1e-6 * max(size, 1e-9)
    if law["type"] == "coulomb":
        expected = law.get("kinetic", law["static"]) * push
        over = pull - law["static"] * push * (1.0 + 1e-6)
        wrong = np.where(state == 2.0, over > small, False)
        slides = (state == 1.0) & (speed > SLOW)
        wrong |= slides & (np.abs(pull - expected) > small + 1e-6 * expected)
        along = np.sum(traction * slip, axis=1) / np.maximum(speed, 1e-300)
        wrong |= slides & (along > -expected * (1.0 - 1e-5) + small)
    elif law["type"] == "smooth":
        wrong = pull > small
    elif law["type"] == "rough":
        wrong = (push > small) & (speed > SLOW)
    else:
        if law["type"] == "regularised":
            factor = law["coefficient"] * push / np.hypot(speed, law["speed"])
        else:
            factor = law["coefficient"] * (push if law.get("per_normal") else (state > 0.0))
        expected = -factor[:, None] * slip
        wrong = np.linalg.norm(traction - expected, axis=1) > 1e-5 * pull + small
    wrong |= (state == 2.0) & (speed > SLOW)
    # a sample at an event shows the state before it, with the loads that end it
    own = [event.t for event in trajectory.events if event.contact == point]
    wrong &= ~np.isin(trajectory.t, own)
    if not wrong.any():
        return []
    i = int(wrong.argmax())
    return [
        f"{point} breaks its {law['type']} law at t = {trajectory.t[i]:.6g} s: state {state[i]:g}, "
        f"push {push[i]:.4g} N, traction {pull[i]:.4g} N, slip {speed[i]:.3g} m/s ({wrong.sum()} "
        "samples)"
    ]


def support_velocity(contact: Any, trajectory: Any, at: Any) -> Any:
    """Of the support's point that is there."""
    if contact.get("parent"):
        return velocity_of(trajectory, contact["parent"], at)
    motion = contact.get("motion")
    if motion is None:
        return np.zeros_like(at)
    if motion["type"] == "turntable":
        return np.cross([0.0, 0.0, motion["rate"]], at)
    w = 2.0 * np.pi * motion["frequency"]
    speed = motion["amplitude"] * w * np.cos(w * trajectory.t + motion.get("phase", 0.0))
    return speed[:, None] * np.array(motion["direction"])
