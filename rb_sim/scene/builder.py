"""A scene in code, entry by entry: a short way to the mapping that `load_scene` takes."""

from __future__ import annotations

from typing import Any

from rb_sim.errors import SceneError
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.schema import Scene


class SceneBuilder:
    """Collects what a scene file says; every call returns the builder, so that calls chain.

    name: what the scene and its errors are called. Keys and values are those of a scene file
    (docs/scenes.md); `build` checks them. Raises SceneError for a name that is taken, at once.
    """

    def __init__(self, name: str = "scene", description: str = "") -> None:
        self._name = name
        self._data: dict[str, Any] = {"bodies": {}, "constraints": {}, "effects": {}}
        if description:
            self._data["description"] = description

    def __repr__(self) -> str:
        parts = [
            f"{section}: {', '.join(self._data[section])}"
            for section in ("bodies", "constraints", "effects")
            if self._data[section]
        ]
        return f"<SceneBuilder {self._name}: {'; '.join(parts) or 'nothing yet'}>"

    def body(self, name: str, **values: Any) -> SceneBuilder:
        """Add a body: mass, shape or inertia, initial pose and velocity."""
        return self._put("bodies", name, values)

    def constraint(self, name: str, type: str, **values: Any) -> SceneBuilder:  # noqa: A002
        """Add a constraint of a type of the catalogue; its reaction has the same name."""
        return self._put("constraints", name, {"type": type, **values})

    def effect(self, name: str, type: str, **values: Any) -> SceneBuilder:  # noqa: A002
        """Add an effect of a type of the catalogue."""
        return self._put("effects", name, {"type": type, **values})

    def simulate(self, **values: Any) -> SceneBuilder:
        """Say how to integrate: duration, rate, method, step or tolerance."""
        self._data["simulation"] = {**self._data.get("simulation", {}), **values}
        return self

    def as_dict(self) -> dict[str, Any]:
        """The mapping that `load_scene` takes."""
        return {key: value for key, value in self._data.items() if value}

    def as_yaml(self) -> str:
        """The text of a scene file that says the same. Raises SceneError as `build` does."""
        return self.build().text

    def build(self, **overrides: Any) -> Scene:
        """The checked scene. Raises SceneError that names key, value and what is allowed."""
        return scene_from_mapping(self.as_dict(), name=self._name, file=self._name, **overrides)

    def _put(self, section: str, name: str, entry: dict[str, Any]) -> SceneBuilder:
        if name in self._data[section]:
            raise SceneError("is given twice", key=f"{section}.{name}", file=self._name)
        self._data[section][name] = entry
        return self
