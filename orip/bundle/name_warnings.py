"""Names that nothing uses, and names that look alike."""

from __future__ import annotations

from collections.abc import Sequence

from orip.errors import ProjectWarning
from orip.model.block import Block
from orip.model.control import Control, PreliminaryPoint
from orip.model.names import look_alikes


def name_warnings(block: Block, control: Control, preliminary: Sequence[PreliminaryPoint]) -> list[ProjectWarning]:
    """Return a warning for each control observation and preliminary point that the block does not use."""
    points = set(block.point_names)
    unmeasured = "is not measured in any photo"
    warnings = [
        ProjectWarning("unused-control", f"control point {each.name}", unmeasured)
        for each in control.points
        if each.name not in points
    ]
    warnings += [
        ProjectWarning("unused-preliminary", f"preliminary point {each.name}", unmeasured)
        for each in preliminary
        if each.name not in points
    ]
    unplaced = "is not used: one of its points is neither measured nor given coordinates"
    warnings += [
        ProjectWarning("unused-control", f"distance {each.name}", unplaced)
        for each in control.distances
        if each not in block.distances
    ]
    warnings += [
        ProjectWarning("unused-control", f"direction {each.set} {each.station} {each.target}", unplaced)
        for each in control.directions
        if each not in block.directions
    ]
    warnings += [
        ProjectWarning("unused-control", f"element {each.group} {each.name} {each.kind}", "is not part of the bundle")
        for each in control.elements
        if each not in block.elements
    ]
    for group in look_alikes([*block.point_names, *(point.name for point in control.points)]):
        text = f"{', '.join(group)} differ only in case or leading zeros: are they one point?"
        warnings.append(ProjectWarning("look-alike-names", f"point {group[0]}", text))
    return warnings
