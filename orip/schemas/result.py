"""The type of result.json, and of the parts of it that `orip results` prints."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, UnsetType

from orip.schemas.project import Estimate, Part, Status, Warned


class Iteration(Part, frozen=True):
    """An iteration of the adjustment."""

    iteration: int
    enp: float | None
    sigma0: float | None
    down_weighted: int
    singular: int


class Coordinates(Part, frozen=True):
    """Of a position: residuals, standard residuals or weight factors."""

    X: float | None
    Y: float | None
    Z: float | None


class Angles(Part, frozen=True):
    """Of an attitude: residuals, standard residuals or weight factors."""

    OMEGA: float | None
    PHI: float | None
    KAPPA: float | None


class Photo(Part, frozen=True):
    """Exterior orientation: ground units and degrees."""

    X0: Estimate
    Y0: Estimate
    Z0: Estimate
    OMEGA: Estimate
    PHI: Estimate
    KAPPA: Estimate


class Point(Part, frozen=True):
    """A point on the ground."""

    X: Estimate
    Y: Estimate
    Z: Estimate
    rays: int
    kind: Literal["control", "check", "rejected", "tie"]


class PointColumns(Part, frozen=True):
    """The points of a large block: lists of equal length, an element a point; sd as of an estimate."""

    name: list[str]
    X: list[float | None]
    X_sd: list[float | Literal["singular"] | None]
    Y: list[float | None]
    Y_sd: list[float | Literal["singular"] | None]
    Z: list[float | None]
    Z_sd: list[float | Literal["singular"] | None]
    rays: list[int]
    kind: list[Literal["control", "check", "rejected", "tie"]]


class Station(Part, frozen=True):
    """A photo with an exposure station."""

    strip: str | None
    time: float | None
    residual: Coordinates | UnsetType = UNSET
    w: Coordinates | UnsetType = UNSET
    weight_factor: Coordinates | UnsetType = UNSET
    attitude_residual: Angles | UnsetType = UNSET
    attitude_w: Angles | UnsetType = UNSET
    attitude_weight_factor: Angles | UnsetType = UNSET


class RigFigure(Estimate, frozen=True):
    """A figure of a rig: its standard deviation is that of the mean, its scatter that of one instant."""

    scatter: float | None


class Rig(Part, frozen=True):
    """Two cameras that move together: the second in the system of the first, ground units and degrees."""

    first: str
    second: str
    instants: int
    BX: RigFigure
    BY: RigFigure
    BZ: RigFigure
    OMEGA: RigFigure
    PHI: RigFigure
    KAPPA: RigFigure


class RigExposure(Part, frozen=True):
    """An exposure of a rig, as a photo has place and rotation."""

    rig: str
    X0: Estimate
    Y0: Estimate
    Z0: Estimate
    OMEGA: Estimate
    PHI: Estimate
    KAPPA: Estimate


class Motion(Part, frozen=True):
    """How a photo of a rolling shutter moved: ground units and degrees a second; sd is null for what is no unknown."""

    VX: Estimate
    VY: Estimate
    VZ: Estimate
    WX: Estimate
    WY: Estimate
    WZ: Estimate
    pixels: float | None


class Theodolite(Part, frozen=True):
    """The zero direction of a set."""

    R: Estimate


class Figure(Part, frozen=True):
    """A line, plane, cylinder or common height that points lie on."""

    kind: Literal["LINE", "PLANE", "CYLINDER", "HEIGHT"]
    points: int
    X: float | None
    Y: float | None
    Z: float
    dX: float | None
    dY: float | None
    dZ: float | None
    radius: float | None
    sd_place: float | Literal["singular"] | None
    sd_direction: float | Literal["singular"] | None
    sd_radius: float | Literal["singular"] | None
    rms: float


class Observation(Part, frozen=True):
    """An observation that lost weight."""

    kind: str
    photo: str
    point: str
    component: str
    residual: float | None
    standard_residual: float | None
    weight_factor: float | None


class Singular(Part, frozen=True):
    """An unknown that nothing determines."""

    group: str
    name: str
    kind: str
    lost_digits: float | None


class Correlation(Part, frozen=True):
    """The correlation of two camera unknowns."""

    a: str
    b: str
    r: float | None


class Blunder(Part, frozen=True):
    """An observation that data snooping took out."""

    order: int
    kind: str
    photo: str
    point: str
    component: str
    size: float | None
    sd: float | None
    statistic: float | None
    limit: float | None
    alternatives: list[str]


class Diagnosis(Part, frozen=True):
    """A finding about the block and what to do."""

    code: str
    where: str
    text: str
    remedy: str


class CheckPoint(Part, frozen=True):
    """A check point: adjusted minus given."""

    name: str
    dX: float | None
    dY: float | None
    dZ: float | None


class Group(Part, frozen=True):
    """A group of observations and its tests."""

    kind: str
    of: str
    component: str
    number: int
    down_weighted: int
    redundancy: float | None
    sigma0: float | None
    p_sigma0: float | None
    mean: Estimate
    p_mean: float | None
    shift: Estimate
    worst: str
    worst_size: float | None
    p_worst: float | None
    doubted: bool


class VarianceComponent(Part, frozen=True):
    """The estimated error of a group divided by the given one."""

    kind: str
    of: str
    component: str
    number: int
    redundancy: float | None
    factor: Estimate
    p: float | None


class InteriorOrientation(Part, frozen=True):
    """The orientation of a photo or template by its marks."""

    type: str
    x0: float | None
    y0: float | None
    ro: float | None
    sk: float | None
    sx: float | None
    sy: float | None
    s0: float | None
    redundancy: int


class Interior(Part, frozen=True):
    """Orientations by marks, by name."""

    templates: dict[str, InteriorOrientation]
    photos: dict[str, InteriorOrientation]


_ESTIMATE = {"$ref": "#/$defs/Estimate"}
_OF_STRIPS = {"type": "object", "additionalProperties": {"type": "object", "additionalProperties": _ESTIMATE}}
Antenna = Annotated[
    dict[str, Any], Meta(extra_json_schema={"properties": {"strips": _OF_STRIPS}, "additionalProperties": _ESTIMATE})
]
"""Parameters of an antenna; under ``strips`` those of its strips."""


class Result(Part, frozen=True):
    """All figures of an adjustment: result.json, also printed by `orip solve` and `orip run` with --json."""

    schema: Literal["orip.result/2"]
    run: str
    project: str
    user: str
    bundle: str
    status: Status
    verdict: str
    ground_unit: str
    sigma0: float | None
    sigma0_all: float | None
    redundancy: int
    redundancy_used: float | None
    observations: int
    unknowns: int
    enp: float | None
    iterations: list[Iteration]
    cameras: dict[str, dict[str, Estimate]]
    projections: dict[str, Literal["perspective", "equidistant"]]
    photos: dict[str, Photo]
    points: dict[str, Point]
    point_columns: PointColumns | None
    antennas: dict[str, Antenna]
    stations: dict[str, Station]
    rigs: list[Rig]
    mountings: dict[str, dict[str, dict[str, Estimate]]]
    exposures: dict[str, RigExposure]
    motions: dict[str, Motion]
    theodolites: dict[str, Theodolite]
    figures: dict[str, Figure]
    down_weighted: list[Observation]
    singular: list[Singular]
    correlations: list[Correlation]
    blunders: list[Blunder]
    diagnosis: list[Diagnosis]
    check_points: list[CheckPoint]
    groups: list[Group]
    variance_components: list[VarianceComponent]
    interior: Interior
    inputs: dict[str, str]
    residuals_file: str
    warnings: list[Warned]


class Results(Part, frozen=True):
    """The results of all bundles, from `orip run` in a project with several."""

    command: Literal["run"]
    results: list[Result]


class Residual(Part, frozen=True):
    """A row of residuals.csv."""

    kind: str
    photo: str
    point: str
    component: str
    observed: float | None
    residual: float | None
    a_priori: float | None
    standard_residual: float | None
    weight_factor: float | None
    redundancy_number: float | None
    w: float | None


class PartOfResult(Part, frozen=True):
    """A part of the result: the cameras, photos, points, theodolites, figures or residuals that were asked for."""

    run: str
    cameras: dict[str, dict[str, Estimate]] | UnsetType = UNSET
    photos: dict[str, Photo] | UnsetType = UNSET
    angle_unit: Literal["degree", "gon", "radian"] | UnsetType = UNSET
    photo_angles: dict[str, dict[str, Estimate]] | UnsetType = UNSET
    points: dict[str, Point] | UnsetType = UNSET
    theodolites: dict[str, Theodolite] | UnsetType = UNSET
    figures: dict[str, Figure] | UnsetType = UNSET
    residuals: list[Residual] | UnsetType = UNSET


class Covariance(Part, frozen=True):
    """Where the covariance matrix, or the normal equations, were written."""

    command: Literal["results covariance", "results normals"]
    run: str
    file: str
    figures: int
