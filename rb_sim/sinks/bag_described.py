"""What a bag says of its scene and layout in the metadata record `rb_sim`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rb_sim.sinks.contact_power import contacts_of

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleLayout
    from rb_sim.scene.schema import Scene

FORMAT = "1"
"""Of the record; a reader refuses another one."""


def describe(scene: Scene, layout: SampleLayout) -> dict[str, str]:
    """What a reader needs to know of scene and layout, each value JSON but for plain text."""
    bodies = {
        name: {
            "mass": body.mass,
            "inertia": body.inertia.tolist(),
            "center_of_mass": list(body.center_of_mass),
            "shape": None if body.shape is None else body.shape.model_dump(mode="json"),
        }
        for name, body in scene.bodies.items()
    }
    names = layout._asdict()
    supports = describe_supports(scene)
    if not supports:
        del names["contacts"]
    return {
        "format": FORMAT,
        "name": scene.name,
        "description": scene.description,
        "scene": scene.text,
        "bodies": json.dumps(bodies),
        "layout": json.dumps(names),
        "simulation": json.dumps(scene.simulation.model_dump(mode="json")),
        **({"contacts": json.dumps(supports)} if supports else {}),
    }


def describe_supports(scene: Scene) -> dict[str, Any]:
    """Each contact's body, parent and surface."""
    return {
        name: {
            "body": spec.body,
            "parent": spec.parent,
            "surface": spec.surface.model_dump(mode="json"),
        }
        for name, spec in contacts_of(scene).items()
    }
