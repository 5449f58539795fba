"""Mass properties for poses of somebody else: from a scene, a URDF, or a bag of ours."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from rb_sim.bags.analysis.derivatives import Body
from rb_sim.base.errors import RbSimError
from rb_sim.numerics.rotations import from_rotation_vector, product, rotate
from rb_sim.scene.schema import Scene

MOST = 20_000_000
"""Bytes of a URDF that are read."""


def masses_of(path: str) -> dict[str, Body]:
    """Bodies by name. path: scene file or shipped name, or a .urdf. Raises RbSimError."""
    scene = scene_of(path)
    return _of_urdf(Path(path)) if scene is None else bodies_of(scene)


def scene_of(path: str) -> Scene | None:
    """The scene of that file or shipped name; None for a .urdf. Raises RbSimError."""
    if Path(path).suffix == ".urdf":
        return None
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene

    return load_scene(find_scene(path))


def bodies_of(scene: Scene) -> dict[str, Body]:
    """Mass properties of the bodies of a scene."""
    return {
        name: Body(body.mass, np.array(body.inertia), np.array(body.center_of_mass))
        for name, body in scene.bodies.items()
    }


def scene_with(name: str, body: Body) -> Scene:
    """A scene of that one body, on which nothing acts. Raises SceneError."""
    from rb_sim.scene.load import scene_from_plain

    numbers = {"mass": body.mass, "inertia": body.inertia.tolist(),
               "center_of_mass": body.center_of_mass.tolist()}  # fmt: skip
    return scene_from_plain({"bodies": {name: numbers}}, name=name)


def _of_urdf(path: Path) -> dict[str, Body]:
    try:
        if path.stat().st_size > MOST:
            raise RbSimError(f"{path}: larger than {MOST} bytes")
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as error:
        raise RbSimError(f"{path}: cannot read this URDF: {error}") from None
    bodies = {}
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        try:
            bodies[link.get("name", "")] = _body(inertial)
        except (AttributeError, KeyError, TypeError, ValueError):
            name = link.get("name")
            raise RbSimError(
                f"{path}: link {name}: mass or inertia is not as URDF has it"
            ) from None
    if not bodies:
        raise RbSimError(f"{path}: no link with an inertial")
    return bodies


def _body(inertial: ElementTree.Element) -> Body:
    mass, inertia, origin = (inertial.find(name) for name in ("mass", "inertia", "origin"))
    if mass is None or inertia is None:
        raise ValueError("no mass or no inertia")
    xx, xy, xz, yy, yz, zz = (
        float(inertia.attrib[key]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    xyz, rpy = np.zeros(3), np.zeros(3)
    if origin is not None:
        xyz = np.array([float(x) for x in origin.get("xyz", "0 0 0").split()])
        rpy = np.array([float(x) for x in origin.get("rpy", "0 0 0").split()])
    about_x, about_y, about_z = from_rotation_vector(np.diag(rpy))
    q = product(about_z, product(about_y, about_x))
    turn = rotate(q, np.eye(3)).T
    return Body(float(mass.attrib["value"]), turn @ tensor @ turn.T, xyz)
