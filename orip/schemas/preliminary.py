"""Types of the documents about preliminary values, and of what checks, reports and comparisons of results print."""

from __future__ import annotations

from typing import Literal

from msgspec import UNSET, UnsetType, field

from orip.schemas.project import Part, Status, Warned

Kind = Literal["cameras", "photos", "points"]
Numbers = list[float | None]


class StartOfPhoto(Part, frozen=True):
    """How a photo was oriented, and its orientation: ground units and degrees."""

    oriented: bool
    how: str
    X0: float | UnsetType = UNSET
    Y0: float | UnsetType = UNSET
    Z0: float | UnsetType = UNSET
    OMEGA: float | UnsetType = UNSET
    PHI: float | UnsetType = UNSET
    KAPPA: float | UnsetType = UNSET


class StartOfPoint(Part, frozen=True):
    """Preliminary coordinates."""

    X: float
    Y: float
    Z: float


class Prelim(Part, frozen=True):
    """Preliminary values that were computed."""

    command: Literal["prelim"]
    bundle: str
    photos: dict[str, StartOfPhoto]
    points: dict[str, StartOfPoint]
    cameras: dict[str, dict[str, float]]
    findings: list[str]
    unchanged: bool
    changed_photos: list[str]
    changed_points: list[str]
    listing: str
    warnings: list[Warned]


class Failure(Part, frozen=True):
    """What could not be oriented; `other`: the second of two, or empty."""

    name: str
    other: str
    reason: str


class Parallax(Part, frozen=True):
    """A point of a model: photo coordinates and parallax, mm."""

    point: str
    left: list[float]
    right: list[float]
    py: float
    spy: float | None
    weight_factor: float
    in_front: bool


class Model(Part, frozen=True):
    """A relative orientation: base in metres at photo scale, angles in degrees."""

    model: str
    left: str
    right: str
    row: int | None
    column: int | None
    npts: int
    its: int
    seuw: float | None
    mres: float | None
    base: Numbers
    base_sd: Numbers
    angles: Numbers
    angles_sd: Numbers
    points: list[Parallax]
    remarks: list[str]


class Relative(Part, frozen=True):
    """Relative orientations of models."""

    command: Literal["prelim relative"]
    models: list[Model]
    failures: list[Failure]


class CommonPoint(Part, frozen=True):
    """A point of a similarity transformation: coordinates and residuals in the system it leads to."""

    point: str
    xyz: Numbers
    residuals: Numbers
    weight_factors: Numbers


class Similarity(Part, frozen=True):
    """A similarity transformation: of a bridging, a connection, or the absolute orientation."""

    step: str
    source: str = field(name="from")
    target: str | None = field(name="to")
    photo: str | None
    pnt: int
    its: int
    s0: float | None
    mres: float | None
    scale: float
    scale_sd: float | None
    shift: Numbers
    shift_sd: Numbers
    angles: Numbers
    angles_sd: Numbers
    points: list[CommonPoint]
    remarks: list[str]
    scale_unit: str | UnsetType = UNSET
    shift_unit: str | UnsetType = UNSET


class Similarities(Part, frozen=True):
    """Bridgings or connections."""

    command: Literal["prelim"]
    steps: list[Similarity]
    failures: list[Failure]


class Absolute(Part, frozen=True):
    """The absolute orientation; null where there is none."""

    command: Literal["prelim absolute"]
    absolute: Similarity | None
    findings: list[str]


class ModelPoint(Part, frozen=True):
    """Model coordinates of a point with their standard deviations."""

    xyz: Numbers
    sd: Numbers


class System(Part, frozen=True):
    """A model, a row or the ground: its projection centres and points."""

    name: str
    photos: dict[str, Numbers]
    points: dict[str, ModelPoint]


class ModelCoordinates(Part, frozen=True):
    """Model coordinates after a step."""

    command: Literal["prelim show"]
    after: str
    systems: list[System]


class ChangedValue(Part, frozen=True):
    """A preliminary value before and after; null: there was none."""

    name: str
    parameter: str
    old: float | None
    new: float


class KeptValue(Part, frozen=True):
    """A value that stayed as it was, and why."""

    name: str
    parameter: str
    reason: str


class Update(Part, frozen=True):
    """Preliminary values taken from an adjustment."""

    command: Literal["update"]
    what: Kind
    bundle: str
    run: str
    file: str
    dry_run: bool
    unchanged: bool
    changed: list[str]
    changes: list[ChangedValue]
    kept: list[KeptValue]
    antennas: list[KeptValue]
    constant: int
    others: int
    warnings: list[Warned]


class UpdateUndone(Part, frozen=True):
    """The last update undone."""

    command: Literal["update"]
    what: Kind
    bundle: str
    file: str
    dry_run: bool
    undone: list[str]


class Gate(Part, frozen=True):
    """A gate with the figure that it limits; the reason says why a value is null."""

    name: str
    operator: Literal["<", "<=", ">", ">=", "==", "!="]
    limit: float
    value: float | None
    passed: bool = field(name="pass")
    reason: str | None


class Check(Part, frozen=True):
    """Gates against the last adjustment."""

    command: Literal["check"]
    bundle: str
    run: str
    status: Status
    gates: list[Gate]
    passed: bool = field(name="pass")
    warnings: list[Warned]


class Report(Part, frozen=True):
    """Where the report was written."""

    command: Literal["report"]
    run: str
    bundle: str
    file: str
    pdf: str | UnsetType = UNSET


class Difference(Part, frozen=True):
    """A figure in which two results differ by more than is allowed."""

    name: str
    a: float | str | None
    b: float | str | None
    difference: float | None
    allowed: float


class Compare(Part, frozen=True):
    """Two results compared figure by figure."""

    command: Literal["compare"]
    a: str
    b: str
    tolerance: float
    relative: float
    sigma: float | None
    equal: bool
    compared: int
    differences: list[Difference]
    only_in_a: list[str]
    only_in_b: list[str]
