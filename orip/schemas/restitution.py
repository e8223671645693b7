"""Types of the documents about restituted features."""

from __future__ import annotations

from typing import Literal

from orip.schemas.project import Part, Warned


class FeatureFigures(Part, frozen=True):
    """A feature: ground units; area in the XY plane, largest standard deviations X, Y, Z, y-parallax in mm."""

    kind: Literal["POINT", "LINE", "AREA"]
    code: str
    name: str
    vertices: int
    length: float
    area: float
    largest_sd: list[float] | None
    largest_y_parallax: float | None


class ComputedFeature(FeatureFigures, frozen=True):
    """A feature that was computed, with the largest y-parallax over its standard deviation."""

    largest_w: float


class RestituteCompute(Part, frozen=True):
    """What was restituted, the file that it is in, and how many vertices snapped."""

    command: Literal["restitute compute"]
    file: str
    features: list[ComputedFeature]
    snapped: int
    warnings: list[Warned]


class RestituteShow(Part, frozen=True):
    """Restituted features."""

    command: Literal["restitute show"]
    ground_unit: str
    features: list[FeatureFigures]


class RestituteExport(Part, frozen=True):
    """A drawing of restituted features that was written."""

    command: Literal["restitute export"]
    format: Literal["geojson", "geopackage", "dxf"]
    file: str
    features: int
