# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A reference case with contact -> a scene mapping in the form of our YAML."""

from __future__ import annotations

import numpy as np

from tests.oracles.to_scene import Case, Mapping, body_of, start_of


def surface_of(spec: Case) -> Mapping:
    """The support's surface."""
    kind = spec.get("surface", "plane")
    if kind == "cylinder_inside":
        sides = {"axis": spec["axis"], "point": spec["point"], "side": "inside"}
        return {"type": "cylinder", "radius": spec["radius"]} | sides
    if kind == "sphere_outside":
        return {"type": "sphere", "center": spec["center"], "radius": spec["radius"]}
    return {"type": "plane", "normal": spec["normal"], "point": spec["point"]}


def friction_of(case: Case) -> Mapping:
    """The friction law that the case states."""
    spec = case["constraint"]
    law = str(spec.get("friction", ""))
    if law.startswith("f = -mu*N*v_slip/sqrt"):
        return {"type": "regularised", "coefficient": spec["mu"], "speed": 0.01}
    if law.startswith("f = -mu*N*v_slip"):
        return {"type": "viscous", "coefficient": spec["mu"], "per_normal": True}
    if law == "smooth":
        return {"type": "smooth"}
    if spec.get("rough") or law == "perfectly rough":
        return {"type": "rough"}
    static = spec.get("mu_static", spec.get("mu"))
    return {"type": "coulomb", "static": static, "kinetic": spec.get("mu_kinetic", static)}


def contact_of(case: Case) -> Mapping:
    spec = case["constraint"]
    contact: Mapping = {
        "type": "contact",
        "body": "body",
        "surface": surface_of(spec),
        "friction": friction_of(case),
        "restitution": spec.get("restitution", 0.0),
        "rolling_resistance": spec.get("rolling_resistance_arm", 0.0),
    }
    if "table_angular_velocity" in spec:
        rate = float(np.linalg.norm(spec["table_angular_velocity"]))
        axis = (np.asarray(spec["table_angular_velocity"]) / rate).tolist()
        contact["motion"] = {"type": "turntable", "rate": rate, "axis": axis}
    return contact


def contact_scene(case: Case) -> Mapping:
    """The scene of a case of one body, named `body`, with the contact `floor`."""
    solid = case["body"]
    if case["constraint"].get("tilt_locked"):  # a point below C stands for the block's base
        solid = {key: value for key, value in solid.items() if key != "shape"}
    body = body_of(solid, start_of(case) if "samples" in case else case["initial"])
    contact = contact_of(case)
    constraints: Mapping = {"floor": contact}
    if case["constraint"].get("tilt_locked"):
        constraints["tilt"] = {"type": "translation", "body": "body"}
        height = case["body"].get("shape", {}).get("com_height", 0.0)
        below = -height * np.asarray(case["constraint"]["normal"])
        contact["points"] = [below.tolist()]
    effects: Mapping = {"weight": {"type": "gravity", "acceleration": list(case["gravity"])}}
    for load in case["loads"]:
        effects |= pulled(load, case)
    return {"bodies": {"body": body}, "constraints": constraints, "effects": effects}


def pulled(load: Case, case: Case) -> Mapping:
    """A spring whose other end moves at constant speed: a spring to the start and k v t."""
    k, axis = load["stiffness"], np.asarray(load["axis"], dtype=float)
    end = 2.0 * case["t_end"]
    pull = {
        "times": [0.0, end],
        "forces": [[0.0, 0.0, 0.0], (k * load["speed"] * end * axis).tolist()],
    }
    spring = {"stiffness": k, "rest_length": 0.0, "point_A": case["initial"]["position"]}
    return {
        "spring": {"type": "spring", "body": "body"} | spring,
        "drive": {"type": "wrench_table", "body": "body"} | pull,
    }
