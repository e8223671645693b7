"""Names that nothing uses, and names that look alike."""

from __future__ import annotations

from collections.abc import Container, Sequence

from orip.errors import ProjectWarning
from orip.records.block import Block
from orip.records.control import Control, ControlElement, PreliminaryPoint
from orip.records.names import look_alikes
from orip.wording import agreeing, joined


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
    warnings += [
        ProjectWarning("unused-control", f"distance {each.name}", _unplaced(points, each.start, each.end))
        for each in control.distances
        if each not in block.distances
    ]
    warnings += [
        ProjectWarning(
            "unused-control",
            f"direction {each.set} {each.station} {each.target}",
            _unplaced(points, each.station, each.target),
        )
        for each in control.directions
        if each not in block.directions
    ]
    warnings += [
        ProjectWarning("unused-control", f"element {each.group} {each.name} {each.kind}", _unknown(each))
        for each in control.elements
        if each not in block.elements
    ]
    for group in look_alikes([*block.point_names, *(point.name for point in control.points)]):
        text = f"{', '.join(group)} differ only in case or leading zeros: are they one point?"
        warnings.append(ProjectWarning("look-alike-names", f"point {group[0]}", text))
    return warnings


def _unplaced(points: Container[str], *names: str) -> str:
    missing = [name for name in names if name not in points]
    which = joined(missing) or "one of its points"
    verb = agreeing(len(missing) or 1, "is", "are")
    return f"is not used: {which} {verb} not measured, nor given coordinates; correct the name, or measure it"


def _unknown(element: ControlElement) -> str:
    what = {"THEODOLITE": "set of directions"}.get(element.group, element.group.lower())
    return f"is not used: the bundle has no {what} {element.name}; correct the name"
