"""Which stage plate each photo is on: both photos of a model must be on different ones."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping, Sequence

from msgspec import Struct

from orip.records.names import record_key
from orip.records.project.definition import StereoModel
from orip.records.project.photo import Photo, Stage, Template

_OTHER: Mapping[Stage, Stage] = {"UPPER": "LOWER", "LOWER": "UPPER"}


class StagePlan(Struct, frozen=True):
    """Stages of the photos that have one or are in a model, by `record_key`, and the models that they do not suit."""

    stages: Mapping[str, Stage]
    unsuited: tuple[StereoModel, ...]


def plan_stages(photos: Sequence[Photo], templates: Sequence[Template], models: Sequence[StereoModel]) -> StagePlan:
    """Find the stages that are not set by two-colouring the models.

    A template's photos share its stage. Stages that are set stay; where nothing is set, the left photo of the first
    model is on the upper stage. A model whose photos end up on one stage is among the unsuited.
    """
    carrier = _carriers(photos)
    stages = _set_stages(photos, templates)
    neighbours: dict[str, list[str]] = defaultdict(list)
    for model in models:
        left, right = _carrier_of(model.left, carrier), _carrier_of(model.right, carrier)
        neighbours[left].append(right)
        neighbours[right].append(left)
    _spread(list(stages), neighbours, stages)
    for model in models:
        left = _carrier_of(model.left, carrier)
        if left not in stages:
            stages[left] = "UPPER"
            _spread([left], neighbours, stages)
    unsuited = tuple(m for m in models if stages[_carrier_of(m.left, carrier)] == stages[_carrier_of(m.right, carrier)])
    return StagePlan({photo: stages[node] for photo, node in carrier.items() if node in stages}, unsuited)


def _carriers(photos: Sequence[Photo]) -> dict[str, str]:
    """Return what is mounted for each photo: its template, or the photo itself."""
    return {
        record_key(photo.name): f"template {record_key(photo.template)}"
        if photo.template is not None
        else f"photo {record_key(photo.name)}"
        for photo in photos
    }


def _carrier_of(photo: str, carrier: Mapping[str, str]) -> str:
    return carrier.get(record_key(photo), f"photo {record_key(photo)}")


def _set_stages(photos: Sequence[Photo], templates: Sequence[Template]) -> dict[str, Stage]:
    stages: dict[str, Stage] = {}
    for template in templates:
        if template.stage is not None:
            stages[f"template {record_key(template.name)}"] = template.stage
    for photo in photos:
        if photo.stage is not None and photo.template is None:
            stages[f"photo {record_key(photo.name)}"] = photo.stage
    return stages


def _spread(start: Sequence[str], neighbours: Mapping[str, Sequence[str]], stages: dict[str, Stage]) -> None:
    """Assign the other stage to all connected photos that have none yet, breadth first."""
    waiting = deque(start)
    while waiting:
        node = waiting.popleft()
        for other in neighbours.get(node, ()):
            if other not in stages:
                stages[other] = _OTHER[stages[node]]
                waiting.append(other)
