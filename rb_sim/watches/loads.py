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


QUIET = ("gravity", "spring", "torsion_spring")
"""Effects with a potential, but for their damping."""


def may_work(scene: Scene) -> bool:
    """Whether an effect without potential, or a joint that moves, is in the scene."""
    return bool(_effects_at_work(scene)) or _joints_move(scene)


def bodies_at_work(scene: Scene) -> list[str] | None:
    """Bodies whose motion tells the power of all loads without a potential; None: it may take all
    of them, since reactions of joints that move work as well. Those of contacts are told apart."""
    if _joints_move(scene):
        return None
    effects = _effects_at_work(scene)
    acted_on = {getattr(effect, end, None) for effect in effects for end in ("body", "parent")}
    return [name for name in scene.bodies if name in acted_on]


def _effects_at_work(scene: Scene) -> list[Any]:
    effects: list[Any] = list(scene.effects.values())
    return [e for e in effects if e.type not in QUIET or getattr(e, "damping", 0.0)]


def _joints_move(scene: Scene) -> bool:
    constraints: list[Any] = list(scene.constraints.values())
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
