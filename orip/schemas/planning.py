"""Types of the documents about plans (exposures, forecasts, variants, places of control) and restituted features."""

from __future__ import annotations

from typing import Literal

from orip.schemas.project import Part, Warned


class PlanMade(Part, frozen=True):
    """A plan that was made, or would be; lengths in ground units, null where there is no such figure."""

    command: Literal["plan make"]
    file: str
    dry_run: bool
    photos: int
    height: float | None
    pixel: float | None
    base: float | None
    spacing: float | None
    speed: float | None
    seconds: float | None
    turns: int
    batteries: int
    rays: int


class PlanAdvice(Part, frozen=True):
    """What is not determined, or badly, and what would help."""

    code: str
    where: str
    text: str
    remedy: str


class PlanForecast(Part, frozen=True):
    """Precision and reliability of what is planned: X, Y, Z and angles in degrees; null: not determined."""

    command: Literal["plan forecast"]
    point_sd_median: list[float | None]
    point_sd_largest: list[float | None]
    photo_sd_median: list[float | None]
    camera_sd: dict[str, float | None]
    redundancy: int
    redundancy_number_median: float | None
    smallest_bias_mm: float | None
    external: float | None
    not_determined: list[str]
    diagnosis: list[PlanAdvice]


class PlanVariant(Part, frozen=True):
    """A variant of a plan: what is different, what it costs, and what it gives."""

    variant: str
    photos: int
    minutes: float
    point_sd_median: list[float | None]
    point_sd_largest: list[float | None]
    camera_sd: dict[str, float | None]
    redundancy_number_median: float | None
    smallest_bias_mm: float | None
    not_determined: list[str]


class PlanCompare(Part, frozen=True):
    """Variants of a plan, the plan itself first."""

    command: Literal["plan compare"]
    variants: list[PlanVariant]


class PlacedPoint(Part, frozen=True):
    """A control point to be, with the a-priori error of its coordinates."""

    name: str
    coordinates: list[float | None]
    error: float | None


class PlacedDistance(Part, frozen=True):
    """A distance to be measured between two points, with its a-priori error."""

    name: str
    start: str
    end: str
    distance: float
    error: float


class PlacedPhoto(Part, frozen=True):
    """A photo to be taken: X0, Y0, Z0, and omega, phi, kappa in degrees."""

    name: str
    position: list[float]
    angles: list[float]


class PlanPlace(Part, frozen=True):
    """What helps most, the goal with all of it, and with none and the best first of a greedy choice."""

    command: Literal["plan place"]
    what: Literal["control", "check", "distances", "photos"]
    goal: Literal["largest", "mean", "camera"]
    points: list[PlacedPoint]
    distances: list[PlacedDistance]
    photos: list[PlacedPhoto]
    value: float
    curve: list[float]


class PlanExport(Part, frozen=True):
    """A file for pilots that was written, and what its heights are above."""

    command: Literal["plan export"]
    format: str
    file: str
    heights: str


class PlanFollow(Part, frozen=True):
    """A flight that was followed: exposures by name, and lines of the receiver that were damaged."""

    command: Literal["plan follow"]
    flown: list[str]
    missed: list[str]
    left: list[str]
    damaged_lines: int


class PlanFlown(Part, frozen=True):
    """What was flown of a plan, places of the ground that too few photos show, and how many stay so."""

    command: Literal["plan flown"]
    planned: int
    flown: int
    again: list[str]
    missed_strips: list[str]
    off_median: float | None
    places: int
    gaps: int
    gaps_after_again: int


class PhotoTime(Part, frozen=True):
    """GPS time of a photo and its standard deviation, seconds."""

    photo: str
    time: float
    sd: float


class PlanClock(Part, frozen=True):
    """A computer's clock against the receiver's marks: drift as a part of the time, jitter in seconds."""

    command: Literal["plan clock"]
    drift: float
    drift_sd: float
    jitter: float
    marks: int
    wrong_lines: list[int]
    photos: list[PhotoTime]


class PlanShow(Part, frozen=True):
    """The page of a plan that was written."""

    command: Literal["plan show"]
    file: str


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
