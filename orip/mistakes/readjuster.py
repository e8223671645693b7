"""Adjusting a block again, as the project's adjustment was, after something in it was changed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import SETTLED_ENP
from orip.bundle.solve import SolvedBlock, iteration_settings, solve_block
from orip.errors import NotSolvableError
from orip.geometry.rotation import angles_from_rotation
from orip.records.block import Block
from orip.structs import replace

_MOST_PHOTO_POINTS = 20_000
"""Most photo points: in larger blocks further adjustments would take longer than a user wants to wait."""

EXPLAINING_WARNINGS = {
    "misnamed-marks", "outside-frame", "senseless-camera", "coordinate-unit", "same-photo", "other-spelling",
    "ground-system", "degrees", "resolution",
}  # fmt: skip
"""Codes of warnings that already explain a misfit."""


class Readjuster(Struct, frozen=True):
    """Adjusts a block again.

    Parameters
    ----------
    block : Block
        As measured and given.
    start : callable
        Gives such a block its starting values.
    """

    block: Block
    start: Callable[[Block], Block]

    @property
    def is_oriented(self) -> bool:
        """Return whether the orientations of all photos were given."""
        return bool(np.isfinite(self.block.photo_orientation).all())

    @property
    def is_small(self) -> bool:
        """Return whether the block is not too large to be adjusted again."""
        return len(self.block.photo_points.photo) <= _MOST_PHOTO_POINTS

    @property
    def is_worthwhile(self) -> bool:
        """Return whether to adjust again: the block is not too large, and no warning explains its misfit already."""
        return self.is_small and not any(warning.code in EXPLAINING_WARNINGS for warning in self.block.warnings)

    def adjust(self, block: Block) -> SolvedBlock | None:
        """Return the adjustment of a block, None where there is none.

        Parameters
        ----------
        block : Block
            As `Readjuster.block`, with something changed.
        """
        return self._adjusted(block, block.definition.enp_stop)

    def adjust_roughly(self, block: Block) -> SolvedBlock | None:
        """Return the adjustment of a block, as soon as it shows what fits; None where there is none."""
        return self._adjusted(block, SETTLED_ENP)

    def _adjusted(self, block: Block, enp_stop: float) -> SolvedBlock | None:
        try:
            return _solved(self.start(block), enp_stop)
        except (NotSolvableError, np.linalg.LinAlgError, ValueError):
            # a block changed for a trial may be impossible to adjust; the adjustment as given stands nevertheless
            return None

    def adjust_from(self, solved: SolvedBlock) -> SolvedBlock | None:
        """Return the rough adjustment of `block` that starts where another one ended, None where there is none."""
        state, place = solved.state, solved.block.point_index()
        orientation = np.hstack([state.centres, angles_from_rotation(state.rotations)])
        try:
            started = self.start(replace(self.block, photo_orientation=orientation))
            ended = state.points[[place[name] for name in started.point_names]]
            points = np.where(started.constant_points, started.point_start, ended)
            return _solved(replace(started, point_start=points), SETTLED_ENP)
        except (NotSolvableError, np.linalg.LinAlgError):
            return None


def _solved(block: Block, enp_stop: float) -> SolvedBlock:
    # whether a mistake explains the misfit is seen long before the last observation has the right weight
    settings = iteration_settings(block.definition)
    settings = replace(settings, enp_stop=min(enp_stop, settings.enp_stop), most_attempts=0)
    return solve_block(block, lambda _: None, lambda: False, settings)
