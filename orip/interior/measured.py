"""What is measured in a project: the state that replaying a measurement log leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

from orip.records.camera import Camera
from orip.records.measurement import PhotoObservations, PhotoOrientation, TemplateOrientation
from orip.records.photo import Temtick


@dataclass(frozen=True, slots=True)
class Measured:
    """What is measured: orientations by `record_key`, observations by bundle, digitised marks taken into records."""

    templates: dict[str, TemplateOrientation] = field(default_factory=dict)
    photos: dict[str, PhotoOrientation] = field(default_factory=dict)
    observations: dict[str, PhotoObservations] = field(default_factory=dict)
    cameras: dict[str, Camera] = field(default_factory=dict)
    temticks: dict[str, Temtick] = field(default_factory=dict)
