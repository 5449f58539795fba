"""What is done between the calls of the loop: in one call or put together in Python, compiled or
not, it is the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.contact.events.instant import ARRIVE, CHOOSE, DONE, IMPACTS, LEAVE, PASS, Instant, Tasks
from rb_sim.contact.problem.event_workspace import KINDS, Journal
from tests.contact.scenes import ball, box, scene, touch

TILTED = {"axis": [1, 2, 0], "angle": 0.3}
FALLING = scene(
    box([0.2, 0.4, 0.1], [0.0, 0.0, 0.4], orientation=TILTED),
    touch(mu=0.4, kinetic=0.3, restitution=0.5, rolling_resistance=1e-3, spinning_resistance=1e-3),
)
JOINED = scene(
    {
        "body": box([0.2, 0.4, 0.1], [0.0, 0.0, 0.4], orientation=TILTED),
        "hanging": ball([0.3, 0.0, 0.4], radius=0.05),
    },
    {
        "floor": touch(mu=0.4, restitution=0.5),
        "joint": {
            "type": "fixed_point",
            "body": "hanging",
            "parent": "body",
            "point_B": [-0.1, 0.0, 0.0],
        },
        "ground": touch("hanging", mu=0.2, restitution=0.3),
    },
)


def run(mapping: Any, in_one_call: bool) -> tuple[Any, list[Any]]:
    """(coordinates at the end, events) of half a second."""
    simulation: Any = Simulation(load_scene(mapping))
    motion = simulation._motion
    assert motion._by_laws_alone
    motion._by_laws_alone = in_one_call
    motion.run_to(np.array([0.5]))
    return motion.coordinates, motion.events


@pytest.mark.parametrize("mapping", [FALLING, JOINED], ids=["alone", "joined"])
def test_one_call_does_what_the_parts_do(mapping: Any) -> None:
    y, events = run(mapping, True)
    parts, told = run(mapping, False)
    assert len(events) > 20
    assert np.array_equal(y, parts)
    assert events == told


def test_tasks_are_the_same_compiled_and_not() -> None:
    """Of an edge of a box that strikes the floor, whose corners then slip or part."""
    edge = box([0.2, 0.4, 0.1], [0, 0, 0.1 * np.sin(0.5) + 0.05 * np.cos(0.5)])
    edge |= {"orientation": {"axis": [0, 1, 0], "angle": 0.5}, "linear_velocity": [0.3, 0.1, -1.0]}
    found = []
    for compiled in (True, False):
        simulation: Any = Simulation(load_scene(scene(edge, touch(mu=0.4, restitution=0.3))))
        motion = simulation._motion
        y = np.array(motion.compiled.y)
        call = motion._call if compiled else Tasks(motion.system)
        at = Instant(motion.laws, call, 0.0, y, ARRIVE)
        statuses = [call(IMPACTS, 0.0, y, (0, 50, 0)), call(CHOOSE, 0.0, y, (-1, -1, 0))]
        statuses.append(call(LEAVE, 0.0, y))
        notes = at.workspace.notes[: at.workspace.written[0]].copy()
        found.append((statuses, y, notes, motion.system.touch.copy(), call.found))
    (*_, one), (*_, other) = found
    assert found[0][0] == found[1][0] == [0, 0, 0]
    assert len(found[0][2]) >= 2
    for a, b in zip(found[0][1:4], found[1][1:4], strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    assert one == pytest.approx(other, rel=1e-12)


def test_what_more_than_the_laws_decide_is_left_to_the_parts() -> None:
    """Four corners that come to rest share their load in many ways: PASS stops before the modes."""
    flat = box([0.2, 0.4, 0.1], [0, 0, 0.05], linear_velocity=[0, 0, -1.0])
    motion: Any = Simulation(load_scene(scene(flat, touch(mu=0.4))))._motion
    y = np.array(motion.compiled.y)
    assert motion._call(PASS, 0.0, y, (0, 0, 0)) != DONE
    thrown = ball([0, 0, 0.1], linear_velocity=[0, 0, -1.0])
    motion = Simulation(load_scene(scene(thrown, touch(mu=0.4, restitution=0.5))))._motion
    y = np.array(motion.compiled.y)
    assert motion._call(PASS, 0.0, y, (0, 0, 0)) == DONE


def test_a_journal_says_what_closes_and_opens_as_its_law_has_it() -> None:
    motion: Any = Simulation(load_scene(scene(ball([0, 0, 0.1]), touch(mu=0.4))))._motion
    law = motion.laws[0]._replace(closes="goes taut", opens="goes slack")
    workspace, journal = motion._call.workspace, Journal(("rope",), (law,))
    for kind in range(len(KINDS)):
        workspace.notes[kind] = [0.5, 0.0, kind, 1.0, 2.0, 3.0]
    workspace.written[0] = len(KINDS)
    journal.take(workspace)
    assert workspace.written[0] == 0
    words = [event.kind for event in journal.events]
    assert [w for w in KINDS if w not in words] == ["closes", "opens"]
    assert words.index("goes taut") == KINDS.index("closes")
    assert words.index("goes slack") == KINDS.index("opens")
    assert journal.events[0].impulse == (1.0, 2.0, 3.0)
