"""Where the adjustment of the first photos of a session starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
from msgspec import Struct

from orip.bundle.assemble import with_starting_values
from orip.bundle.ground_system import photos_in_frame
from orip.errors import NotSolvableError
from orip.records.block import Block
from orip.records.observations.control import PreliminaryPoint
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.records.results.preliminary import PreliminaryValues
from orip.records.results.solution import Solution
from orip.solving.starting_values import (
    StartedBlock,
    explained_preliminary_values,
    own_start,
    soon_found_values,
    started_block,
)
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE


class FirstValues(Struct, frozen=True):
    """How values are found for a block of which none are known.

    Parameters
    ----------
    find : callable
        Runs the chain.
    solution : Solution or None
        An adjustment of the same measurements, which is tried first.
    """

    find: Callable[[Block], PreliminaryValues]
    solution: Solution | None = None

    def starts(self, block: Block) -> Iterator[Callable[[], StartedBlock]]:
        """Yield functions that start the adjustment of a gathered block, or raise `NotSolvableError`."""
        if (solution := self.solution) is not None:
            yield lambda: _at_solution(block, solution)
        values = cache(lambda: self.find(block))
        yield lambda: _without_given(block, values())
        if np.isfinite(block.photo_orientation).any():
            # given orientations are often far off, and what the chain finds is not
            yield lambda: started_block(block, lambda _: values())


THOROUGH = FirstValues(explained_preliminary_values)
"""At the beginning of a session, with all that is measured."""

SOON = FirstValues(soon_found_values)
"""In an answer: if it does not suffice, it is tried again with more measurements."""


def _at_solution(block: Block, solution: Solution) -> StartedBlock:
    """Return a gathered block with the adjusted values of its photos, points and cameras.

    Raises
    ------
    NotSolvableError
        If a photo was left out of the adjustment.
    """
    rows = {name: row for row, name in enumerate(solution.photos.names)}
    if lacking := [photo.name for photo in block.photos if photo.name not in rows]:
        message = f"photo {lacking[0]} was left out of the last adjustment"
        raise NotSolvableError(message)
    orientation = np.array([solution.photos.values[rows[photo.name]] for photo in block.photos])
    orientation[:, 3:] *= RADIANS_PER_DEGREE
    cameras = dict(zip(solution.cameras.names, solution.cameras.values.tolist(), strict=True))
    points = zip(solution.points.names, solution.points.values.tolist(), strict=True)
    started = replace(
        block,
        photo_orientation=orientation,
        cameras=tuple(
            replace(camera, parameters=tuple(cameras.get(camera.name, camera.parameters))) for camera in block.cameras
        ),
        preliminary=tuple(
            PreliminaryPoint(name, (x, y, z)) for name, (x, y, z) in points if np.isfinite((x, y, z)).all()
        ),
    )
    return StartedBlock(with_starting_values(photos_in_frame(started))[0], block)


def _without_given(block: Block, values: PreliminaryValues) -> StartedBlock:
    """Return a block as the chain starts it; photos that it cannot orient are left out, unless they are constant."""
    constant = np.array([[kind in photo.constant for kind in PHOTO_PARAMETERS] for photo in block.photos])
    return own_start(replace(block, photo_orientation=np.where(constant, block.photo_orientation, np.nan)), values)
