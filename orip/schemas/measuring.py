"""Types of the documents of measuring: photo observations, digitising, and the link to a plate processor."""

from __future__ import annotations

from typing import Literal

from msgspec import UNSET, UnsetType, field

from orip.schemas.project import Part, Warned

Pair = list[float | None]


class Measure(Part, frozen=True):
    """How much is measured: numbers of templates, of photos, and of photo points by bundle."""

    command: Literal["measure"]
    unchanged: bool
    files: list[str]
    templates: int
    photos: int
    points: dict[str, int]
    remeasured: int
    warnings: list[Warned]


class ListedObservation(Part, frozen=True):
    """A measured photo point, with what the last adjustment says of it: mm; null: not adjusted."""

    photo: str
    point: str
    measured: Pair
    error: Pair
    residual: Pair
    sd: Pair
    weight_factor: Pair
    disregarded: bool
    rays: int
    before: int


class StereoPartner(Part, frozen=True):
    """A photo that shows a point of another photo, measured there or not."""

    photo: str
    point: str
    partner: str
    model: str | None
    place: Literal["measured", "predicted", "not known"]
    photo_xy: Pair
    log_xy: Pair


class Observations(Part, frozen=True):
    """Photo observations, and their partners."""

    command: Literal["observations list"]
    bundle: str
    run: str | None
    observations: list[ListedObservation]
    partners: list[StereoPartner]
    warnings: list[Warned]


class LeftAlone(Part, frozen=True):
    """A point that an edit leaves with one ray or none, and the photo that remains."""

    bundle: str
    point: str
    photos: list[str]


class ObservationEdit(Part, frozen=True):
    """Lines that were added to EDITS.MEA, or would be."""

    command: str
    bundle: str | None
    unchanged: bool
    dry_run: bool
    added: list[str]
    left_alone: list[LeftAlone]
    warnings: list[Warned]


class PointToMeasure(Part, frozen=True):
    """A point to measure again, and why."""

    photo: str
    point: str
    why: Literal["down-weighted", "disregarded", "killed", "single ray"]
    before: Pair
    predicted: Pair
    residual: Pair
    weight_factor: Pair


class Todo(Part, frozen=True):
    """What to measure again."""

    command: Literal["observations todo"]
    bundle: str
    file: str | None
    points: list[PointToMeasure]
    warnings: list[Warned]


class Entry(Part, frozen=True):
    """A mark or point that was driven to: where to, why there, and what was digitised."""

    what: str
    owner: str
    name: str
    outcome: Literal["digitised", "skipped", "kept"]
    known: str
    driven: Pair | None
    xy: Pair | None


class MarkResidual(Part, frozen=True):
    """The residual of a mark, mm."""

    name: str
    residual: Pair


class MarkOrientation(Part, frozen=True):
    """An orientation by marks."""

    kind: str
    name: str
    transformation: str
    s0: float | None
    redundancy: int
    marks: list[MarkResidual]


class Digitised(Part, frozen=True):
    """Marks and points that were digitised."""

    command: str
    log: str
    dry_run: bool
    ending: str
    entries: list[Entry]
    orientations: list[MarkOrientation]
    warnings: list[Warned]


class GroundPoint(Part, frozen=True):
    """A point set in the model: coordinates, and the y-parallax that was left, mm."""

    name: str
    outcome: Literal["digitised", "skipped", "kept"]
    xyz: list[float] | None
    y_parallax: float | None


class GroundDigitised(Part, frozen=True):
    """Ground points that were taken from models."""

    command: Literal["digitise ground"]
    file: str
    ending: str
    points: list[GroundPoint]
    warnings: list[Warned]


class DriveTable(Part, frozen=True):
    """What the drive table holds, and the coordinates at which driving starts."""

    command: Literal["drive table"]
    file: str
    changed: bool
    cameras: int
    photos: int
    models: int
    start: list[float]
    warnings: list[Warned]


class Download(Part, frozen=True):
    """The drive table as it was loaded into a plate processor."""

    command: Literal["drive download"]
    link: str
    file: str
    changed: bool
    photos: int
    models: int
    sha256: str
    warnings: list[Warned]


class Driven(Part, frozen=True):
    """Where the stages were driven to: plate coordinates."""

    command: str
    model: str
    upper: list[float]
    lower: list[float]
    condition: str


class PhotoPlace(Part, frozen=True):
    """A photo of the model, and the mark in it, mm."""

    photo: str
    xy: list[float]


class Where(Part, frozen=True):
    """Where the measuring mark is."""

    command: Literal["drive where"]
    model: str
    condition: str
    ground: list[float] | None
    y_parallax: float | None
    upper: list[float]
    lower: list[float]
    photos: dict[str, PhotoPlace]
    guide: str
    lock: str | None
    automatic: bool


class ProfilePoint(Part, frozen=True):
    """A step of a profile; the model is null where no plate can be driven there."""

    ground: list[float]
    model: str | None
    upper: list[float] | UnsetType = UNSET
    lower: list[float] | UnsetType = UNSET


class Profile(Part, frozen=True):
    """Equal steps along a line on the ground."""

    command: Literal["drive profile"]
    points: list[ProfilePoint]


class Panel(Part, frozen=True):
    """The settings of the plate processor."""

    command: str
    model: str
    guide: str
    condition: str
    lock: str | None
    prisms: list[int]
    automatic: bool


class Listening(Part, frozen=True):
    """Where an emulated plate processor listens."""

    command: Literal["drive emulate"]
    listening: str
    link: str


class Watching(Part, frozen=True):
    """The address of the page that shows a plate processor."""

    command: Literal["drive watch"]
    url: str


class Screen(Part, frozen=True):
    """The address of the page on which points are measured in the images of photos."""

    command: Literal["screen"]
    url: str


class PointToAdd(Part, frozen=True):
    """A measurement that is worth making: where it is expected, and what it would tell about the block."""

    photo: str
    point: str
    x: float
    y: float
    mm: list[float]
    ellipse: list[float] | None
    gain: float | None
    text: str


class TodoNext(Part, frozen=True):
    """What is worth measuring next, the most profitable first."""

    command: Literal["observations todo"]
    bundle: str
    next: list[PointToAdd]


class OnlineSuspect(Part, frozen=True):
    """An observation that does not fit: w and its limit, and others that an error could be in just as well."""

    observation: str
    photo: str
    point: str
    w: float
    limit: float
    alike: list[str]


class OnlineAnswer(Part, frozen=True):
    """What a measurement did, and how it stands."""

    photo: str
    point: str
    state: Literal["waiting", "unchecked", "included", "suspect", "excluded"]
    text: str
    w: float | None
    limit: float | None
    redundancy: list[float]
    sigma0: float | None
    sigma0_before: float | None = field(name="sigma0 before")
    suspects: list[OnlineSuspect]
    cleared: list[str]
    oriented: list[str]
    placed: list[str]
    next: list[PointToAdd]
    pending: bool


class OnlineReconsidered(Part, frozen=True):
    """What has become of an answer of a session of measuring since it was given."""

    command: Literal["online"]
    reconsidered: OnlineAnswer


class OnlineDemo(Part, frozen=True):
    """How the simulated session of measuring ended."""

    command: Literal["online"]
    summary: str
    suspects: list[str]
