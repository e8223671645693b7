"""The control of a session as the project gives it: its solution holds what is held there, its tests observe it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from orip.online.online_block import OnlineBlock


@contextmanager
def control_as_given(block: OnlineBlock) -> Iterator[None]:
    """Meanwhile, hold the control that the project holds; afterwards it is observed again, and can be tested.

    Everything is linearised again with it, at the values that there are, before and after. Where nothing is held, and
    within another such block, nothing happens.
    """
    if not block.measurements.softens_control:
        yield
        return
    block.measurements.hold_control(held=True)
    try:
        block.linearise_again()
        yield
    finally:
        block.measurements.hold_control(held=False)
        block.linearise_again()
