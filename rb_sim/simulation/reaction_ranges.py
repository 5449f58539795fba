# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Ranges of reactions that the equations of motion do not determine, at a sample of a run.

By d'Alembert's principle inertia forces are loads (LL 38.2). The reactions of the sample balance
them; so do all other reactions with the same resultant on every body that satisfy the contact laws.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.catalogue.contact import Touching
from rb_sim.catalogue.spec import WORLD, BodyState
from rb_sim.equilibrium.equilibrium import (
    Array,
    Element,
    Equilibrium,
    points_of_application,
    poles_of,
    put_together,
)
from rb_sim.equilibrium.statics import solved
from rb_sim.equilibrium.statics_of_scene import (
    Standing,
    at_zero_velocity,
    joint_elements,
    touching_elements,
)
from rb_sim.equilibrium.statics_tables import ReactionRange
from rb_sim.scene.place import InitialPlace, quaternion, vector

if TYPE_CHECKING:
    from rb_sim.simulation.trajectory import Trajectory

OPEN, SLIP = 0, 1
"""Values of Trajectory.contact_state."""

BALANCED = 1e-8
"""Tolerance of the balance of a sample, relative to the largest load: its pose has the error of a
run, and contacts are closed within about 1e-9."""


def reaction_ranges(run: Trajectory, sample: int = -1) -> dict[str, ReactionRange]:
    """Smallest and largest value of each component of each reaction at one sample of a run.

    If both are equal, the motion determines the component; infinite: unbounded. Contacts that stick
    stay within their friction limit, friction of those that slip is against the slip.

    Args:
        run: Run of a scene.
        sample: Number of the sample; negative: from the end.

    Returns:
        Ranges of force [N] and torque about the anchor [N m], world axes, shape (3, 2) each.

    Raises:
        RbSimError: The scene is not known, there is no such sample, or the method is time_stepping
            (its reactions are averages over a step).
    """
    if run.scene is None:
        raise RbSimError("reaction_ranges: the scene of the run is not known")
    if run.scene.simulation.method == "time_stepping":
        raise RbSimError("reaction_ranges: method time_stepping reports averages over a step")
    run.state(sample)  # refuses an invalid sample
    found: dict[str, ReactionRange] = {}
    for whole in (True, False) if any("/" in name for name in run.layout.reactions) else (False,):
        result = solved(equilibrium_at(run, sample, whole), tolerance=BALANCED)
        if result.verdict == "no equilibrium":
            raise RbSimError(
                f"reaction_ranges: at t = {run.t[sample]:g} s the contacts found closed do not "
                f"carry the reactions of the sample: {result.explanation}"
            )
        found |= result.ranges
    return {name: found[name] for name in run.layout.reactions if name in found}


def equilibrium_at(run: Trajectory, sample: int, whole: bool) -> Equilibrium:
    """Statics problem of the supports in their pose at a sample, loaded by the resultant of its
    reactions.

    whole: a joint with several reactions is one support, represented by its total.
    """
    bodies, states = run.layout.bodies, states_at(run, sample)
    elements = tuple(elements_at(run, sample, states, whole))
    centres = np.array([states[name].p_WC for name in bodies])
    points = points_of_application(bodies, centres, elements)
    poles, loads = poles_of(bodies, points), np.zeros((len(bodies), 6))
    for element in elements:
        reaction = run.reaction[element.name]
        force, torque = reaction.force[sample], reaction.torque[sample]
        for body, sign in ((element.body, -1.0), (element.parent, 1.0)):
            if body is not None:
                row = bodies.index(body)
                loads[row, :3] += sign * force
                arm = reaction.anchor[sample] - poles[row]
                loads[row, 3:] += sign * (torque + np.cross(arm, force))
    return put_together(bodies, elements, points, loads, centres)


def states_at(run: Trajectory, sample: int) -> dict[str, BodyState]:
    """The poses of the bodies at a sample, with zero velocities."""
    block, none = run.block, (0.0, 0.0, 0.0)
    return {
        name: at_zero_velocity(BodyState(
            vector(block.position[sample, i]), quaternion(block.orientation[sample, i]), none, none
        ))
        for i, name in enumerate(run.layout.bodies)
    }  # fmt: skip


def elements_at(
    run: Trajectory, sample: int, states: dict[str, BodyState], whole: bool
) -> Iterator[Element]:
    """Support elements of a sample: joints, and contacts that are closed."""
    place, constraints = InitialPlace(run.scene), dict[str, Any](run.scene.constraints)
    length = float(max(np.abs(run.block.position).max(initial=0.0), 1.0))
    for name, spec in constraints.items():
        parent = getattr(spec, "parent", None)
        B, A = states[spec.body], WORLD if parent is None else states[parent]
        if not isinstance(spec, Touching):
            yield from joint_elements(name, spec, place, B, A, whole=whole)
            continue
        for element in touching_elements(Standing(place, name, spec, B, A, length)).closed:
            state = int(run.contact_state[element.name][sample])
            if state == SLIP and element.has_friction:
                yield sliding(element, run.reaction[element.name].force[sample])
            elif state != OPEN:
                yield element


def sliding(element: Element, force: Array) -> Element:
    """The element of a slipping contact: one unknown, along the contact force of the sample."""
    normal = element.force_W[:, :1] if element.normal_W is None else None
    normal_force = None if normal is None else float(force @ normal[:, 0])
    if not normal_force:
        return replace(element, given_W=force, force_W=np.zeros((3, 0)),
                       torque_W=np.zeros((3, 0)), bounds=(), law="two-way",
                       normal_W=element.direction)  # fmt: skip
    line = np.array(force)[:, None] / normal_force
    return replace(element, force_W=line, torque_W=np.zeros((3, 1)), bounds=())
