"""Where the numbers of a system are, and others in their stead."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from rb_sim.mechanics.inputs import FREE, fits, number_at, numbers, skeleton, with_numbers


class Row(NamedTuple):
    length: float
    count: int
    pair: tuple[float, str]


def system() -> Any:
    return Row(2.0, 3, (4.0, "x")), np.array([[5.0, 6.0], [7.0, 8.0]]), np.array([1, 2]), None


PLACES: dict[tuple[int, ...], float] = {
    (0, 0): 2.0, (0, 2, 0): 4.0, (1, 0): 5.0, (1, 1): 6.0, (1, 2): 7.0, (1, 3): 8.0,
}  # fmt: skip


def test_every_float_has_its_place_and_is_found_there() -> None:
    assert dict(numbers(system())) == PLACES
    assert all(number_at(system(), place) == value for place, value in PLACES.items())


@pytest.mark.parametrize("place", PLACES)
def test_a_number_may_be_another_one(place: tuple[int, ...]) -> None:
    """All others stay, and so do the classes; a table becomes one of objects."""
    changed = with_numbers(system(), {place: 9.5})
    assert {p: float(number_at(changed, p)) for p in PLACES} == PLACES | {place: 9.5}
    assert type(changed[0]) is Row and changed[0].pair[1] == "x" and changed[3] is None
    assert dict(numbers(system())) == PLACES
    assert (changed[1].dtype == object) is (place[0] == 1)
    assert with_numbers(2.0, {(): 3.0}) == 3.0
    both = with_numbers(system(), {place: 9.5, (0, 2, 0): 1.5, (1, 3): 2.5})
    assert number_at(both, (1, 3)) == 2.5 and number_at(both, (0, 2, 0)) == 1.5


def test_what_a_system_is_but_for_its_numbers() -> None:
    other = with_numbers(system(), {(0, 0): 9.0})
    assert skeleton(other) == skeleton(system())
    row, table, indices, nothing = system()
    for one in (
        (row._replace(count=4), table, indices, nothing),
        (row._replace(pair=(4.0, "y")), table, indices, nothing),
        (tuple(row), table, indices, nothing),
        (row, table.ravel(), indices, nothing),
        (row, table, indices[::-1].copy(), nothing),
        (row, table, indices),
    ):
        assert skeleton(one) != skeleton(system())


def test_which_systems_fit_a_pattern() -> None:
    """But for the numbers that are free: of no other class, shape or kind."""
    pattern = with_numbers(system(), {(0, 0): FREE, (1, 2): FREE})
    row, table, indices, nothing = system()
    assert fits(system(), pattern) and fits(
        with_floats(row, table, {(0, 0): -1.0, (1, 2): 3.0}), pattern
    )
    for place in set(PLACES) - {(0, 0), (1, 2)}:
        assert not fits(with_floats(row, table, {place: 9.0}), pattern)
    for one in (
        (row._replace(length=2), table, indices, nothing),
        (row._replace(count=3.0), table, indices, nothing),
        (tuple(row), table, indices, nothing),
        (row, table[:1], indices, nothing),
        (row, None, indices, nothing),
        (row, table, indices + 1, nothing),
        (row, table, indices.astype(float), nothing),
        (row, table, indices[:1], nothing),
        (row, table, None, nothing),
        (row, table, indices, 1.0),
        (row, table, indices),
    ):
        assert not fits(one, pattern)


def with_floats(row: Any, table: Any, values: dict[tuple[int, ...], float]) -> Any:
    """The system with other numbers, its table still one of floats."""
    changed = with_numbers(system(), values)
    return changed[0], changed[1].astype(float), *changed[2:]
