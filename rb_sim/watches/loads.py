"""What a scene says of its loads before it runs: whether they work, jump or stay unknown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rb_sim.scene.schema import Scene


def jumps_of_tables(scene: Scene) -> list[float]:
    """Instants at which tabulated wrenches jump or bend, increasing [s]."""
    times: list[Any] = [getattr(effect, "times", ()) for effect in scene.effects.values()]
    return sorted({float(t) for table in times for t in table})


def ends_of_tables(scene: Scene) -> list[float]:
    """Instants at which a sample shows a wrench that acts neither before nor after [s]."""
    times: list[Any] = [getattr(effect, "times", ()) for effect in scene.effects.values()]
    return [float(table[-1]) for table in times if table]


def may_work(scene: Scene) -> bool:
    """Whether an effect without potential, or a joint that moves, is in the scene."""
    quiet = ("gravity", "spring", "torsion_spring")
    effects: list[Any] = list(scene.effects.values())
    constraints: list[Any] = list(scene.constraints.values())
    if any(effect.type not in quiet or getattr(effect, "damping", 0.0) for effect in effects):
        return True
    return any(getattr(spec, "rate", 0.0) for spec in constraints)


def unknown_force(scene: Scene) -> str:
    """Name of the first effect that exerts an outer force not told by the samples; or ""."""
    for name, effect in scene.effects.items():
        kind: str = effect.type  # type: ignore[attr-defined]
        between_bodies = getattr(effect, "parent", None) is not None
        steady = kind == "wrench" and effect.sine_force == effect.sine_torque == (0.0,) * 3  # type: ignore[attr-defined]
        if not (kind in ("gravity", "commanded_wrench") or between_bodies or steady):
            return name
    return ""
