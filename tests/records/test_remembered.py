"""What follows from a frozen structure is worked out once, and forgotten with it."""

from __future__ import annotations

import gc

from msgspec import Struct

from orip.structs import remembered


class _Length(Struct, frozen=True, weakref=True):
    metres: float


def test_each_structure_and_argument_is_worked_out_once() -> None:
    asked = []

    @remembered
    def times(length: _Length, factor: float) -> float:
        asked.append((length.metres, factor))
        return length.metres * factor

    one, equal = _Length(2.0), _Length(2.0)
    assert [times(one, 3.0), times(one, 3.0), times(one, 4.0), times(equal, 3.0)] == [6.0, 6.0, 8.0, 6.0]
    assert asked == [(2.0, 3.0), (2.0, 4.0), (2.0, 3.0)]


def test_what_takes_the_place_of_one_that_is_gone_is_worked_out_anew() -> None:
    @remembered
    def doubled(length: _Length) -> float:
        return 2.0 * length.metres

    found = []
    for metres in range(50):  # in the same place of the memory, one after the other
        found.append(doubled(_Length(float(metres))))
        gc.collect()
    assert found == [2.0 * metres for metres in range(50)]
