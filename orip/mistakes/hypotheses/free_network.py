"""A block as a free network: as the photos alone see it."""

from __future__ import annotations

import numpy as np

from orip.bundle.antennas import without_unmeasured_points
from orip.records.block import Block
from orip.structs import replace


def free_network(block: Block) -> Block:
    """Return a block as a free network in a system of its own."""
    free = replace(
        block,
        definition=replace(block.definition, datum="free", datum_points=()),
        control_points=(),
        constant_points=np.zeros_like(block.constant_points),
        photo_orientation=np.full_like(block.photo_orientation, np.nan),
        point_start=np.full_like(block.point_start, np.nan),
        elements=tuple(element for element in block.elements if element.group == "CAMERA"),
        distances=(),
        directions=(),
        stations=(),
        theodolites=(),
        constant_elements=(),
        preliminary=(),
    )
    return without_unmeasured_points(free)
