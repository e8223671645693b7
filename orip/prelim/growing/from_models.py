"""What has been computed from pairs of photos while blocks grew, and is needed again."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct, field

from orip.prelim.growing.growing_block import GrowingBlock
from orip.prelim.relative.orientation import OrientedPair
from orip.records.results.preliminary import NotOriented


class FromModels(Struct, frozen=True):
    """Models of the rays of a block, and blocks grown from them.

    Routes that begin with different pairs of photos come to the same parts, and a part that cannot be connected is
    tried again when the block has grown.

    Parameters
    ----------
    models : dict
        Relative orientations by pairs of photos.
    blocks : dict
        Blocks by the pair that they began with and all else that they depend on.
    earlier : mapping
        Models of other rays of the block: where a pair has kept its points, it is not oriented again.
    """

    models: dict[tuple[int, int], OrientedPair | NotOriented] = field(default_factory=dict)
    blocks: dict[tuple[int, int, bool, bytes, bytes], GrowingBlock] = field(default_factory=dict)
    earlier: Mapping[tuple[int, int], OrientedPair | NotOriented] = field(default_factory=dict)

    def of_other_rays(self) -> FromModels:
        """Return what other rays of the same block begin with."""
        return FromModels(earlier={**self.earlier, **self.models})
