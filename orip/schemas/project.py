"""Types of the documents about a project, of what several documents have in common, and of archives."""

from __future__ import annotations

from typing import Any, Literal

from msgspec import Struct, field


class Part(Struct, frozen=True, forbid_unknown_fields=True):
    """An object of a document: it has the keys that are named, and no others."""


class Warned(Part, frozen=True):
    """A warning: its kind, what it is about, and its text."""

    code: str
    where: str
    text: str


class Estimate(Part, frozen=True):
    """A value with its standard deviation: null for a constant, "singular" for what nothing determines."""

    value: float | None
    sd: float | Literal["singular"] | None


class Named(Part, frozen=True):
    """A name with what it stands for."""

    name: str
    text: str


Status = Literal["converged", "doubtful", "not_converged", "stopped", "not_determined"]


class Fault(Part, frozen=True):
    """One thing that is wrong, and where."""

    file: str | None
    line: int | None
    column: int | None
    message: str


class Error(Part, frozen=True):
    """Why a command failed; printed in place of its own document."""

    exit_code: int
    errors: list[Fault]


class RecordDone(Part, frozen=True):
    """What `orip init` did to a record."""

    kind: str
    name: str
    action: str


class ValueChange(Part, frozen=True):
    """A value before and after; null: not given."""

    key: str
    old: Any
    new: Any
    unit: str


class RecordChange(Part, frozen=True):
    """What happened to a record; a renamed one has its new name, and its old one beside it."""

    kind: str
    name: str
    action: Literal["added", "changed", "renamed", "deleted"]
    old_name: str
    values: list[ValueChange]


class Init(Part, frozen=True):
    """What the stores took over from orip.toml."""

    command: Literal["init"]
    unchanged: bool
    changes: list[RecordDone]
    differences: list[RecordChange]
    warnings: list[Warned]


class Samples(Part, frozen=True):
    """The sample projects that can be written."""

    command: Literal["init"]
    samples: list[Named]


class SampleWritten(Part, frozen=True):
    """A sample project that was written, and the command that comes next."""

    command: Literal["init"]
    sample: str
    folder: str
    files: list[str]
    next: str


class Step(Part, frozen=True):
    """A command of the ordinary course, and whether its outputs are up to date."""

    command: str
    state: str
    text: str


class ProjectStatus(Part, frozen=True):
    """What the project has, what is out of date, and what comes next; null: nothing."""

    command: Literal["status"]
    project: str
    user: str
    counts: dict[str, int]
    steps: list[Step]
    next: str | None
    warnings: list[Warned]


class ExportToml(Part, frozen=True):
    """The text that says what the stores hold."""

    command: Literal["export-toml"]
    file: str | None
    backup: str | None
    unchanged: bool
    text: str
    warnings: list[Warned]


class Records(Part, frozen=True):
    """Records of a kind: their tables of orip.toml, each with where it came from."""

    command: Literal["camera list", "temtick list", "photo list", "template list", "bundle list", "model list"]
    records: list[dict[str, Any]]


class RecordValue(Part, frozen=True):
    """A value of a record; null: not given."""

    key: str
    value: Any
    unit: str


class Record(Part, frozen=True):
    """A record with all its values, and what names it."""

    command: Literal["camera show", "temtick show", "photo show", "template show", "bundle show", "model show"]
    record: dict[str, Any]
    values: list[RecordValue]
    source: str = field(name="from")
    named_by: list[str]


class RecordEdit(Part, frozen=True):
    """What an edit of records did, or would do: `camera add`, `photo rename` ..."""

    command: str
    measurements_deleted: list[str]
    unchanged: bool
    dry_run: bool
    changes: list[RecordChange]
    warnings: list[Warned]


class ControlLines(Part, frozen=True):
    """The lines of a control file; keys are those of its heading."""

    command: str
    file: str
    records: list[dict[str, str | float | bool | None]]


class LineChange(Part, frozen=True):
    """What happened to a line of a control file."""

    action: Literal["added", "changed", "killed"]
    line: int
    old: str | None
    new: str | None


class ControlEdit(Part, frozen=True):
    """What an edit of a control file did, or would do."""

    command: str
    file: str
    unchanged: bool
    dry_run: bool
    changes: list[LineChange]
    warnings: list[Warned]


class CurvePoint(Part, frozen=True):
    """A point of the distortion that was given, and how far the polynomial is from it."""

    radius: float
    given: float
    residual: float


class CameraPlot(Part, frozen=True):
    """The radial distortion of a camera: mm, radii in mm."""

    command: Literal["camera plot"]
    camera: str
    form: str
    bundle: str | None
    polynomial: dict[str, float]
    isp: dict[str, float] | None
    radius: list[float]
    distortion: list[float]
    curve: list[CurvePoint]


class Format(Part, frozen=True):
    """A format of another program."""

    name: str
    title: str


class Formats(Part, frozen=True):
    """The formats that are read, or written."""

    command: Literal["import", "export"]
    formats: list[Format]


class StatedError(Part, frozen=True):
    """The reprojection error that the imported files state: of what, in pixels."""

    of: str
    value: float


class Import(Part, frozen=True):
    """A project that was made of one of another program."""

    command: Literal["import"]
    format: str
    folder: str
    photos: int
    points: int
    rays: int
    reprojection_rms: float | None
    stated_error: StatedError | None
    notes: list[str]
    files: list[str]


class Export(Part, frozen=True):
    """A result that was written in the format of another program."""

    command: Literal["export"]
    format: str
    target: str
    original: str | None
    photos: int
    points: int
    notes: list[str]
    files: list[str]


class StationsImport(Part, frozen=True):
    """Exposure stations that were written, or would be."""

    command: Literal["stations import"]
    file: str
    dry_run: bool
    stations: list[str]
    replaced: int
    new_photos: list[str]
    warnings: list[Warned]


class ProjectMade(Part, frozen=True):
    """A project that was made, and the command that comes next."""

    command: Literal["init", "new", "photos"]
    project: str
    folder: str
    next: str
    files: list[str]


class ArchiveRun(Part, frozen=True):
    """A run of an archive that has come to its end."""

    command: Literal["archive run"]
    projects: int
    states: dict[str, int]
    finished_before: int
    seconds: float
    tables: str
    overview: str


class NotAdjusted(Part, frozen=True):
    """A project that is not adjusted, and why."""

    project: str
    message: str


class ArchiveStatus(Part, frozen=True):
    """How far the run of an archive is."""

    command: Literal["archive status"]
    base: str
    running: bool
    projects: int
    states: dict[str, int]
    projects_a_second: float
    seconds_left: float | None
    dashboard: str
    not_adjusted: list[NotAdjusted]


class ArchiveReport(Part, frozen=True):
    """Tables and overview of an archive that were written; rows by table."""

    command: Literal["archive report"]
    rows: dict[str, int]
    tables: str
    overview: str


class ChangedWord(Part, frozen=True):
    """A result or a gate that is another one."""

    project: str
    bundle: str
    name: str
    before: str
    after: str


class MovedValue(Part, frozen=True):
    """A value that has moved; times its standard deviation, null: it has none."""

    project: str
    bundle: str
    name: str
    before: float
    after: float
    times: float | None


class ArchiveDiff(Part, frozen=True):
    """What differs between two runs of an archive."""

    command: Literal["archive diff"]
    compared: int
    changed: list[ChangedWord]
    moved: list[MovedValue]


class ArchiveSimulate(Part, frozen=True):
    """An archive of simulated projects that was written; faults by kind."""

    command: Literal["archive simulate"]
    folder: str
    projects: int
    faults: dict[str, int]
